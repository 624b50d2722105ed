"""The stand-off waypoint comes last; the operator's items are never changed, whatever goes wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from pyproj import Geod

from gcs_plugin.publish.messages import Message
from gcs_plugin.publish.mission_items import append_item, standoff_waypoint
from gcs_plugin.publish.mission_protocol import MissionItem, MissionProtocol
from mission.errors import AnswerError
from mission.geodesy import Geodetic
from tests.support.fake_autopilot import ARDUPILOT, HOME, PX4, FakeLink, Vehicle, in_centimetres, plan

GEOD = Geod(ellps="WGS84")
TARGET = Geodetic(37.2277, 126.8405, 0.0, "amsl")
WAYPOINT = MissionItem(3, mavlink.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 90.0), 372277000, 1268406000, 3.125)
BOTH = pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])


def protocol(vehicle: Vehicle, lose_every: int = 0) -> MissionProtocol:
    link = FakeLink(vehicle, lose_every)
    return MissionProtocol(link, clock=link.clock)


def same(one: Sequence[MissionItem], other: Sequence[MissionItem]) -> bool:
    return len(one) == len(other) and all(a.same_as(b) for a, b in zip(one, other, strict=True))


# --- where the waypoint is


@pytest.mark.parametrize("azimuth_deg", [0.0, 77.0, 200.0, 301.0])
def test_the_waypoint_lies_between_drone_and_target_and_looks_at_it(azimuth_deg: float) -> None:
    lon, lat, back = GEOD.fwd(TARGET.lon_deg, TARGET.lat_deg, azimuth_deg, 20.0)
    item = standoff_waypoint(TARGET, Geodetic(lat, lon, 33.0, "amsl"), distance_m=6.0)
    azimuth, _, metres = GEOD.inv(TARGET.lon_deg, TARGET.lat_deg, item.y / 1e7, item.x / 1e7)
    assert metres == pytest.approx(6.0, abs=0.02)
    assert azimuth % 360.0 == pytest.approx(azimuth_deg, abs=0.2)
    assert item.params[3] == pytest.approx(back % 360.0, abs=0.01)
    assert (item.frame, item.z) == (mavlink.MAV_FRAME_GLOBAL, 33.0)


def test_a_drone_that_is_nearer_than_the_stand_off_stays_where_it_is() -> None:
    lon, lat, _ = GEOD.fwd(TARGET.lon_deg, TARGET.lat_deg, 45.0, 4.0)
    item = standoff_waypoint(TARGET, Geodetic(lat, lon, 0.0, "amsl"), distance_m=6.0)
    assert (item.x, item.y) == (round(lat * 1e7), round(lon * 1e7))


def test_above_the_target_it_stays_too_and_the_heading_is_left_open() -> None:
    item = standoff_waypoint(TARGET, TARGET, distance_m=6.0)
    assert (item.x, item.y) == (372277000, 1268405000)
    assert math.isnan(item.params[3])


@pytest.mark.parametrize(("distance", "height"), [(0.0, 3.0), (-1.0, 3.0), (math.nan, 3.0), (5.0, math.nan)])
def test_an_unknown_height_or_an_impossible_distance_is_refused(distance: float, height: float) -> None:
    with pytest.raises(AnswerError, match="No waypoint"):
        standoff_waypoint(TARGET, replace(TARGET, alt_m=height), distance_m=distance)


def test_the_waypoint_is_as_high_above_the_sea_as_the_drone_was_wherever_home_is() -> None:
    above_ellipsoid = Geodetic(37.2278, 126.8405, 63.5, "ellipsoid")
    item = standoff_waypoint(TARGET, above_ellipsoid, distance_m=6.0, geoid_separation_m=23.5)
    assert item.frame == mavlink.MAV_FRAME_GLOBAL
    assert item.z == pytest.approx(40.0)
    for unknown in (above_ellipsoid, replace(above_ellipsoid, datum="home")):
        with pytest.raises(AnswerError):
            standoff_waypoint(TARGET, unknown, distance_m=6.0)


# --- appending it


@BOTH
@pytest.mark.parametrize("length", [0, 1, 4])
def test_it_is_appended_to_the_plan_that_is_there(autopilot: int, length: int) -> None:
    before = plan(autopilot, length)
    vehicle = Vehicle(autopilot, list(before))
    number = append_item(protocol(vehicle), WAYPOINT).number
    assert number == len(before)
    assert same(vehicle.items[:-1], before)
    assert (vehicle.items[-1].x, vehicle.items[-1].y) == (WAYPOINT.x, WAYPOINT.y)
    assert vehicle.items[-1].z == pytest.approx(WAYPOINT.z, abs=0.01)
    assert vehicle.uploads == 1


def test_into_an_ardupilot_without_even_a_home_the_waypoint_does_not_become_home() -> None:
    vehicle = Vehicle(ARDUPILOT, [])
    assert append_item(protocol(vehicle), WAYPOINT).number == 1
    assert vehicle.items[0].same_as(HOME)
    assert vehicle.items[1].x == WAYPOINT.x


def test_a_home_that_wanders_meanwhile_is_not_taken_for_a_changed_plan() -> None:
    before = plan(ARDUPILOT)
    vehicle = Vehicle(ARDUPILOT, list(before), home_wanders=True)
    append_item(protocol(vehicle), WAYPOINT)
    assert same(vehicle.items[1:-1], before[1:])


@BOTH
@pytest.mark.parametrize("lose_every", [3, 4, 5, 7, 11])
def test_lost_messages_are_made_good(autopilot: int, lose_every: int) -> None:
    before = plan(autopilot)
    vehicle = Vehicle(autopilot, list(before))
    append_item(protocol(vehicle, lose_every), WAYPOINT)
    assert same(vehicle.items[:-1], before)
    assert vehicle.items[-1].x == WAYPOINT.x


@BOTH
@pytest.mark.parametrize("seed", range(20))
def test_with_a_third_of_the_messages_lost_it_is_appended_or_the_plan_is_as_it_was(autopilot: int, seed: int) -> None:
    before = plan(autopilot)
    vehicle = Vehicle(autopilot, list(before))
    link = FakeLink(vehicle, loss=0.33, rng=np.random.default_rng(seed))
    try:
        append_item(MissionProtocol(link, clock=link.clock), WAYPOINT)
    except AnswerError as error:
        if "may be incomplete" in error.cause:
            return  # said, not hidden
        assert same(vehicle.items, before)
    else:
        assert same(vehicle.items[:-1], before)
        assert vehicle.items[-1].x == WAYPOINT.x


@BOTH
def test_messages_that_are_not_ours_are_not_taken_for_answers(autopilot: int) -> None:
    before = plan(autopilot)
    vehicle = Vehicle(autopilot, list(before), strangers=True)
    append_item(protocol(vehicle), WAYPOINT)
    assert same(vehicle.items[:-1], before)


@BOTH
def test_a_lost_acknowledgement_is_not_a_failure(autopilot: int) -> None:
    vehicle = Vehicle(autopilot, plan(autopilot), loses_final_ack=True)
    assert append_item(protocol(vehicle), WAYPOINT).number == len(vehicle.items) - 1


@BOTH
@pytest.mark.parametrize("at", [0, 2, 4])
@pytest.mark.parametrize(
    ("refusal", "words"),
    [(mavlink.MAV_MISSION_NO_SPACE, "no space"), (mavlink.MAV_MISSION_DENIED, "denied"), (99, "99")],
)
def test_a_refusal_is_named_and_the_operators_plan_is_there_as_it_was(
    autopilot: int, at: int, refusal: int, words: str
) -> None:
    before = plan(autopilot)
    vehicle = Vehicle(autopilot, list(before), refuse_item=at, refusal=refusal)
    with pytest.raises(AnswerError, match=f"refuses: {words}; the operator's plan is on the vehicle as it was"):
        append_item(protocol(vehicle), WAYPOINT)
    assert same(vehicle.items, before)


@BOTH
def test_a_vehicle_that_dies_half_way_and_wakes_has_the_operators_plan(autopilot: int) -> None:
    before = plan(autopilot)
    vehicle = Vehicle(autopilot, list(before), dies_at_item=2, wakes=True)
    with pytest.raises(AnswerError, match="as it was"):
        append_item(protocol(vehicle), WAYPOINT)
    assert same(vehicle.items, before)


@BOTH
def test_when_the_vehicle_never_answers_again_the_operator_is_told_to_check_the_plan(autopilot: int) -> None:
    vehicle = Vehicle(autopilot, plan(autopilot), dies_at_item=2)
    with pytest.raises(AnswerError, match=r"may be incomplete.*Upload your plan again"):
        append_item(protocol(vehicle), WAYPOINT)


@BOTH
def test_a_plan_that_reads_back_otherwise_is_put_back(autopilot: int) -> None:
    before = plan(autopilot)
    vehicle = Vehicle(autopilot, list(before), spoils=True, spoils_above=len(before))
    with pytest.raises(AnswerError, match="does not read it back; the operator's plan is on the vehicle as it was"):
        append_item(protocol(vehicle), WAYPOINT)
    assert same(vehicle.items, before)
    assert vehicle.uploads == 2


@BOTH
def test_a_plan_that_cannot_be_put_back_is_not_called_whole(autopilot: int) -> None:
    vehicle = Vehicle(autopilot, plan(autopilot), spoils=True)
    with pytest.raises(AnswerError, match="may be incomplete"):
        append_item(protocol(vehicle), WAYPOINT)


@BOTH
@pytest.mark.parametrize("wakes", [True, False])
def test_a_vehicle_that_falls_silent_while_the_plan_is_put_back_is_not_trusted(autopilot: int, wakes: bool) -> None:
    before = plan(autopilot)
    vehicle = Vehicle(autopilot, list(before), spoils=True, spoils_above=len(before), mute_at_upload=2, wakes=wakes)
    with pytest.raises(AnswerError, match=r"does not read it back; the plan on the vehicle may be incomplete"):
        append_item(protocol(vehicle), WAYPOINT)


def test_an_empty_plan_is_put_back_by_clearing() -> None:
    vehicle = Vehicle(PX4, [], spoils=True)
    odd = replace(WAYPOINT, z=math.nan)  # can never be read back as sent
    with pytest.raises(AnswerError, match="as it was"):
        append_item(protocol(vehicle), odd)
    assert vehicle.items == []


@BOTH
def test_when_the_plan_cannot_be_read_nothing_is_written(autopilot: int) -> None:
    vehicle = Vehicle(autopilot, plan(autopilot), mute=True)
    with pytest.raises(AnswerError, match="how many items it has; the plan on the vehicle was not touched"):
        append_item(protocol(vehicle), WAYPOINT)
    assert vehicle.uploads == 0


def test_without_a_heartbeat_nothing_is_written() -> None:
    vehicle = Vehicle(PX4, plan(PX4))
    vehicle._beat_s = math.inf
    with pytest.raises(AnswerError, match="no heartbeat; the plan on the vehicle was not touched"):
        append_item(protocol(vehicle), WAYPOINT)
    assert vehicle.uploads == 0


# --- what real vehicles and other stations do meanwhile


def waypoint(number: int, height_m: float = 20.0) -> MissionItem:
    return MissionItem(3, mavlink.MAV_CMD_NAV_WAYPOINT, (0.0,) * 4, 372270000 + 100 * number, 1268400000, height_m)


def test_an_ardupilot_that_cuts_centimetres_keeps_every_height_however_often_waypoints_are_appended() -> None:
    heights = [0.07, 0.29, 1.0, 1.59, 4.35, 16.1, 57.29, 119.99, -1.59]
    before = [HOME, *(waypoint(i, in_centimetres(height)) for i, height in enumerate(heights))]
    vehicle = Vehicle(ARDUPILOT, list(before))
    always = protocol(vehicle)
    for number in range(4):
        new = replace(WAYPOINT, z=heights[number] + 0.004)
        assert append_item(always, new).number == len(before) + number
    assert same(vehicle.items[: len(before)], before)


def test_a_heading_that_a_px4_keeps_in_radians_is_not_a_changed_plan() -> None:
    vehicle = Vehicle(PX4, [replace(waypoint(0), frame=6, params=(0.0, 0.0, 0.0, 77.0))], turns_by_deg=1e-6)
    always = protocol(vehicle)
    append_item(always, WAYPOINT)
    append_item(always, replace(WAYPOINT, params=(0.0, 0.0, 0.0, 123.456)))
    assert len(vehicle.items) == 3
    assert vehicle.uploads == 2, "nothing was put back"


@BOTH
@pytest.mark.parametrize("length", [3, 5, 7])
def test_a_plan_that_another_station_writes_meanwhile_stays(autopilot: int, length: int) -> None:
    home = [HOME] if autopilot == ARDUPILOT else []
    new = [*home, *(waypoint(100 + i) for i in range(length))]
    vehicle = Vehicle(autopilot, [*home, *(waypoint(i) for i in range(5))])

    class Raced(FakeLink):
        """Another station's plan comes as soon as ours was read."""

        done = False

        def send(self, message: Message) -> None:
            super().send(message)
            if message.get_type() == "MISSION_ACK" and not self.done:
                self.done, self.vehicle.items = True, list(new)

    link = Raced(vehicle)
    with pytest.raises(AnswerError, match=r"Another station writes the plan.*was not touched"):
        append_item(MissionProtocol(link, clock=link.clock), WAYPOINT)
    assert same(vehicle.items, new)
    assert vehicle.uploads == 0


