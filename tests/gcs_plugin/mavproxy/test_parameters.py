"""Parameters of `sidestep serve`, read and set by name: the talk and the server that answers it, over the wire."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component.identity import ParameterEncoding
from gcs_plugin.component.parameter_protocol import ParameterServer
from gcs_plugin.mavproxy.parameters import ANSWER_S, SENDINGS, ParameterTalk, Peer
from mission.errors import SettingsError
from mission.settings import MissionSettings


class Line:
    """Both ends; each message is packed and parsed."""

    def __init__(self, encoding: ParameterEncoding) -> None:
        self.server = ParameterServer(MissionSettings(), encoding)
        self.talk = ParameterTalk(self.carry, self.tell, lambda: Peer(1, 100, encoding))
        self.told: list[str] = []
        self.sent: list[str] = []
        self.dead = False
        self.may_change = True

    def tell(self, text: str) -> None:
        self.told.append(text)

    def carry(self, message: Any) -> None:
        self.sent.append(message.get_type())
        if not self.dead:
            for answer in self.server.take(_over_the_wire(message), may_change=self.may_change):
                self.talk.value(_over_the_wire(answer), 0.0)


def _over_the_wire(message: Any) -> Any:
    (parsed,) = mavlink.MAVLink(None).parse_buffer(message.pack(mavlink.MAVLink(None, 255, 190)))
    return parsed


@pytest.fixture(params=["c-cast", "bytewise"])
def line(request: pytest.FixtureRequest) -> Line:
    return Line(request.param)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("pattern_length_m", None, "PATTERN_LENGTH_M = 3"),
        ("PATTERN_LENGTH_M", "4.2", "PATTERN_LENGTH_M = 4.2"),
        ("PATTERN_LENGTH_M", "4000", "PATTERN_LENGTH_M stays 3: 4000 was not taken"),
        ("PATTERN_PASSES", "3", "PATTERN_PASSES = 3"),
        ("PATTERN_SIDE", "1", "PATTERN_SIDE = 1"),
        ("VIDEO_CHK_OFFSET", "false", "VIDEO_CHK_OFFSET = 0"),
        ("ANSWER_ROI", "0", "ANSWER_ROI = 0"),
        ("VIDEO_LATENCY_S", "nan", "VIDEO_LATENCY_S = nan"),
        ("PATTERN_PASSES", "1.5", "PATTERN_PASSES: 1.5 cannot be its value"),
        ("PATTERN_PASSES", "nan", "PATTERN_PASSES: nan cannot be its value"),
    ],
)
def test_the_operator_is_told_what_the_value_is_then(line: Line, name: str, value: str | None, told: str) -> None:
    line.talk.begin(name, value, 0.0)
    assert [text.startswith(told) for text in line.told] == [True], line.told


def test_a_set_value_is_in_the_settings_of_the_next_flight(line: Line) -> None:
    line.talk.begin("ANSWER_WAYPOINT", "1", 0.0)
    line.talk.begin("REPEAT", "2", 0.0)
    assert (line.server.settings.answer.waypoint, line.server.settings.repeat) == ("on-request", 2)


def test_a_station_that_may_not_set_learns_the_value_that_stays(line: Line) -> None:
    line.may_change = False
    line.talk.begin("REPEAT", "2", 0.0)
    assert line.told == ["REPEAT stays 1: 2 was not taken (range, or this station may not set)"]


def test_a_lost_answer_is_asked_for_again_and_one_that_never_comes_is_given_up(line: Line) -> None:
    line.dead = True
    line.talk.begin("REPEAT", "2", 0.0)
    line.talk.tick(ANSWER_S)
    assert line.sent == ["PARAM_REQUEST_READ"] * 2
    line.dead = False
    line.talk.tick(2 * ANSWER_S)
    assert line.told == ["REPEAT = 2"]
    line.dead = True
    line.talk.begin("NOT_THERE", None, 0.0)
    for i in range(SENDINGS + 1):
        line.talk.tick(i * ANSWER_S)
    assert line.told[-1].startswith("NOT_THERE: not answered")


@pytest.mark.parametrize("name", ["", "x.y", "A" * 17, "A B", "1A", "Ä"])
def test_what_cannot_be_a_name_is_refused(line: Line, name: str) -> None:
    with pytest.raises(SettingsError, match="is no parameter name"):
        line.talk.begin(name, None, 0.0)
    assert line.sent == []


@pytest.mark.parametrize("value", ["fast", "inf", "", "1,5"])
def test_what_is_no_number_is_refused(line: Line, value: str) -> None:
    with pytest.raises(SettingsError, match="is no number"):
        line.talk.begin("REPEAT", value, 0.0)


def test_a_value_of_an_unknown_type_is_passed_over(line: Line) -> None:
    line.dead = True
    line.talk.begin("REPEAT", None, 0.0)
    line.talk.value(mavlink.MAVLink_param_value_message(b"REPEAT", 1.0, 77, 1, 0), 0.0)
    assert line.told == []
