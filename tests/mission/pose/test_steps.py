"""Steps of a reported pose are found, undone and told; what aircraft really do is left alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.pose.buffer import PoseBuffer, heading, heading_rate, world_from_body
from mission.pose.steps import level_headings, level_positions
from mission.records import Matrix, NoiseModel, Vector

RATE_HZ = 50.0
T_S = np.arange(0.0, 8.0, 1.0 / RATE_HZ)


def flown() -> Matrix:
    """Out and back 3 m in 6 s with the reports' rounding to a centimetre, (n, 6)."""
    w = 2.0 * math.pi / 6.0
    along, speed = 1.5 * (1.0 - np.cos(w * T_S)), 1.5 * w * np.sin(w * T_S)
    zero = np.zeros_like(along)
    values = np.column_stack((along, zero, zero + 3.0, speed, zero, zero))
    values[:, :3] = np.round(values[:, :3], 2)
    values[:, 3:] = np.round(values[:, 3:], 2)
    return values


def attitudes(yaw_rad: Vector) -> Matrix:
    return np.array([world_from_body(0.05, -0.02, float(yaw)) for yaw in yaw_rad])


def unmeasured(yaw_rad: Vector) -> Matrix:
    """Attitudes without a measured rate."""
    return np.column_stack((attitudes(yaw_rad), np.full(len(yaw_rad), np.nan)))


@pytest.mark.parametrize("length_m", [0.3, 1.0, 3.0, 12.0])
@pytest.mark.parametrize("parts", [1, 2, 3])
@pytest.mark.parametrize("at", [50, 200, 330])
def test_a_position_step_is_undone(length_m: float, parts: int, at: int) -> None:
    true = flown()
    reported = true.copy()
    for part in range(parts):
        reported[at + part :, :3] += np.array([0.6, -0.8, 0.0]) * length_m / parts
    level, steps = level_positions(T_S, reported)
    assert steps == pytest.approx([length_m], rel=0.1, abs=0.05)
    shape = (level - level[-1])[:, :3] - (true - true[-1])[:, :3]
    assert np.abs(shape).max() < 0.06
    np.testing.assert_array_equal(level[-1], reported[-1])


def test_a_flight_without_steps_stays_as_it_is() -> None:
    level, steps = level_positions(T_S, flown())
    assert len(steps) == 0
    np.testing.assert_array_equal(level, flown())


def test_a_velocity_that_is_reset_with_the_position_does_no_harm() -> None:
    reported = flown()
    reported[200:, :3] += [1.0, 0.0, 0.0]
    reported[200:, 3] += 0.5
    _, steps = level_positions(T_S, reported)
    assert steps == pytest.approx([1.0], abs=0.05)


@pytest.mark.parametrize("step_deg", [5.0, 10.0, -45.0, 90.0])
def test_a_heading_step_is_undone(step_deg: float) -> None:
    yaw = 0.8 * np.sin(0.7 * T_S)
    reported = yaw + np.where(T_S >= 3.0, math.radians(step_deg), 0.0)
    level, steps = level_headings(T_S, unmeasured(reported))
    assert steps == pytest.approx([math.radians(abs(step_deg))], abs=0.02)
    found = np.unwrap([heading(q[:4]) for q in level])
    np.testing.assert_allclose(found - found[-1], yaw - yaw[-1], atol=0.02)


@pytest.mark.parametrize("step_deg", [5.0, 10.0, -45.0, 90.0])
@pytest.mark.parametrize("parts", [1, 2, 3])
@pytest.mark.parametrize("rate_hz", [50.0, 25.0, 10.0])
def test_a_heading_step_that_the_measured_rate_does_not_explain_is_undone(
    step_deg: float, parts: int, rate_hz: float
) -> None:
    t_s = np.arange(0.0, 8.0, 1.0 / rate_hz)
    yaw, rate = 0.8 * np.sin(0.7 * t_s), 0.56 * np.cos(0.7 * t_s)
    share = np.clip((np.arange(len(t_s)) - len(t_s) // 2) / parts, 0.0, 1.0)
    reported = np.column_stack((attitudes(yaw + share * math.radians(step_deg)), rate))
    level, steps = level_headings(t_s, reported)
    assert steps == pytest.approx([math.radians(abs(step_deg))], abs=0.02)
    found = np.unwrap([heading(q[:4]) for q in level])
    np.testing.assert_allclose(found - found[-1], yaw - yaw[-1], atol=0.02)


@pytest.mark.parametrize("rate_hz", [50.0, 10.0])
def test_a_fast_turn_at_its_measured_rate_is_no_step(rate_hz: float) -> None:
    t_s = np.arange(0.0, 8.0, 1.0 / rate_hz)
    values = np.column_stack((attitudes(2.0 * np.sin(1.5 * t_s)), 3.0 * np.cos(1.5 * t_s)))
    assert len(level_headings(t_s, values)[1]) == 0


def test_the_rate_of_the_heading_follows_from_the_body_rates() -> None:
    """Against the attitude's own change; banked and pitched."""
    roll, pitch, dt = 0.3, -0.2, 1e-5
    roll_rate, pitch_rate, yaw_rate = 0.2, -0.4, 0.7
    q = pitch_rate * math.cos(roll) + yaw_rate * math.sin(roll) * math.cos(pitch)
    r = -pitch_rate * math.sin(roll) + yaw_rate * math.cos(roll) * math.cos(pitch)
    assert heading_rate(roll, pitch, (q, r)) == pytest.approx(yaw_rate)
    after = world_from_body(roll + roll_rate * dt, pitch + pitch_rate * dt, 1.0 + yaw_rate * dt)
    turned = heading(after) - heading(world_from_body(roll, pitch, 1.0))
    assert turned / dt == pytest.approx(yaw_rate, abs=1e-4)


def test_a_fast_turn_is_no_step() -> None:
    _, steps = level_headings(T_S, unmeasured(np.clip(1.5 * (T_S - 2.0), 0.0, 2.0)))
    assert len(steps) == 0


def test_the_buffer_tells_what_it_undid_since_an_order() -> None:
    buffer = PoseBuffer()
    values = flown()
    values[100:, 0] += 2.0
    values[300:, 0] += 0.5
    for t_s, value in zip(T_S, values, strict=True):
        buffer.add_position(t_s, value[:3], value[3:])
        buffer.add_attitude(t_s, world_from_body(0.0, 0.0, 0.3))
    snapshot = buffer.snapshot()
    steps = snapshot.level(4.0)
    assert steps.position_m == pytest.approx(0.5, abs=0.05)
    assert "position stepped by 0.5 m (1 in all)" in steps.note()
    assert steps.widened(NoiseModel()).position_walk_m_per_sqrt_s > NoiseModel().position_walk_m_per_sqrt_s
    before, after = (poses.at(5.0, np.eye(3), np.eye(3)) for poses in (buffer, snapshot))
    assert before is not None
    assert after is not None
    assert after.position_enu_m[0] - before.position_enu_m[0] == pytest.approx(0.5, abs=0.05)


def test_one_missing_rate_makes_no_steps() -> None:
    values = np.column_stack((attitudes(0.8 * np.sin(0.7 * T_S)), 0.56 * np.cos(0.7 * T_S)))
    values[100, 4] = math.nan
    assert len(level_headings(T_S, values)[1]) == 0
