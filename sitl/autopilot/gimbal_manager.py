"""The autopilot as its gimbal's manager (https://mavlink.io/en/services/gimbal_v2.html): who commands it, and messages.

PX4 denies every command of somebody who has not taken control by DO_GIMBAL_MANAGER_CONFIGURE; ArduPilot takes them from
anybody. ArduPilot always tells yaw from the nose (flag 32).
"""

from __future__ import annotations

import math
from typing import Any, Literal

from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.gimbal import Gimbal, Target
from sitl.autopilot.rotation import wrap

Source = tuple[int, int]
"""System and component."""

_LEVEL = mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
_LOCK: int = mavlink.GIMBAL_MANAGER_FLAGS_YAW_LOCK
_NOBODY: Source = (0, 0)


class GimbalManager:
    """Commands to one gimbal, and what is told of it.

    Args:
        gimbal: that is managed.
        flavour: whose rules hold.
    """

    def __init__(self, gimbal: Gimbal, flavour: Literal["px4", "ardupilot"]) -> None:
        self.gimbal = gimbal
        self._flavour = flavour
        self.primary: Source = _NOBODY

    def configure(self, source: Source, params: tuple[float, ...]) -> int:
        """DO_GIMBAL_MANAGER_CONFIGURE (1001)."""
        system, component = params[0], params[1]
        if system == -3.0:
            if self.primary == source:
                self.primary = _NOBODY
            return int(mavlink.MAV_RESULT_ACCEPTED)
        if system == -2.0:
            self.primary = source
        elif system >= 0.0 and component >= 0.0:
            self.primary = int(system), int(component)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def pitch_yaw(self, source: Source, params: tuple[float, ...], flags: int) -> int:
        """DO_GIMBAL_MANAGER_PITCHYAW (1000): degrees, degrees per second; NaN is not used."""
        if self._flavour == "px4" and source != self.primary:
            return int(mavlink.MAV_RESULT_DENIED)
        pitch, yaw, pitch_rate, yaw_rate = (math.radians(value) for value in params[:4])
        angles, rates = (all(map(math.isfinite, two)) for two in ((pitch, yaw), (pitch_rate, yaw_rate)))
        if not angles and not rates:
            return int(mavlink.MAV_RESULT_FAILED if self._flavour == "ardupilot" else mavlink.MAV_RESULT_DENIED)
        lock = bool(flags & _LOCK)
        if angles:
            self.gimbal.target = Target(pitch, wrap(yaw), lock)
        else:
            now = self.gimbal.target
            self.gimbal.target = Target(now.pitch, now.yaw, now.lock, pitch_rate, yaw_rate)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def set_pitch_yaw(self, source: Source, message: Any) -> None:
        """GIMBAL_MANAGER_SET_PITCHYAW (287): radians; nothing answers it."""
        degrees = [math.degrees(value) for value in (message.pitch, message.yaw, message.pitch_rate, message.yaw_rate)]
        self.pitch_yaw(source, tuple(degrees), int(message.flags))

    def attitude_status(self, now: float, boot_ms: int) -> Any | None:
        """GIMBAL_DEVICE_ATTITUDE_STATUS (285); None while it is silent."""
        report = self.gimbal.report(now)
        if report is None:
            return None
        roll, pitch, yaw = report.stops
        failures = (
            roll * mavlink.GIMBAL_DEVICE_ERROR_FLAGS_AT_ROLL_LIMIT
            | pitch * mavlink.GIMBAL_DEVICE_ERROR_FLAGS_AT_PITCH_LIMIT
            | yaw * mavlink.GIMBAL_DEVICE_ERROR_FLAGS_AT_YAW_LIMIT
        )
        return mavlink.MAVLink_gimbal_device_attitude_status_message(
            *(0, 0, boot_ms, self._flags(), list(report.reference_from_gimbal)),
            *(*report.rates, failures, report.delta_yaw, math.nan, 1),
        )

    def _flags(self) -> int:
        lock = _LOCK if self.gimbal.target.lock else 0
        tells = self.gimbal.settings.tells
        if self._flavour == "ardupilot":  # whatever the gimbal itself says, and for servos too
            return int(_LEVEL | lock | mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME)
        if self.gimbal.settings.kind == "servo":
            return int(lock)
        if tells == "north":
            return int(_LEVEL | lock | mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME)
        # Older firmware leaves it to the lock's rule; ours tells yaw from the nose, so it never says that it is locked.
        return int(_LEVEL if tells == "older" else _LEVEL | lock | mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME)

    def status(self, boot_ms: int) -> Any:
        """GIMBAL_MANAGER_STATUS (281)."""
        flags = _LEVEL | (_LOCK if self.gimbal.target.lock else 0)
        return mavlink.MAVLink_gimbal_manager_status_message(boot_ms, flags, 1, *self.primary, 0, 0)

    def information(self, boot_ms: int) -> Any:
        """GIMBAL_MANAGER_INFORMATION (280)."""
        pitch = [math.radians(angle) for angle in self.gimbal.settings.pitch_range_deg]
        yaw = [math.radians(angle) for angle in self.gimbal.settings.yaw_range_deg]
        return mavlink.MAVLink_gimbal_manager_information_message(boot_ms, 0x1FF, 1, 0.0, 0.0, *pitch, *yaw)
