"""The aircraft and its gimbal in lockstep: the flight is known beforehand, the gimbal is pointed as it goes along.

The nose keeps its heading; where the lens looks is the gimbal's matter alone. The gimbal's reports go through MAVLink's
own bytes into the mission's listener.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.gimbal.listener import GimbalListener
from mission.pose.buffer import Pose
from mission.records import Vector
from sitl.autopilot.flight_stack import TICK_S
from sitl.autopilot.gimbal import Gimbal, Target
from sitl.autopilot.gimbal_manager import GimbalManager
from sitl.autopilot.rotation import NED_FROM_ENU, Quat, multiply, wrap
from sitl.evaluation.rendered.aircraft import Flown
from sitl.field.case import FieldCase

BOOT_S: Final = 1000.0
"""The autopilot's clock at the flight's time zero."""
_ASKED_HZ: Final = 20.0
_AGE_S: Final = 0.05
"""What the camera file says of the gimbal's angles; nobody knows it better."""


class PointedGimbal:
    """The gimbal of one flight: `mission.vehicle.drone.CameraPointer` for who points it.

    Args:
        case: of the flight.
        flown: the aircraft's.
        begin_s: when it begins to be stepped.
        look: azimuth and elevation (rad) at which it is pointed at first, by its own idea of north.
    """

    ours = True
    lost = ""

    def __init__(self, case: FieldCase, flown: Flown, begin_s: float, look: tuple[float, float]) -> None:
        self._flown, self._now = flown, begin_s
        heading = _heading(_ned(flown.true_pose(begin_s)))
        self.gimbal = Gimbal(case.gimbal, TICK_S, case.seed, heading)
        self._manager = GimbalManager(self.gimbal, "px4")
        self.listener = GimbalListener(_AGE_S)
        self._parser, self._packer = mavlink.MAVLink(None), mavlink.MAVLink(None, 1, 1)
        self._due_s = begin_s
        self._true: list[tuple[float, Quat]] = []
        self.point(*look)

    def take(self) -> str:
        """It is ours."""
        return ""

    def release(self) -> None:
        """Nobody else wants it."""

    def point(self, azimuth_rad: float, elevation_rad: float) -> None:
        """As GIMBAL_MANAGER_SET_PITCHYAW with YAW_LOCK."""
        self.gimbal.target = Target(elevation_rad, wrap(azimuth_rad), lock=True)

    def advance(self, until_s: float) -> None:
        """Step it, and take in what it reports."""
        while self._now + TICK_S <= until_s + 1e-9:
            self._now += TICK_S
            true = self._flown.true_pose(self._now)
            told = self._flown.pose_at(self._now) or true
            self.gimbal.step(self._now, _ned(true), _ned(told))
            self._true.append((self._now, self.gimbal.world_from_gimbal))
            if self._now >= self._due_s:
                self._due_s += 1.0 / _ASKED_HZ
                message = self._manager.attitude_status(self._now, round(1e3 * (self._now + BOOT_S)))
                if message is not None:
                    self.listener.take(self._decoded(message), self._now)

    def at(self, t_s: float, *, hold_s: float = 0.0) -> Vector | None:
        """World_from_gimbal (4,) as the mission reads it at a time."""
        return self.listener.at(t_s, lambda now_s: now_s + BOOT_S, self._body_at, hold_s)

    def true_at(self, t_s: float) -> Vector:
        """World_from_gimbal (4,), to the step."""
        first = self._true[0][0]
        place = min(max(round((t_s - first) / TICK_S), 0), len(self._true) - 1)
        return np.array(self._true[place][1])

    def _body_at(self, boot_s: float) -> Vector | None:
        return self._flown.reported.attitude_at(boot_s - BOOT_S)

    def _decoded(self, message: Any) -> Any:
        return self._parser.decode(bytearray(message.pack(self._packer)))


def _ned(pose: Pose) -> Quat:
    w, x, y, z = pose.world_from_body_wxyz.tolist()
    return multiply(NED_FROM_ENU, (w, x, y, z))


def _heading(ned_from_body: Quat) -> float:
    w, x, y, z = ned_from_body
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
