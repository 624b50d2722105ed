"""Field flights: what is drawn, and that gimbal, aircraft and the mission's reading of both fit together."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from sitl.autopilot.gimbal_settings import GimbalSettings
from sitl.field.case import HEIGHTS_M, FieldCase, drawn_field_cases
from sitl.field.flight import BEGIN_S, FieldFlight
from sitl.field.outcome import fly_case

CASE = FieldCase(
    seed=3,
    height_m=20.0,
    slant_m=40.0,
    walks=None,
    noise="good",
    gimbal=GimbalSettings(yaw_bias_deg=5.0, tells="north"),
    offset_s=0.1,
    facing_deg=30.0,
)


def test_the_same_flight_whatever_the_count() -> None:
    cases = list(drawn_field_cases(12, 9, "good"))
    assert cases[8:] == list(drawn_field_cases(4, 9, "good", first=8))
    assert {case.height_m for case in cases} == set(HEIGHTS_M)
    for case in cases:
        assert case.slant_m <= 120.0
        assert case.height_m / case.slant_m <= math.sin(math.radians(70.1))


@pytest.mark.parametrize("tells", ["north", "nose", "nose-delta"])
def test_the_lens_is_read_where_it_is_but_for_its_bias(tells: str) -> None:
    settings = GimbalSettings.model_validate({"yaw_bias_deg": 5.0, "tells": tells})
    flight = FieldFlight(replace(CASE, gimbal=settings))
    flight.gimbal.advance(1.0)
    for t_s in (BEGIN_S, -1.0, 0.4):
        told = flight.gimbal.at(t_s)
        assert told is not None
        w, x, y, z = told
        a, b, c, d = flight.gimbal.true_at(t_s)
        off = math.atan2(w * w + x * x - y * y - z * z, 2 * (x * y + w * z)) - math.atan2(
            a * a + b * b - c * c - d * d, 2 * (b * c + a * d)
        )
        # The compass of a good autopilot is off by up to some degrees itself where yaw is from the nose.
        assert math.degrees(math.remainder(off, 2 * math.pi)) == pytest.approx(5.0, abs=0.5 if tells != "nose" else 8.0)


def test_the_person_is_in_the_first_picture() -> None:
    for case in drawn_field_cases(4, 11, "good"):
        view = FieldFlight(case).seen(BEGIN_S)
        assert view is not None
        assert view.in_picture


def test_a_whole_flight_finds_north_and_the_person() -> None:
    near = replace(CASE, height_m=10.0, slant_m=20.0, size_px=(640, 360), hfov_deg=55.0)
    found = fly_case(near)
    assert found.answered, found.said
    assert found.centred_share >= 0.9
    assert abs(found.slant_error) < 0.1
    assert found.nees < 14.0
    assert found.bias_deg == pytest.approx(5.0, abs=0.5)
    assert abs(found.north_error_deg) < max(1.5, 4.0 * found.north_sigma_deg)
    assert "degrees off" in found.said
