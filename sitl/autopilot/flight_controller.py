"""Position, velocity, attitude and rate loops, as PX4's and ArduPilot's multicopters have them.

Works on the estimated state only, so errors of the estimate become motion. ENU and forward-left-up inside; heading
clockwise from north.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from sitl.autopilot.airframe import GRAVITY_M_S2
from sitl.autopilot.rotation import Quat, Vec, conjugate, from_thrust_and_yaw, multiply, wrap

MaybeVec = tuple[float | None, float | None, float | None]
_NOTHING: MaybeVec = (None, None, None)


@dataclass(frozen=True, slots=True)
class EstimatedState:
    """What the autopilot believes: ENU, m and m/s; ENU from forward-left-up; rad/s; heading clockwise from north."""

    position: Vec
    velocity: Vec
    world_from_flu: Quat
    rates_flu: Vec
    heading: float


@dataclass(frozen=True, slots=True)
class Demand:
    """What the loops shall follow; None leaves an axis free (a free velocity axis with a position is 0)."""

    position: MaybeVec = _NOTHING
    velocity: MaybeVec = _NOTHING
    acceleration: Vec = (0.0, 0.0, 0.0)
    yaw: float | None = None
    """Heading, radians clockwise from north."""
    yaw_rate: float | None = None
    """rad/s, clockwise."""


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of the cascade: (horizontal, vertical) where there are two."""

    position_p: tuple[float, float]
    velocity_p: tuple[float, float]
    velocity_i: tuple[float, float]
    velocity_d: tuple[float, float]
    tilt_max_rad: float
    yaw_rate_max_rad_s: float
    climb_max_m_s: float
    descent_max_m_s: float
    speed_max_m_s: float
    holds_heading_at_zero_yaw_rate: bool
    attitude_p: float = 7.0
    rate_p: float = 18.0
    yaw_p: float = 2.8
    yaw_rate_p: float = 8.0


PX4_GAINS = Gains(
    position_p=(0.95, 1.0),  # MPC_XY_P, MPC_Z_P
    velocity_p=(1.8, 4.0),  # MPC_XY_VEL_P_ACC, MPC_Z_VEL_P_ACC
    velocity_i=(0.4, 2.0),
    velocity_d=(0.2, 0.0),
    tilt_max_rad=math.radians(45.0),
    yaw_rate_max_rad_s=math.radians(90.0),
    climb_max_m_s=3.0,
    descent_max_m_s=1.5,
    speed_max_m_s=12.0,
    holds_heading_at_zero_yaw_rate=False,
)
ARDUPILOT_GAINS = Gains(
    position_p=(1.0, 1.0),  # PSC_POSXY_P, PSC_POSZ_P
    velocity_p=(2.0, 5.0),
    velocity_i=(1.0, 2.0),
    velocity_d=(0.25, 0.0),
    tilt_max_rad=math.radians(30.0),
    yaw_rate_max_rad_s=math.radians(60.0),
    climb_max_m_s=2.5,
    descent_max_m_s=1.5,
    speed_max_m_s=10.0,
    holds_heading_at_zero_yaw_rate=True,
)


