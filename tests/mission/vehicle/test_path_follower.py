from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.vehicle.drone import Bounds, Knot, Path
from mission.vehicle.path_follower import check_path, setpoint_at

START = np.array([10.0, 20.0, -3.0])
EAST = Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(4.0, (4.0, 0, 0), (0, 0, 0))))


def _check(path: Path, bounds: Bounds | None = None, left_s: float = 60.0) -> str | None:
    return check_path(path, bounds or Bounds(), START, START, 0.0, left_s)


def test_setpoints_go_from_the_start_to_the_end_and_stay_there() -> None:
    assert setpoint_at(EAST, -1.0, START).position_ned_m == pytest.approx(START)
    assert setpoint_at(EAST, 2.0, START).position_ned_m == pytest.approx([10, 22, -3])
    assert setpoint_at(EAST, 2.0, START).velocity_ned_m_s == pytest.approx([0, 1.5, 0])
    late = setpoint_at(EAST, 99.0, START)
    assert late.position_ned_m == pytest.approx([10, 24, -3])
    assert late.velocity_ned_m_s == pytest.approx([0, 0, 0])


@given(t=st.floats(0.01, 3.98))
def test_the_velocity_is_the_derivative_of_the_position(t: float) -> None:
    h = 1e-5
    ahead, behind = setpoint_at(EAST, t + h, START), setpoint_at(EAST, t - h, START)
    slope = (ahead.position_ned_m - behind.position_ned_m) / (2 * h)
    assert setpoint_at(EAST, t, START).velocity_ned_m_s == pytest.approx(slope, abs=1e-5)


def test_a_path_may_start_at_full_speed() -> None:
    path = Path((Knot(0.0, (0, 0, 0), (0, 2.0, 0)), Knot(3.0, (0, 3.0, 0), (0, 0, 0))))
    assert setpoint_at(path, 0.0, START).velocity_ned_m_s == pytest.approx([2.0, 0, 0])
    assert _check(path) is None


@pytest.mark.parametrize(
    ("path", "bounds", "left_s", "says"),
    [
        (EAST, Bounds(radius_m=3.9), 60.0, "from where control was taken, more than 3.9 m"),
        (EAST, Bounds(max_speed_m_s=1.4), 60.0, "1.50 m/s, more than the allowed 1.40 m/s"),
        (EAST, Bounds(), 3.0, "takes 4.0 s, but 3.0 s are left"),
        (Path((Knot(0, (0, 0, 0), (0, 0, 0)), Knot(4, (0, 0, -2.5), (0, 0, 0)))), Bounds(), 60.0, "below 1.0 m"),
        (Path((Knot(0, (0, 0, 0), (0, 0, 0)), Knot(20, (0, 0, 28.0), (0, 0, 0)))), Bounds(), 60.0, "above 30.0 m"),
        (Path((Knot(0, (0, 0, 0), (0, 0, 0)),)), Bounds(), 60.0, "fewer than two knots"),
        (Path((Knot(0, (1, 0, 0), (0, 0, 0)), Knot(4, (0, 0, 0), (0, 0, 0)))), Bounds(), 60.0, "start at time 0"),
        (Path((Knot(0, (0, 0, 0), (0, 0, 0)), Knot(0, (0, 0, 0), (0, 0, 0)))), Bounds(), 60.0, "do not rise"),
        (Path((Knot(0, (0, 0, 0), (0, 0, 0)), Knot(4, (4, 0, 0), (1, 0, 0)))), Bounds(), 60.0, "end at rest"),
        (Path((Knot(0, (0, 0, 0), (0, 0, 0)), Knot(4, (math.nan, 0, 0), (0, 0, 0)))), Bounds(), 60.0, "not a number"),
    ],
)
def test_a_path_that_may_not_be_flown_says_why(path: Path, bounds: Bounds, left_s: float, says: str) -> None:
    reason = _check(path, bounds, left_s)
    assert reason is not None
    assert says in reason


def test_the_overshoot_between_two_harmless_knots_is_found() -> None:
    path = Path((Knot(0, (0, 0, 0), (2.9, 0, 0)), Knot(10, (1, 0, 0), (0, 0, 0))))
    assert "more than 3.0 m" in str(_check(path, Bounds(radius_m=3.0)))
