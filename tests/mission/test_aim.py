import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.aim import LARGEST_RATE_RAD_S, LOOK_AHEAD_S, Aim, wrapped


@given(st.floats(-100.0, 100.0))
def test_wrapped_angles_lie_within_half_a_turn_and_point_the_same_way(angle: float) -> None:
    assert -math.pi <= wrapped(angle) < math.pi
    assert math.cos(wrapped(angle) - angle) == pytest.approx(1.0)


def test_there_is_no_heading_before_the_first_sighting() -> None:
    assert Aim().heading(1.0) is None


def test_a_still_target_is_aimed_at() -> None:
    aim = Aim()
    for k in range(40):
        aim.observe(0.7, 0.05 * k)
    assert aim.heading(2.0) == pytest.approx(0.7)


def test_a_moving_target_is_led() -> None:
    aim = Aim()
    rate = 0.5
    for k in range(60):
        aim.observe(rate * 0.05 * k, 0.05 * k)
    now = 0.05 * 59
    assert aim.heading(now) == pytest.approx(rate * (now + LOOK_AHEAD_S), abs=0.01)


def test_north_is_crossed_without_a_jump() -> None:
    aim = Aim()
    for k in range(60):
        aim.observe(wrapped(math.pi - 0.3 + 0.01 * k), 0.05 * k)
    heading = aim.heading(0.05 * 59)
    assert heading is not None
    assert abs(wrapped(heading - (math.pi - 0.3 + 0.01 * 59 + 0.2 * LOOK_AHEAD_S))) < 0.02


def test_a_late_azimuth_is_ignored() -> None:
    aim = Aim()
    aim.observe(0.1, 1.0)
    aim.observe(0.5, 0.5)
    assert aim.azimuth_rad == 0.1


def test_the_rate_is_bounded_whatever_is_seen() -> None:
    aim = Aim()
    for k in range(20):
        aim.observe(wrapped(2.0 * k), 0.01 * k)
    assert abs(aim.rate_rad_s) <= LARGEST_RATE_RAD_S


def test_a_camera_that_looks_sideways_shifts_the_heading() -> None:
    aim = Aim()
    aim.observe(1.0, 0.0)
    assert aim.heading(0.0, camera_azimuth_rad=0.25) == pytest.approx(0.75)


def test_a_cautious_aim_does_not_lead_and_follows_slowly() -> None:
    aim = Aim(cautious=True)
    for k in range(20):
        aim.observe(0.0, 0.05 * k)
    aim.observe(1.0, 1.0)
    heading = aim.heading(1.0)
    assert heading is not None
    assert 0.0 < heading < 0.1
    assert aim.rate_rad_s == 0.0


@given(st.floats(0.0, 0.6), st.floats(0.15, 0.6))
def test_a_cautious_aim_keeps_the_yaw_loop_stable_whatever_the_delay(delay_s: float, lag_s: float) -> None:
    """The loop with an aircraft of first order that sees the target with a delay that nobody corrected."""
    aim, dt = Aim(cautious=True), 0.05
    headings = [0.3] * 20
    ordered = 0.3
    for k in range(400):
        headings.append(headings[-1] + (ordered - headings[-1]) * (1.0 - math.exp(-dt / lag_s)))
        then = headings[-1 - round(delay_s / dt)]
        aim.observe(headings[-1] - then, dt * k)
        ordered = aim.heading(dt * k) or 0.0
    assert abs(headings[-1]) < 0.05
