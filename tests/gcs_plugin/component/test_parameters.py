"""Settings as MAVLink parameters: read, set, refused, in both encodings."""

from __future__ import annotations

import math
import struct

import pytest
from pydantic import BaseModel
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component.identity import ParameterEncoding
from gcs_plugin.component.parameter_protocol import decoded, encoded
from gcs_plugin.component.parameter_table import NOT_PARAMETERS, PARAMETER_NAMES, parameters, table_lines
from mission.settings import MissionSettings
from tests.support.component_bench import Bench, Message

REAL32, INT32, UINT8 = mavlink.MAV_PARAM_TYPE_REAL32, mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_UINT8
ENCODINGS: list[ParameterEncoding] = ["c-cast", "bytewise"]


def all_settings() -> set[str]:
    found = set()
    for name, entry in MissionSettings.model_fields.items():
        if isinstance(entry.default, BaseModel):
            found |= {f"{name}.{inner}" for inner in type(entry.default).model_fields}
        else:
            found.add(name)
    return {name for name in found if not name.startswith(("authority.", "tak.", "console."))}


def test_every_setting_is_a_parameter_or_said_to_be_none() -> None:
    assert set(PARAMETER_NAMES) | NOT_PARAMETERS == all_settings()
    assert not set(PARAMETER_NAMES) & NOT_PARAMETERS


def test_names_fit_and_differ() -> None:
    names = list(PARAMETER_NAMES.values())
    assert len(set(names)) == len(names)
    assert all(len(name) <= 16 and name == name.upper() for name in names)


def test_the_table_for_people_has_a_line_for_each() -> None:
    lines = table_lines()
    assert len(lines) == len(PARAMETER_NAMES) + 1
    assert any("PATTERN_KIND" in line and "0 out-and-back, 1 s, 2 paper" in line for line in lines)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(("number", "kind"), [(0.0, UINT8), (1.0, UINT8), (255.0, UINT8), (7.0, INT32), (2.5, REAL32)])
def test_a_number_comes_back_from_the_wire(number: float, kind: int, encoding: ParameterEncoding) -> None:
    (on_the_wire,) = struct.unpack("<f", struct.pack("<f", encoded(number, kind, encoding)))
    assert decoded(on_the_wire, kind, encoding) == number


def test_integers_travel_as_a_value_or_as_bytes() -> None:
    assert encoded(7.0, INT32, "c-cast") == 7.0
    assert struct.pack("<f", encoded(7.0, INT32, "bytewise")) == b"\x07\0\0\0"


def set_parameter(bench: Bench, name: str, value: float, kind: int, source: tuple[int, int] = (255, 190)) -> Message:
    bench.say(mavlink.MAVLink_param_set_message(1, 100, name.encode(), value, kind), source)
    bench.step()
    (answer,) = bench.take("PARAM_VALUE")
    return answer


def test_a_station_gets_the_whole_list_at_a_pace_that_a_radio_bears() -> None:
    bench = Bench()
    bench.say(mavlink.MAVLink_param_request_list_message(1, 0))
    counts = []
    for _ in range(30):
        bench.step(0.05)
        counts.append(len(bench.take("PARAM_VALUE")))
    assert sum(counts) == len(PARAMETER_NAMES)
    assert max(counts) <= 6


def test_a_list_asked_for_twice_starts_again() -> None:
    bench = Bench()
    for _ in range(2):
        bench.say(mavlink.MAVLink_param_request_list_message(1, 100))
        bench.step(0.05)
    for _ in range(30):
        bench.step(0.05)
    indices = [m.param_index for m in bench.take("PARAM_VALUE")]
    assert indices[-len(PARAMETER_NAMES) :] == list(range(len(PARAMETER_NAMES)))


def test_one_is_read_by_name_or_by_index() -> None:
    bench = Bench()
    bench.say(mavlink.MAVLink_param_request_read_message(1, 100, b"PATTERN_LENGTH_M", -1))
    bench.step()
    (by_name,) = bench.take("PARAM_VALUE")
    assert (by_name.param_id, by_name.param_value, by_name.param_type) == ("PATTERN_LENGTH_M", 3.0, REAL32)
    bench.say(mavlink.MAVLink_param_request_read_message(1, 100, b"", by_name.param_index))
    bench.step()
    (by_index,) = bench.take("PARAM_VALUE")
    assert by_index.param_id == "PATTERN_LENGTH_M"


