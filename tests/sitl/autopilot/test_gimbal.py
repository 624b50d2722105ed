"""How the simulated gimbal moves and what it says: never kinder than real ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.gimbal import Gimbal, Target
from sitl.autopilot.gimbal_manager import GimbalManager
from sitl.autopilot.gimbal_settings import GimbalSettings
from sitl.autopilot.rotation import from_euler, to_euler, wrap

DT = 0.005


def run(
    gimbal: Gimbal, seconds: float, from_s: float = 0.0, heading: float = 0.5, roll: float = 0.0, off: float = 0.0
) -> float:
    steps = round(seconds / DT)
    for k in range(steps):
        now = from_s + DT * k
        gimbal.step(now, from_euler(roll, 0.0, heading), from_euler(roll, 0.0, heading + off))
    return from_s + DT * steps


def true_angles(gimbal: Gimbal) -> tuple[float, float, float]:
    return to_euler(gimbal.ned_from_gimbal)


def test_a_stabilised_lens_does_not_bank() -> None:
    gimbal = Gimbal(GimbalSettings(yaw_bias_deg=0.0), DT, 1, 0.5)
    run(gimbal, 2.0, roll=0.3)
    roll, pitch, yaw = true_angles(gimbal)
    assert math.degrees(roll) == pytest.approx(0.0, abs=0.2)
    assert math.degrees(pitch) == pytest.approx(-20.0, abs=0.2)
    assert yaw == pytest.approx(0.5, abs=0.01)


def test_told_to_look_north_it_looks_beside_it_by_its_bias() -> None:
    gimbal = Gimbal(GimbalSettings(yaw_bias_deg=6.0, tells="north"), DT, 1, 0.5)
    gimbal.target = Target(-0.4, 0.8, lock=True)
    now = run(gimbal, 3.0)
    assert math.degrees(wrap(true_angles(gimbal)[2] - 0.8)) == pytest.approx(-6.0, abs=0.2)
    report = gimbal.report(now)
    assert report is not None
    assert to_euler(report.reference_from_gimbal)[2] == pytest.approx(0.8, abs=0.01)


def test_from_the_nose_the_compass_s_error_comes_on_top() -> None:
    gimbal = Gimbal(GimbalSettings(yaw_bias_deg=3.0, tells="nose"), DT, 1, 0.5)
    gimbal.target = Target(-0.4, 0.8, lock=True)
    run(gimbal, 3.0, off=math.radians(4.0))
    assert math.degrees(wrap(true_angles(gimbal)[2] - 0.8)) == pytest.approx(-7.0, abs=0.2)


def test_angles_are_old_when_they_are_sent_and_come_at_their_own_rate() -> None:
    gimbal = Gimbal(GimbalSettings(rate_hz=10.0, age_ms=80.0), DT, 1, 0.5)
    times = []
    for k in range(400):
        gimbal.step(DT * k, from_euler(0, 0, 0.5), from_euler(0, 0, 0.5))
        report = gimbal.report(DT * k)
        if report is not None:
            assert DT * k - report.t_s >= 0.08 - 1e-9
            times.append(report.t_s)
    assert np.diff(np.unique(times)) == pytest.approx(0.1, abs=0.006)


def test_it_turns_no_faster_than_it_can_and_stops_at_its_stop() -> None:
    gimbal = Gimbal(GimbalSettings(rate_limit_deg_s=30.0, yaw_range_deg=(-60.0, 60.0), yaw_bias_deg=0.0), DT, 1, 0.0)
    gimbal.target = Target(0.0, math.radians(100.0), lock=True)
    run(gimbal, 1.0, heading=0.0)
    assert math.degrees(true_angles(gimbal)[2]) == pytest.approx(30.0, abs=1.0)
    now = run(gimbal, 4.0, 1.0, heading=0.0)
    assert math.degrees(true_angles(gimbal)[2]) == pytest.approx(60.0, abs=0.3)
    report = gimbal.report(now)
    assert report is not None
    assert report.stops[2]


def test_in_follow_it_lags_the_nose_and_in_lock_it_does_not_move() -> None:
    follow, lock = (Gimbal(GimbalSettings(yaw_bias_deg=0.0), DT, 1, 0.0) for _ in range(2))
    lock.target = Target(-0.3, 0.0, lock=True)
    for gimbal in (follow, lock):
        for k in range(200):
            heading = 0.5 * DT * k
            gimbal.step(DT * k, from_euler(0, 0, heading), from_euler(0, 0, heading))
    assert true_angles(follow)[2] < 0.5 * 1.0 - 0.1
    assert true_angles(lock)[2] == pytest.approx(0.0, abs=0.02)


def test_servos_turn_with_the_airframe_and_say_what_they_were_told() -> None:
    gimbal = Gimbal(GimbalSettings(kind="servo"), DT, 3, 0.5)
    now = run(gimbal, 3.0, roll=0.2)
    report = gimbal.report(now)
    assert report is not None
    assert to_euler(report.reference_from_gimbal)[0] == pytest.approx(-0.2, abs=1e-6)
    assert true_angles(gimbal)[0] != pytest.approx(0.0, abs=1e-4)


def test_faults() -> None:
    gimbal = Gimbal(GimbalSettings(), DT, 1, 0.5)
    now = run(gimbal, 1.0)
    gimbal.frozen = True
    now = run(gimbal, 0.5, now)
    before = gimbal.report(now)
    gimbal.target = Target(-1.0, 1.0, lock=True)
    now = run(gimbal, 2.0, now)
    assert gimbal.report(now) is before
    gimbal.silent = True
    assert gimbal.report(now) is None


def test_px4_denies_who_has_not_taken_control() -> None:
    us, them = (1, 100), (255, 190)
    angles = (-20.0, 30.0, math.nan, math.nan)
    px4 = GimbalManager(Gimbal(GimbalSettings(), DT, 1, 0.0), "px4")
    assert px4.pitch_yaw(us, angles, 16) == mavlink.MAV_RESULT_DENIED
    px4.configure(us, (1.0, 100.0, -1.0, -1.0))
    assert px4.pitch_yaw(us, angles, 16) == mavlink.MAV_RESULT_ACCEPTED
    px4.configure(them, (255.0, 190.0, -1.0, -1.0))
    assert px4.pitch_yaw(us, angles, 16) == mavlink.MAV_RESULT_DENIED
    px4.configure(us, (-3.0, -3.0, -1.0, -1.0))
    assert px4.primary == them
    px4.configure(them, (-3.0, -3.0, -1.0, -1.0))
    assert px4.primary == (0, 0)
    ardupilot = GimbalManager(Gimbal(GimbalSettings(), DT, 1, 0.0), "ardupilot")
    assert ardupilot.pitch_yaw(us, angles, 16) == mavlink.MAV_RESULT_ACCEPTED
    assert ardupilot.pitch_yaw(us, (math.nan, 30.0, math.nan, math.nan), 0) == mavlink.MAV_RESULT_FAILED