@dataclass(slots=True)
class FlightController:
    """The cascade and its memory (integrators, filtered derivative, heading being held)."""

    gains: Gains
    mass_kg: float
    thrust_max_n: float
    inertia: Vec
    yaw_gyro_bias_rad_s: float = 0.0
    """Turns the nose when only a yaw rate is asked and the autopilot does not hold the heading itself."""
    _integral: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    _last_velocity: Vec | None = None
    _slope: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    _held_heading: float | None = None

    def reset(self) -> None:
        """Forget all: on the ground."""
        self._integral = [0.0, 0.0, 0.0]
        self._last_velocity, self._held_heading = None, None

    def step(self, state: EstimatedState, demand: Demand, dt: float, thrust_limit_n: float) -> tuple[float, Vec]:
        """Thrust (N) and moments (N m, forward-left-up) that follow the demand."""
        acceleration = self._accelerate(state, demand, dt)
        heading, turn = self._aim(state, demand, dt)
        force = (acceleration[0], acceleration[1], acceleration[2] + GRAVITY_M_S2)
        wanted = from_thrust_and_yaw(force, math.pi / 2 - heading)
        error = multiply(conjugate(state.world_from_flu), wanted)
        sign = 2.0 if error[0] >= 0.0 else -2.0
        g = self.gains
        rate_x = g.attitude_p * sign * error[1]
        rate_y = g.attitude_p * sign * error[2]
        rate_z = g.yaw_p * sign * error[3] - turn
        rate_z = max(-g.yaw_rate_max_rad_s, min(g.yaw_rate_max_rad_s, rate_z))
        p, q, r = state.rates_flu
        yaw_moment = self.inertia[2] * g.yaw_rate_p * (rate_z - r)
        moment = (
            self.inertia[0] * g.rate_p * (rate_x - p),
            self.inertia[1] * g.rate_p * (rate_y - q),
            max(-0.08, min(0.08, yaw_moment)),  # what the rotors' drag can give beside the lift
        )
        w, x, y, z = state.world_from_flu
        lift = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
        thrust = self.mass_kg * sum(f * axis for f, axis in zip(force, lift, strict=True))
        return max(0.05 * self.thrust_max_n, min(0.95 * self.thrust_max_n, thrust, thrust_limit_n)), moment

    def _accelerate(self, state: EstimatedState, demand: Demand, dt: float) -> Vec:
        g = self.gains
        wanted: list[float | None] = []
        for i in range(3):
            feed, place = demand.velocity[i], demand.position[i]
            if place is None:
                wanted.append(feed)
            else:
                wanted.append((feed or 0.0) + g.position_p[i // 2] * (place - state.position[i]))
        east, north = wanted[0], wanted[1]
        if east is not None and north is not None and math.hypot(east, north) > g.speed_max_m_s:
            k = g.speed_max_m_s / math.hypot(east, north)
            wanted[0], wanted[1] = k * east, k * north
        if wanted[2] is not None:
            wanted[2] = max(-g.descent_max_m_s, min(g.climb_max_m_s, wanted[2]))
        last = self._last_velocity or state.velocity
        self._last_velocity = state.velocity
        out = [0.0, 0.0, 0.0]
        blend = dt / (dt + 0.03)
        for i in range(3):
            self._slope[i] += blend * ((state.velocity[i] - last[i]) / dt - self._slope[i])
            speed = wanted[i]
            out[i] = demand.acceleration[i]
            if speed is None:
                continue
            error = speed - state.velocity[i]
            limit = 4.0 if i < 2 else 6.0
            self._integral[i] = max(-limit, min(limit, self._integral[i] + g.velocity_i[i // 2] * error * dt))
            out[i] += g.velocity_p[i // 2] * error + self._integral[i] - g.velocity_d[i // 2] * self._slope[i]
        out[2] = max(-0.7 * GRAVITY_M_S2, min(0.8 * GRAVITY_M_S2, out[2]))
        level = math.hypot(out[0], out[1])
        most = math.tan(g.tilt_max_rad) * (GRAVITY_M_S2 + out[2])
        if level > most:
            out[0], out[1] = out[0] * most / level, out[1] * most / level
        return out[0], out[1], out[2]

    def _aim(self, state: EstimatedState, demand: Demand, dt: float) -> tuple[float, float]:
        """The heading to hold and the rate to turn at, clockwise."""
        if demand.yaw is not None:
            self._held_heading = None
            ahead = wrap(demand.yaw - state.heading)
            return state.heading + max(-0.6, min(0.6, ahead)), 0.0
        rate = demand.yaw_rate or 0.0
        if self.gains.holds_heading_at_zero_yaw_rate:
            if self._held_heading is None:
                self._held_heading = state.heading
            self._held_heading = wrap(self._held_heading + rate * dt)
            if abs(wrap(self._held_heading - state.heading)) > 0.5:  # the nose cannot follow: do not wind up
                self._held_heading = state.heading
            return self._held_heading, rate
        return state.heading, rate + self.yaw_gyro_bias_rad_s * (1.0 + math.hypot(*state.velocity[:2]))
