"""What a gimbal's report is measured from, by every row of the table of conventions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from mission.gimbal.attitude_history import in_world
from mission.gimbal.reading import GimbalReading, from_device_status, from_mount_orientation, from_mount_status
from mission.pose.buffer import world_from_body
from mission.records import Vector

LEVEL, LOCK, NOSE, NORTH = 4 + 8, 16, 32, 64
HEADING_DEG, ROLL_DEG, PITCH_DEG = 70.0, 12.0, -9.0
"""Of an aircraft that banks: whatever is measured from the horizon must not follow its roll and pitch."""
BODY = world_from_body(*np.radians([ROLL_DEG, PITCH_DEG, HEADING_DEG]))


def heard(message: Any) -> Any:
    return mavlink.MAVLink(None).decode(bytearray(message.pack(mavlink.MAVLink(None, 1, 1))))


def status(
    flags: int,
    yaw_deg: float = 25.0,
    pitch_deg: float = -30.0,
    delta_yaw: float = math.nan,
    failures: int = 0,
    rates: tuple[float, float, float] = (math.nan, math.nan, math.nan),
) -> Any:
    q = Rotation.from_euler("ZYX", [yaw_deg, pitch_deg, 0.0], degrees=True).as_quat(scalar_first=True)
    return heard(
        mavlink.MAVLink_gimbal_device_attitude_status_message(
            0, 0, 1234, flags, list(q), *rates, failures, delta_yaw, math.nan, 1
        )
    )


def looks(reading: GimbalReading | None, body: Vector | None = BODY) -> tuple[float, float, float]:
    """Azimuth clockwise from north, elevation, roll about the lens; degrees."""
    assert reading is not None
    turned = in_world(reading, body)
    assert turned is not None
    ahead, right = turned.apply([1.0, 0.0, 0.0]), turned.apply([0.0, 1.0, 0.0])
    azimuth, elevation = math.atan2(ahead[0], ahead[1]), math.asin(max(-1.0, min(1.0, ahead[2])))
    return math.degrees(azimuth), math.degrees(elevation), math.degrees(math.asin(-right[2]))


@pytest.mark.parametrize(
    ("flags", "delta_yaw_deg", "azimuth_deg", "explicit"),
    [
        (LEVEL | NOSE, math.nan, 25.0 + HEADING_DEG, True),
        (LEVEL | NOSE | LOCK, math.nan, 25.0 + HEADING_DEG, True),
        (LEVEL | NORTH, math.nan, 25.0, True),
        (LEVEL | NORTH | LOCK, math.nan, 25.0, True),
        (LEVEL | NORTH, 40.0, 25.0, True),
        (LEVEL | LOCK, math.nan, 25.0, False),
        (LEVEL, math.nan, 25.0 + HEADING_DEG, False),
        (LEVEL, 0.0, 25.0 + HEADING_DEG, False),
        (LEVEL, 40.0, 25.0 + HEADING_DEG, False),  # older firmware: what stands there means nothing
        (LEVEL | NOSE, 40.0, 25.0 + 40.0, True),  # the gimbal's own idea of the heading
        (LEVEL | NOSE, 0.0, 25.0 + HEADING_DEG, True),  # filled with zero
    ],
)
def test_yaw_is_from_where_the_flags_say(flags: int, delta_yaw_deg: float, azimuth_deg: float, explicit: bool) -> None:
    reading = from_device_status(status(flags, delta_yaw=math.radians(delta_yaw_deg)))
    assert looks(reading) == pytest.approx((azimuth_deg, -30.0, 0.0), abs=1e-4)
    assert reading is not None
    assert reading.explicit is explicit


def test_flags_that_say_both_say_nothing() -> None:
    assert from_device_status(status(LEVEL | NOSE | NORTH)) is None


def test_from_north_needs_no_aircraft() -> None:
    assert looks(from_device_status(status(LEVEL | NORTH)), None)[0] == pytest.approx(25.0, abs=1e-4)
    reading = from_device_status(status(LEVEL | NOSE))
    assert reading is not None
    assert in_world(reading, None) is None


@pytest.mark.parametrize(
    ("flags", "servo"), [(NOSE, False), (0, False), (LEVEL | NOSE, True), (LEVEL | NOSE | LOCK, True)]
)
def test_servos_turn_with_the_airframe(flags: int, servo: bool) -> None:
    reading = from_device_status(status(flags), servo=servo)
    expected = Rotation.from_quat(BODY, scalar_first=True) * Rotation.from_euler(
        "ZYX", [25.0, -30.0, 0.0], degrees=True
    )
    assert reading is not None
    turned = in_world(reading, BODY)
    assert turned is not None
    assert (turned.inv() * expected).magnitude() == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("q", [[0.0, 0.0, 0.0, 0.0], [math.nan] * 4, [2.0, 0.0, 0.0, 0.0]])
def test_no_quaternion_is_no_reading(q: list[float]) -> None:
    message = mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, 1, 44, q, 0.0, 0.0, 0.0, 0)
    assert from_device_status(heard(message)) is None


def test_straight_down_is_an_attitude_like_any_other() -> None:
    assert looks(from_device_status(status(LEVEL | NORTH, pitch_deg=-90.0)))[1] == pytest.approx(-90.0, abs=0.1)


def test_rates_and_stops_are_told() -> None:
    reading = from_device_status(status(LEVEL | NOSE, failures=4 | 2, rates=(0.1, 0.2, 0.3)))
    assert reading is not None
    assert reading.rate_rad_s == pytest.approx([0.1, 0.2, 0.3])
    assert reading.at_stop == "pitch and yaw"
    assert reading.boot_s == 1.234
    unknown = from_device_status(status(LEVEL | NOSE))
    assert unknown is not None
    assert unknown.rate_rad_s is None


def test_the_older_message_from_the_horizon() -> None:
    by_nose = from_mount_orientation(heard(mavlink.MAVLink_mount_orientation_message(5, 0.0, -30.0, 25.0)))
    assert looks(by_nose) == pytest.approx((25.0 + HEADING_DEG, -30.0, 0.0), abs=1e-4)
    by_north = from_mount_orientation(heard(mavlink.MAVLink_mount_orientation_message(5, 0.0, -30.0, 25.0, 110.0)))
    assert looks(by_north, None) == pytest.approx((110.0, -30.0, 0.0), abs=1e-4)
    invalid = mavlink.MAVLink_mount_orientation_message(5, math.nan, -30.0, 25.0)
    assert from_mount_orientation(heard(invalid)) is None


def test_the_oldest_message_from_the_airframe() -> None:
    reading = from_mount_status(heard(mavlink.MAVLink_mount_status_message(1, 1, -3000, 0, 2500)))
    assert reading is not None
    assert reading.reference == "airframe"
    assert looks(reading, world_from_body(0.0, 0.0, math.radians(HEADING_DEG))) == pytest.approx(
        (25.0 + HEADING_DEG, -30.0, 0.0), abs=1e-4
    )
