import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.planning.aim import LARGEST_SPEED_M_S, Aim, presumed_range, wrapped

HERE = np.zeros(3)


@given(st.floats(-100.0, 100.0))
def test_wrapped_angles_lie_within_half_a_turn_and_point_the_same_way(angle: float) -> None:
    assert -math.pi <= wrapped(angle) < math.pi
    assert math.cos(wrapped(angle) - angle) == pytest.approx(1.0)


def test_there_is_no_azimuth_before_the_first_bearing() -> None:
    assert Aim().azimuth(1.0, HERE) is None


@given(st.floats(-3.1, 3.1))
def test_a_still_target_is_aimed_at(azimuth: float) -> None:
    aim = Aim()
    for k in range(40):
        aim.observe(azimuth, HERE, 0.05 * k)
    found = aim.azimuth(2.2, HERE)
    assert found is not None
    assert abs(wrapped(found - azimuth)) < 1e-9


def test_a_walking_target_is_led() -> None:
    aim = Aim(range_m=5.0)
    for k in range(80):
        aim.observe(math.atan2(0.6 * 0.05 * k, 5.0), HERE, 0.05 * k)
    found = aim.azimuth(0.05 * 79 + 0.4, HERE)
    assert found == pytest.approx(math.atan2(0.6 * (0.05 * 79 + 0.4), 5.0), abs=0.02)


@pytest.mark.parametrize("presumed", [0.7, 1.0, 1.4])
def test_flying_past_is_foreseen_although_the_distance_is_only_presumed(presumed: float) -> None:
    target = np.array([0.0, 3.0])
    aim = Aim(range_m=3.0 * presumed)
    worst = 0.0
    for k in range(60):
        t = 0.05 * k
        camera = np.array([-1.5 * t, 0.0, 1.5])
        away = target - camera[:2]
        aim.observe(math.atan2(*away), camera, t)
        later = camera + np.array([-1.5 * 0.4, 0.0, 0.0])
        found = aim.azimuth(t + 0.4, later)
        assert found is not None
        if k > 10:
            worst = max(worst, abs(wrapped(found - math.atan2(*(target - later[:2])))))
    assert worst < math.radians(8.0)


def test_a_late_bearing_is_ignored() -> None:
    aim = Aim()
    aim.observe(0.1, HERE, 1.0)
    aim.observe(0.5, HERE, 0.5)
    assert aim.azimuth(1.0, HERE) == pytest.approx(0.1)


def test_the_velocity_is_bounded_whatever_is_seen() -> None:
    aim = Aim()
    for k in range(20):
        aim.observe(wrapped(2.0 * k), HERE, 0.01 * k)
    assert np.linalg.norm(aim.velocity_m_s) <= LARGEST_SPEED_M_S + 1e-9


def test_a_cautious_aim_does_not_lead_and_follows_slowly() -> None:
    aim = Aim(cautious=True)
    for k in range(20):
        aim.observe(0.0, HERE, 0.05 * k)
    aim.observe(1.0, HERE, 1.0)
    found = aim.azimuth(1.0, HERE)
    assert found is not None
    assert 0.0 < found < 0.1
    assert not aim.velocity_m_s.any()


@given(st.floats(0.0, 0.6), st.floats(0.15, 0.6))
def test_a_cautious_aim_keeps_the_yaw_loop_stable_whatever_the_delay(delay_s: float, lag_s: float) -> None:
    """The loop with an aircraft of first order that sees the target with a delay that nobody corrected."""
    aim, dt = Aim(cautious=True), 0.05
    headings = [0.3] * 20
    ordered = 0.3
    for k in range(400):
        headings.append(headings[-1] + (ordered - headings[-1]) * (1.0 - math.exp(-dt / lag_s)))
        then = headings[-1 - round(delay_s / dt)]
        aim.observe(headings[-1] - then, HERE, dt * k)
        ordered = aim.azimuth(dt * k, HERE) or 0.0
    assert abs(headings[-1]) < 0.05


@given(st.floats(1.0, 2000.0))
def test_the_presumed_distance_is_always_possible(height_px: float) -> None:
    assert 1.5 <= presumed_range(height_px, 516.5) <= 200.0


def test_the_presumed_distance_follows_the_apparent_height() -> None:
    aim = Aim(range_m=3.0)
    for k in range(100):
        aim.observe(0.0, HERE, 0.05 * k, range_m=9.0)
    assert aim.point_m is not None
    assert float(np.linalg.norm(aim.point_m)) == pytest.approx(9.0, rel=0.05)
