"""One report of a gimbal's attitude: what its numbers are measured from, by every convention that is in use.

GIMBAL_DEVICE_ATTITUDE_STATUS (https://mavlink.io/en/services/gimbal_v2.html): the quaternion turns the horizontal frame
(roll and pitch from the horizon, not from the airframe) into the gimbal. Only its yaw has two possible zero points:

| flags | yaw is from |
|---|---|
| 32 YAW_IN_VEHICLE_FRAME | the vehicle's nose |
| 64 YAW_IN_EARTH_FRAME | north |
| neither, 16 YAW_LOCK set | north (older firmware) |
| neither, YAW_LOCK not set | the vehicle's nose (older firmware) |

`delta_yaw` is the gimbal's own idea of the vehicle's heading. Older firmware fills it with zeros, so it counts only
beside one of the two explicit flags. A mount of plain servos knows no horizon: ArduPilot's (MNT1_TYPE = 1) reports what
it commands, from the airframe.

Gimbal axes are forward (along the lens), right, down; north-east-down where the yaw is from north.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from mission.records import Vector

Reference = Literal["north", "heading", "airframe"]
"""north: north-east-down. heading: the same turned to the nose's heading, level. airframe: the body itself."""

_LOCKED_LEVEL = mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
_FROM_NOSE = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
_FROM_NORTH = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME
_YAW_LOCK = mavlink.GIMBAL_DEVICE_FLAGS_YAW_LOCK
_MOST_TILT_RAD = math.radians(180.0)
_STOPS = {
    mavlink.GIMBAL_DEVICE_ERROR_FLAGS_AT_ROLL_LIMIT: "roll",
    mavlink.GIMBAL_DEVICE_ERROR_FLAGS_AT_PITCH_LIMIT: "pitch",
    mavlink.GIMBAL_DEVICE_ERROR_FLAGS_AT_YAW_LIMIT: "yaw",
}


@dataclass(frozen=True, slots=True, eq=False)
class GimbalReading:
    """One report."""

    boot_s: float | None
    """By the sender's own clock; None where it tells no time."""
    reference: Reference
    """What `turned_wxyz` is measured from."""
    turned_wxyz: Vector
    """(4,), unit: reference_from_gimbal."""
    rate_rad_s: Vector | None
    """(3,) about the gimbal's forward, right and down axes; None where it is not told."""
    explicit: bool
    """Whether the message says what its yaw is from; older firmware leaves that to a rule."""
    at_stop: str = ""
    """Axes that are at their mechanical limit."""


def from_device_status(message: Any, *, servo: bool = False) -> GimbalReading | None:
    """GIMBAL_DEVICE_ATTITUDE_STATUS (285); None where it holds no attitude or contradicts itself.

    Args:
        message: of pymavlink.
        servo: the mount is of plain servos, whose angles are from the airframe whatever the flags say.
    """
    turned = _unit(message.q)
    if turned is None:
        return None
    flags = int(message.flags)
    if flags & _FROM_NOSE and flags & _FROM_NORTH:
        return None  # says both; nobody knows which
    explicit = bool(flags & (_FROM_NOSE | _FROM_NORTH))
    from_north = bool(flags & _FROM_NORTH) if explicit else bool(flags & _YAW_LOCK)
    reference: Reference = "north" if from_north else "heading"
    if servo or (reference == "heading" and not flags & _LOCKED_LEVEL):
        reference = "airframe"
    heading = float(getattr(message, "delta_yaw", math.nan))
    if explicit and reference == "heading" and math.isfinite(heading) and heading != 0.0:
        turned = _wxyz(Rotation.from_rotvec([0.0, 0.0, heading]) * Rotation.from_quat(turned, scalar_first=True))
        reference = "north"
    rate = np.array([message.angular_velocity_x, message.angular_velocity_y, message.angular_velocity_z], dtype=float)
    stops = [axis for bit, axis in _STOPS.items() if int(message.failure_flags) & bit]
    return GimbalReading(
        _boot_s(message),
        reference,
        turned,
        rate if np.isfinite(rate).all() else None,
        explicit,
        " and ".join(stops),
    )


def from_mount_orientation(message: Any) -> GimbalReading | None:
    """MOUNT_ORIENTATION (265): roll and pitch from the horizon, yaw from the nose or, where it is told, from north."""
    absolute = float(getattr(message, "yaw_absolute", math.nan))
    # Older firmware, and MAVLink 1, leave the extension out, which decodes as zero: due north by chance is not taken.
    from_north = math.isfinite(absolute) and absolute != 0.0
    yaw = absolute if from_north else message.yaw
    turned = _from_euler_deg(message.roll, message.pitch, yaw)
    if turned is None:
        return None
    return GimbalReading(_boot_s(message), "north" if from_north else "heading", turned, None, explicit=from_north)


def from_mount_status(message: Any) -> GimbalReading | None:
    """MOUNT_STATUS (158): pitch, roll and yaw of a servo mount in hundredths of a degree, from the airframe."""
    turned = _from_euler_deg(message.pointing_b * 0.01, message.pointing_a * 0.01, message.pointing_c * 0.01)
    return None if turned is None else GimbalReading(None, "airframe", turned, None, explicit=False)


def _unit(q: Any) -> Vector | None:
    turned = np.array(q, dtype=float)
    length = float(np.linalg.norm(turned))
    return turned / length if 0.9 < length < 1.1 else None


def _from_euler_deg(roll: float, pitch: float, yaw: float) -> Vector | None:
    if not all(
        math.isfinite(angle) and abs(angle) <= 2.0 * math.degrees(_MOST_TILT_RAD) for angle in (roll, pitch, yaw)
    ):
        return None
    return _wxyz(Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True))


def _wxyz(turned: Rotation) -> Vector:
    return np.asarray(turned.as_quat(scalar_first=True), dtype=np.float64)


def _boot_s(message: Any) -> float | None:
    return message.time_boot_ms * 1e-3 if message.time_boot_ms > 0 else None
