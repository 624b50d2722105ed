"""From a setpoint to tilt: the AR.Drone takes no positions, so position and velocity are held here, on dead reckoning.

A cascade: position error -> velocity, velocity error -> acceleration -> tilt (a = g tan(tilt) - drag v). The path's own
acceleration is fed forward. The integral of the velocity error takes up wind and a trim that is off, and is small.
"""

from __future__ import annotations

import math

import numpy as np

from mission.records import Vector
from mission.vehicle.ardrone.at import Tilt, clamped
from mission.vehicle.ardrone.config import FlightConfig
from mission.vehicle.path_follower import Setpoint
from mission.vehicle.state.vehicle_state import LocalState

POSITION_GAIN = 1.0
"""1/s."""
VELOCITY_GAIN = 2.0
"""1/s; the attitude follows within some 0.2 s, so that this is damped."""
INTEGRAL_GAIN = 0.4
"""1/s2."""
MAX_INTEGRAL_M_S2 = 1.0
DRAG_PER_S = 0.3
"""Deceleration by drag over speed, for the speed that is wanted: a guess that the integral corrects."""
MAX_CORRECTION_M_S = 1.5
MAX_FEED_FORWARD_M_S2 = 4.0
HEIGHT_GAIN = 1.2
"""1/s."""
YAW_GAIN = 2.5
"""1/s."""
_GRAVITY_M_S2 = 9.81
_MAX_STEP_S = 0.1
_SMOOTHING_S = 0.04


class TiltControl:
    """Holds a setpoint by tilt; one for each time that control is taken.

    Args:
        config: what the shares of AT*PCMD are of.
    """

    def __init__(self, config: FlightConfig) -> None:
        self._config = config
        self._integral_m_s2 = np.zeros(2)
        self._last_s: float | None = None
        self._feed_m_s2 = np.zeros(2)
        self._fed: tuple[float, Vector] | None = None

    def feed(self, setpoint: Setpoint, now_s: float) -> None:
        """Take in each new setpoint: how its velocity changes is the acceleration that the path itself needs."""
        velocity = setpoint.velocity_ned_m_s[:2].copy()
        last, self._fed = self._fed, (now_s, velocity)
        dt = 0.0 if last is None else now_s - last[0]
        if last is None or not 0.0 < dt < _MAX_STEP_S:
            self._feed_m_s2 = np.zeros(2)
            return
        change = _limited((velocity - last[1]) / dt, MAX_FEED_FORWARD_M_S2)
        self._feed_m_s2 = self._feed_m_s2 + (1.0 - math.exp(-dt / _SMOOTHING_S)) * (change - self._feed_m_s2)

    def tilt(self, setpoint: Setpoint, yaw_rad: float, local: LocalState, heading_rad: float, now_s: float) -> Tilt:
        """The command for now.

        Args:
            setpoint: where to be and how fast, north-east-down.
            yaw_rad: heading to keep.
            local: where the drone is and how fast, in the same frame.
            heading_rad: where its nose points.
            now_s: program time.
        """
        dt = 0.0 if self._last_s is None else min(_MAX_STEP_S, max(0.0, now_s - self._last_s))
        self._last_s = now_s
        off = setpoint.position_ned_m - local.position_ned_m
        wanted = setpoint.velocity_ned_m_s[:2] + _limited(POSITION_GAIN * off[:2], MAX_CORRECTION_M_S)
        error = wanted - local.velocity_ned_m_s[:2]
        push = self._feed_m_s2 + VELOCITY_GAIN * error + DRAG_PER_S * wanted + self._integral_m_s2
        most = self._config.euler_angle_max_rad
        if float(np.linalg.norm(push)) < _GRAVITY_M_S2 * math.tan(most):
            # Not beyond what it can tilt: it would wind up.
            self._integral_m_s2 = _limited(self._integral_m_s2 + INTEGRAL_GAIN * error * dt, MAX_INTEGRAL_M_S2)
        north, east = push
        sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
        forward, right = north * cosine + east * sine, east * cosine - north * sine
        climb = -float(setpoint.velocity_ned_m_s[2]) - HEIGHT_GAIN * float(off[2])
        turn = YAW_GAIN * math.remainder(yaw_rad - heading_rad, math.tau)
        return Tilt(
            roll=clamped(math.atan2(right, _GRAVITY_M_S2) / most),
            pitch=clamped(-math.atan2(forward, _GRAVITY_M_S2) / most),
            gaz=clamped(climb / self._config.control_vz_max_m_s),
            yaw=clamped(turn / self._config.control_yaw_rad_s),
        )


def _limited(vector: Vector, most: float) -> Vector:
    length = float(np.linalg.norm(vector))
    return vector if length <= most else vector * (most / length)
