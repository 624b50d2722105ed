"""A jerk-limited reference that runs towards where it is told to go.

This is ArduPilot's kinematic input shaping (libraries/AP_Math/control.cpp: `shape_pos_vel_accel`, `shape_vel_accel`,
`sqrt_controller`), which its position controller uses everywhere; PX4's autonomous modes behave alike with their own
limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sitl.autopilot.flight_controller import Demand
from sitl.autopilot.rotation import Vec


@dataclass(frozen=True, slots=True)
class Limits:
    """What the reference may do."""

    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float
    climb_m_s: float
    descent_m_s: float
    vertical_acceleration_m_s2: float
    vertical_jerk_m_s3: float


PX4_LIMITS = Limits(5.0, 3.0, 4.0, 1.5, 0.7, 3.0, 4.0)
ARDUPILOT_LIMITS = Limits(5.0, 2.5, 5.0, 2.5, 0.5, 2.5, 5.0)


def sqrt_controller(error: float, p: float, second_derivative_limit: float) -> float:
    """Rate that removes an error: proportional near 0, then limited in how fast the rate itself may change."""
    linear = second_derivative_limit / (p * p)
    if abs(error) <= linear:
        return p * error
    return math.copysign(math.sqrt(2.0 * second_derivative_limit * (abs(error) - linear / 2.0)), error)


class Trajectory:
    """The reference's position, velocity and acceleration, ENU."""

    def __init__(self, limits: Limits, position: Vec, velocity: Vec) -> None:
        self.limits = limits
        self.position, self.velocity = list(position), list(velocity)
        self._acceleration = [0.0, 0.0, 0.0]

    def step(self, position: Vec | None, velocity: Vec, dt: float, climb_limit_m_s: float | None = None) -> None:
        """Advance towards a moving point; without a position only towards a velocity."""
        lim = self.limits
        wanted = list(velocity)
        if position is not None:
            error = (position[0] - self.position[0], position[1] - self.position[1])
            distance = math.hypot(*error)
            if distance > 0.0:
                p = 0.5 * lim.jerk_m_s3 / lim.acceleration_m_s2
                speed = min(lim.speed_m_s, sqrt_controller(distance, p, lim.acceleration_m_s2))
                wanted[0] += speed * error[0] / distance
                wanted[1] += speed * error[1] / distance
            p = 0.5 * lim.vertical_jerk_m_s3 / lim.vertical_acceleration_m_s2
            wanted[2] += sqrt_controller(position[2] - self.position[2], p, lim.vertical_acceleration_m_s2)
        speed = math.hypot(wanted[0], wanted[1])
        if speed > lim.speed_m_s:
            wanted[0], wanted[1] = wanted[0] * lim.speed_m_s / speed, wanted[1] * lim.speed_m_s / speed
        climb = lim.climb_m_s if climb_limit_m_s is None else climb_limit_m_s
        wanted[2] = max(-lim.descent_m_s, min(climb, wanted[2]))
        self._shape(wanted, dt)

    def demand(self, yaw: float | None, yaw_rate: float | None) -> Demand:
        """The reference as a demand on the flight controller."""
        x, y, z = self.position
        vx, vy, vz = self.velocity
        ax, ay, az = self._acceleration
        return Demand((x, y, z), (vx, vy, vz), (ax, ay, az), yaw, yaw_rate)

    def _shape(self, wanted: list[float], dt: float) -> None:
        """Slew the acceleration, within its limit, towards what reaches the wanted velocity."""
        lim = self.limits
        target = [0.0, 0.0, 0.0]
        error = (wanted[0] - self.velocity[0], wanted[1] - self.velocity[1])
        size = math.hypot(*error)
        if size > 0.0:
            p = lim.jerk_m_s3 / lim.acceleration_m_s2
            a = min(lim.acceleration_m_s2, sqrt_controller(size, p, lim.jerk_m_s3))
            target[0], target[1] = a * error[0] / size, a * error[1] / size
        p = lim.vertical_jerk_m_s3 / lim.vertical_acceleration_m_s2
        a = sqrt_controller(wanted[2] - self.velocity[2], p, lim.vertical_jerk_m_s3)
        target[2] = max(-lim.vertical_acceleration_m_s2, min(lim.vertical_acceleration_m_s2, a))
        for i in range(3):
            slew = (lim.jerk_m_s3 if i < 2 else lim.vertical_jerk_m_s3) * dt
            change = max(-slew, min(slew, target[i] - self._acceleration[i]))
            self._acceleration[i] += change
            self.position[i] += self.velocity[i] * dt + 0.5 * self._acceleration[i] * dt * dt
            self.velocity[i] += self._acceleration[i] * dt
