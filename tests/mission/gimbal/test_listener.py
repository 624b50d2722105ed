"""Which gimbal is read, and when its attitude is not to be believed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from mission.gimbal.listener import SILENT_S, GimbalListener
from mission.pose.buffer import heading, world_from_body
from mission.records import NoiseModel, Vector

FLAGS = 4 + 8 + 64


def status(t_s: float, yaw_deg: float, component: int = 1, device: int = 1, flags: int = FLAGS) -> Any:
    q = Rotation.from_euler("ZYX", [yaw_deg, -20.0, 0.0], degrees=True).as_quat(scalar_first=True)
    message = mavlink.MAVLink_gimbal_device_attitude_status_message(
        0, 0, round(1e3 * t_s), flags, list(q), math.nan, math.nan, math.nan, 0, math.nan, math.nan, device
    )
    return mavlink.MAVLink(None).decode(bytearray(message.pack(mavlink.MAVLink(None, 1, component))))


def same(t_s: float) -> float:
    return t_s


def level(t_s: float) -> Vector:
    return world_from_body(0.0, 0.0, 0.0)


def fed(until_s: float = 3.0, component: int = 1, clock_s: float = 0.0, wander_deg: float = 0.05) -> GimbalListener:
    listener, rng = GimbalListener(0.0), np.random.default_rng(1)
    for k in range(round(20 * until_s)):
        now = 1.0 + 0.05 * k
        yaw = 30.0 + wander_deg * float(rng.standard_normal())
        listener.take(status(now + clock_s, yaw, component), now)
    return listener


def test_nothing_is_known_before_the_first_report() -> None:
    listener = GimbalListener(0.0)
    assert "no gimbal tells" in listener.trouble(1.0)
    assert listener.at(1.0, same, level) is None


def test_the_autopilot_s_own_stamps_are_of_its_clock() -> None:
    listener = fed()
    turned = listener.at(1.0 + 1.03, same, level)
    assert turned is not None
    assert math.degrees(heading(turned)) == pytest.approx(30.0, abs=0.3)
    assert listener.trouble(3.95) == ""


def test_a_gimbal_with_a_clock_of_its_own() -> None:
    listener = fed(component=154, clock_s=500.0)
    assert listener.at(2.0, same, level) is not None
    assert listener.snapshot()(2.0, same, level) is not None


def test_silence_is_told() -> None:
    listener = fed(2.0)
    assert listener.trouble(2.95) == ""
    assert "has told no attitude for" in listener.trouble(2.95 + SILENT_S + 0.1)


def test_stamps_that_stand_still_are_silence() -> None:
    listener = fed(1.0)
    for k in range(40):
        listener.take(status(1.95, 30.0 + k), 2.0 + 0.05 * k)
    assert listener.trouble(4.0) != ""


def test_a_second_gimbal_is_not_mixed_in() -> None:
    listener = fed()
    listener.take(status(4.0, 120.0, component=155), 4.0)
    listener.take(status(4.0, 120.0, device=2), 4.0)
    turned = listener.at(3.9, same, level, hold_s=0.3)
    assert turned is not None
    assert math.degrees(heading(turned)) == pytest.approx(30.0, abs=0.3)


def test_the_better_message_is_taken_when_it_comes() -> None:
    listener = GimbalListener(0.0)
    old = mavlink.MAVLink_mount_orientation_message(1000, 0.0, -20.0, 90.0)
    decoded = mavlink.MAVLink(None).decode(bytearray(old.pack(mavlink.MAVLink(None, 1, 1))))
    listener.take(decoded, 1.0)
    assert listener.doubt(1.0)
    for k in range(41):
        listener.take(status(1.05 + 0.05 * k, 30.0 + 0.01 * (k % 3)), 1.05 + 0.05 * k)
        listener.take(decoded, 1.06 + 0.05 * k)
    turned = listener.at(2.0, same, level)
    assert turned is not None
    assert math.degrees(heading(turned)) == pytest.approx(30.0, abs=0.1)
    assert listener.doubt(3.0) == ""


def test_what_never_changes_is_not_measured() -> None:
    assert "do not change at all" in fed(wander_deg=0.0).doubt(4.0)
    assert fed().doubt(4.0) == ""


def test_older_flags_are_only_believed_with_pictures() -> None:
    listener = GimbalListener(0.0)
    for k in range(60):
        listener.take(status(1.0 + 0.05 * k, 30.0 + 0.01 * (k % 3), flags=12), 1.0 + 0.05 * k)
    assert "does not say" in listener.doubt(3.9)


def test_yaw_is_uncertain_and_the_horizon_is_not() -> None:
    aircraft = NoiseModel(tilt_bias_sigma_rad=math.radians(1.1), heading_sigma_rad=math.radians(2.0))
    noise = fed().noise(aircraft, 4.0)
    assert math.degrees(noise.heading_bias_sigma_rad) == pytest.approx(5.0)
    assert noise.heading_sigma_rad < math.radians(0.2)
    assert noise.tilt_bias_sigma_rad < aircraft.tilt_bias_sigma_rad
    servo = fed()
    servo.servo = True
    assert servo.noise(aircraft, 4.0).tilt_bias_sigma_rad > math.radians(2.9)
