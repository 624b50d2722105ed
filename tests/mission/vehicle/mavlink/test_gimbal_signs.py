"""Any sign of a gimbal is noticed, and only the vehicle's own."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.gimbal_signs import GIMBAL_MESSAGES, GimbalSigns
from mission.vehicle.state.modes import Autopilot

UPRIGHT = [1.0, 0.0, 0.0, 0.0]


def as_heard(message: Any, system: int = 1, component: int = 154) -> Any:
    return mavlink.MAVLink(None).decode(bytearray(message.pack(mavlink.MAVLink(None, system, component))))


def parameter(name: str, value: float, kind: int) -> Any:
    return mavlink.MAVLink_param_value_message(name.encode(), value, kind, 1, 0)


def whole(value: int) -> float:
    return float(struct.unpack("<f", struct.pack("<i", value))[0])


SIGNS = [
    (mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, 0, 12, UPRIGHT, 0.0, 0.0, 0.0, 0), "ATTITUDE_STATUS"),
    (mavlink.MAVLink_gimbal_manager_information_message(0, 0, 1, -1, 1, -1, 1, -3, 3), "MANAGER_INFORMATION"),
    (mavlink.MAVLink_gimbal_manager_status_message(0, 0, 1, 0, 0, 0, 0), "MANAGER_STATUS"),
    (mavlink.MAVLink_mount_orientation_message(0, 0.0, -10.0, 0.0), "MOUNT_ORIENTATION"),
    (mavlink.MAVLink_mount_status_message(1, 1, -1000, 0, 0), "MOUNT_STATUS"),
    (mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GIMBAL, 8, 0, 0, 4, 3), "component 154 is a gimbal"),
]


@pytest.mark.parametrize(("message", "text"), SIGNS)
def test_every_sign_counts(message: Any, text: str) -> None:
    signs = GimbalSigns()
    heard = as_heard(message)
    assert heard.get_type() in (*GIMBAL_MESSAGES, "HEARTBEAT")
    signs.take(heard, 1, "px4")
    assert text in signs.sign


@pytest.mark.parametrize(("message", "text"), SIGNS)
def test_another_vehicle_s_gimbal_is_none_of_ours(message: Any, text: str) -> None:
    signs = GimbalSigns()
    signs.take(as_heard(message, system=2), 1, "px4")
    assert signs.sign == ""


@pytest.mark.parametrize(
    ("autopilot", "message", "sign"),
    [
        ("ardupilot", parameter("MNT1_TYPE", 0.0, 2), ""),
        ("ardupilot", parameter("MNT1_TYPE", 1.0, 2), "MNT1_TYPE is 1"),
        ("ardupilot", parameter("MNT2_TYPE", 6.0, 2), "MNT2_TYPE is 6"),
        ("px4", parameter("MNT_MODE_IN", whole(-1), 6), ""),
        ("px4", parameter("MNT_MODE_IN", whole(0), 6), "MNT_MODE_IN is 0"),
        ("px4", parameter("MNT_MODE_IN", whole(4), 6), "MNT_MODE_IN is 4"),
        ("px4", parameter("GF_ACTION", whole(2), 6), ""),
        ("ardupilot", parameter("MNT1_TYPE", float("nan"), 9), ""),
    ],
)
def test_the_mount_parameters_count(autopilot: Autopilot, message: Any, sign: str) -> None:
    signs = GimbalSigns()
    signs.take(as_heard(message, component=1), 1, autopilot)
    assert signs.sign == sign


def test_other_heartbeats_are_no_sign() -> None:
    signs = GimbalSigns()
    for kind in (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_TYPE_GCS, mavlink.MAV_TYPE_CAMERA):
        signs.take(as_heard(mavlink.MAVLink_heartbeat_message(kind, 3, 0, 0, 4, 3), component=1), 1, "ardupilot")
    assert signs.sign == ""
