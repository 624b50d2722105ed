"""What is given to the autopilot, and when: automatically, on request or never."""

from __future__ import annotations

from typing import get_args

import pytest
from pymavlink.dialects.v20 import common as mavlink

from gcs_plugin.publish.autopilot_handoff import AutopilotHandoff, What
from mission.errors import AnswerError
from mission.settings import AnswerSettings
from tests.support.fake_autopilot import PX4, FakeLink, Vehicle, plan
from tests.support.sample import geotag, origin

TAG = geotag(at=origin("amsl"))


def autopilot_handoff(link: FakeLink, mode: str) -> AutopilotHandoff:
    return AutopilotHandoff(link, AnswerSettings.model_validate({"roi": mode, "waypoint": mode}))


@pytest.fixture
def link() -> FakeLink:
    return FakeLink(Vehicle(PX4, plan(PX4)))


@pytest.mark.parametrize("mode", ["automatic", "on-request"])
def test_a_request_points_the_nose_and_appends_one_waypoint(link: FakeLink, mode: str) -> None:
    given = autopilot_handoff(link, mode)
    before = [(item.command, item.x, item.y, item.z) for item in link.vehicle.items]
    assert given.requested("roi", TAG) == "set"
    assert given.requested("waypoint", TAG).startswith(f"appended to the mission as item {len(before)}")
    ((command, _, x, y, z, _),) = link.commands
    assert command == mavlink.MAV_CMD_DO_SET_ROI_LOCATION
    assert (x, y) == (round(TAG.place.lat_deg * 1e7), round(TAG.place.lon_deg * 1e7))
    assert z == pytest.approx(TAG.place.alt_m)
    assert [(item.command, item.x, item.y, item.z) for item in link.vehicle.items[:-1]] == before


@pytest.mark.parametrize("what", get_args(What))
def test_what_the_settings_forbid_is_refused_with_the_remedy(link: FakeLink, what: What) -> None:
    with pytest.raises(AnswerError, match=f'The settings forbid .*Set answer.{what} to "on-request"'):
        autopilot_handoff(link, "never").requested(what, TAG)
    assert link.commands == []
    assert link.sent == []


@pytest.mark.parametrize("what", get_args(What))
def test_without_an_answer_there_is_nothing_to_give(link: FakeLink, what: What) -> None:
    with pytest.raises(AnswerError, match="There is no answer yet"):
        autopilot_handoff(link, "automatic").requested(what, None)


def test_only_automatic_is_done_unasked(link: FakeLink) -> None:
    done = {mode: autopilot_handoff(link, mode).automatic("roi") for mode in ("automatic", "on-request", "never")}
    assert done == {"automatic": True, "on-request": False, "never": False}


@pytest.mark.parametrize(("before", "now"), [(True, "automatic"), (False, "never")])
def test_settings_files_of_the_first_version_keep_their_meaning(before: bool, now: str) -> None:
    settings = AnswerSettings.model_validate({"roi": before, "waypoint": before})
    assert (settings.roi, settings.waypoint) == (now, now)