END = replace(waypoint(0), x=0, y=0, z=0.0)


@BOTH
@pytest.mark.parametrize(
    ("last", "words"),
    [
        (replace(END, command=mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH), "returns home at item {}"),
        (replace(END, command=mavlink.MAV_CMD_NAV_LAND), "lands at item {}"),
        (replace(END, command=mavlink.MAV_CMD_NAV_LOITER_UNLIM), "waits for ever at item {}"),
        (
            replace(END, frame=2, command=mavlink.MAV_CMD_DO_JUMP, params=(1.0, -1.0, 0.0, 0.0)),
            "back to item 1 for ever",
        ),
        (replace(END, frame=2, command=mavlink.MAV_CMD_DO_JUMP, params=(1.0, 3.0, 0.0, 0.0)), ""),
        (replace(END, frame=2, command=mavlink.MAV_CMD_DO_JUMP, params=(9.0, -1.0, 0.0, 0.0)), ""),
        (waypoint(9), ""),
    ],
)
def test_a_waypoint_that_the_plan_does_not_reach_is_told(autopilot: int, last: MissionItem, words: str) -> None:
    home = [HOME] if autopilot == ARDUPILOT else []
    vehicle = Vehicle(autopilot, [*home, *(waypoint(i) for i in range(3)), last])
    appended = append_item(protocol(vehicle), WAYPOINT)
    assert appended.number == len(vehicle.items) - 1
    assert words.format(len(home) + 3) in appended.warning
    assert bool(appended.warning) == bool(words)


@BOTH
def test_a_plan_too_long_for_a_slow_link_is_refused_soon_and_not_touched(autopilot: int) -> None:
    vehicle = Vehicle(autopilot, [HOME, *(waypoint(i) for i in range(700))])

    class Slow(FakeLink):
        def send(self, message: Message) -> None:
            self.now_s += 0.15
            super().send(message)

    link = Slow(vehicle)
    with pytest.raises(AnswerError, match=r"701 items, and reading them alone takes 1\d\d s.*was not touched"):
        append_item(MissionProtocol(link, clock=link.clock), WAYPOINT)
    assert link.now_s - 100.0 < 5.0
    assert vehicle.uploads == 0
    vehicle._beat_s = 100.5
    quick = FakeLink(vehicle)
    assert append_item(MissionProtocol(quick, clock=quick.clock), WAYPOINT).number == 701