@pytest.mark.parametrize("index", [-1, -32768, 32767, len(PARAMETER_NAMES)])
def test_one_that_there_is_not_is_not_answered(index: int) -> None:
    bench = Bench()
    bench.say(mavlink.MAVLink_param_request_read_message(1, 100, b"NO_SUCH", index))
    bench.step()
    assert bench.take("PARAM_VALUE") == []


def test_a_setting_is_set_for_the_next_flight() -> None:
    bench = Bench()
    assert set_parameter(bench, "PATTERN_LENGTH_M", 4.2, REAL32).param_value == pytest.approx(4.2)
    assert bench.component.settings.pattern.length_m == 4.2


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_choices_switches_and_whole_numbers_are_set(encoding: ParameterEncoding) -> None:
    bench = Bench(encoding=encoding)
    for name, number, kind in (("PATTERN_KIND", 1.0, UINT8), ("ANSWER_TEXT", 0.0, UINT8), ("REPEAT", 3.0, INT32)):
        set_parameter(bench, name, encoded(number, kind, encoding), kind)
    settings = bench.component.settings
    assert (settings.pattern.kind, settings.answer.statustext, settings.repeat) == ("s", False, 3)


def test_not_a_number_takes_an_optional_setting_away() -> None:
    bench = Bench()
    set_parameter(bench, "VIDEO_LATENCY_S", 0.2, REAL32)
    assert bench.component.settings.video.latency_s == 0.2
    set_parameter(bench, "VIDEO_LATENCY_S", math.nan, REAL32)
    assert bench.component.settings.video.latency_s is None


@pytest.mark.parametrize(
    ("name", "value", "kind", "old"),
    [
        ("PATTERN_LENGTH_M", 1000.0, REAL32, 3.0),
        ("PATTERN_LENGTH_M", math.nan, REAL32, 3.0),
        ("PATTERN_LENGTH_M", math.inf, REAL32, 3.0),
        ("PATTERN_LENGTH_M", 3.0, UINT8, 3.0),
        ("PATTERN_KIND", 3.0, UINT8, 0.0),
        ("PATTERN_KIND", 0.5, UINT8, 0.0),
        ("PATTERN_KIND", -1.0, mavlink.MAV_PARAM_TYPE_INT8, 0.0),
        ("ANSWER_TEXT", 2.0, UINT8, 1.0),
        ("REPEAT", 0.0, INT32, 1.0),
        ("REPEAT", 2.5, REAL32, 1.0),
        ("REPEAT", 2.0, 200, 1.0),
    ],
)
def test_a_bad_value_is_answered_with_the_old_one(name: str, value: float, kind: int, old: float) -> None:
    bench = Bench(encoding="c-cast")
    assert set_parameter(bench, name, value, kind).param_value == old
    assert bench.component.settings == MissionSettings()


def test_where_integers_are_cast_a_float_is_taken_for_a_whole_number() -> None:
    bench = Bench(encoding="c-cast")
    assert set_parameter(bench, "REPEAT", 4.0, REAL32).param_value == 4.0
    assert set_parameter(bench, "PATTERN_KIND", 1.0, REAL32).param_value == 1.0
    assert set_parameter(bench, "ANSWER_TEXT", 0.0, INT32).param_value == 0.0
    assert set_parameter(bench, "PATTERN_LENGTH_M", 4.0, INT32).param_value == 4.0
    assert (bench.component.settings.repeat, bench.component.settings.pattern.kind) == (4, "s")


def test_where_their_bytes_are_copied_a_float_is_not() -> None:
    bench = Bench()
    set_parameter(bench, "REPEAT", 4.0, REAL32)
    set_parameter(bench, "PATTERN_LENGTH_M", encoded(4.0, INT32, "bytewise"), INT32)
    assert bench.component.settings == MissionSettings()


def test_a_wider_limit_is_refused_and_the_station_is_told_why() -> None:
    bench = Bench()
    assert set_parameter(bench, "LIMITS_RADIUS_M", 500.0, REAL32).param_value == 15.0
    assert "LIMITS_RADIUS_M stays: the settings file allows at most 15" in bench.texts()
    assert set_parameter(bench, "LIMITS_RADIUS_M", 8.0, REAL32).param_value == 8.0
    assert set_parameter(bench, "LIMITS_RADIUS_M", 15.0, REAL32).param_value == 15.0


def test_a_stranger_may_read_but_not_set() -> None:
    bench = Bench()
    assert set_parameter(bench, "LIMITS_RADIUS_M", 400.0, REAL32, source=(77, 1)).param_value == 15.0
    assert bench.authority.counts["stranger"] == 1


def test_who_may_give_orders_is_not_a_parameter() -> None:
    assert not any(p.setting.startswith("authority") for p in parameters())
