"""The aircraft: RotorPy's multirotor with an AR.Drone 2.0's drag, its sensors, and the loops that fly it.

A pilot's PCMD sets tilt angles, a climb rate and a turn rate; without the progressive bit the aircraft brakes and holds
its velocity, as its optical flow measures it, at zero: it hovers, and drifts with the flow's error.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from mission.records import Vector
from sitl.aircraft.truth import VehicleTruth
from sitl.ardrone.sensors import SensorErrors, SensorNoise, Sensors
from sitl.autopilot.airframe import GRAVITY_M_S2, Airframe, Wind
from sitl.autopilot.flight_controller import Demand, EstimatedState, FlightController, Gains
from sitl.autopilot.rotation import FLU_FROM_FRD, NED_FROM_ENU, Vec, from_euler, multiply, to_euler

DRAG_TIME_S = 1.25
"""Time in which drag takes 63 % of the speed. With `COMMAND_DELAY_S`, what makes full speed left at the standard
limit of 12 degrees follow the baselines of Kim & Yow 2015, Table II (0.25 m rms over 9.4 m; a test holds it)."""
COMMAND_DELAY_S = 0.2
"""From the arrival of a PCMD until the reference of the attitude loop moves."""
TILT_TIME_S = 0.1
"""Smoothing of that reference."""

_GAINS = Gains(
    position_p=(0.0, 1.2),
    velocity_p=(2.0, 4.0),
    velocity_i=(0.6, 2.0),
    velocity_d=(0.1, 0.0),
    tilt_max_rad=0.52,
    yaw_rate_max_rad_s=6.11,
    climb_max_m_s=2.0,
    descent_max_m_s=2.0,
    speed_max_m_s=10.0,
    holds_heading_at_zero_yaw_rate=True,
)


class Aircraft:
    """Advanced by `step` in fixed steps; `estimate` and `errors` are all that its software may use.

    Args:
        noise: sizes of the sensors' errors.
        wind: the air's motion.
        heading_rad: where the nose points at the start, clockwise from true north.
        dt: one step, seconds.
        rng: for gusts and sensors.
    """

    def __init__(self, noise: SensorNoise, wind: Wind, heading_rad: float, dt: float, rng: np.random.Generator) -> None:
        self.dt = dt
        self.sensors = Sensors(noise, dt, rng)
        self.errors: SensorErrors = self.sensors.step()
        # The airframe weighs 1 kg; only the ratio of drag to mass shows in its motion.
        self._airframe = Airframe(1.0 / DRAG_TIME_S, wind, heading_rad, rng)
        a = self._airframe
        self._controller = FlightController(_GAINS, a.mass_kg, a.thrust_max_n, a.inertia)
        self._delayed: deque[tuple[float, float]] = deque([(0.0, 0.0)] * max(1, round(COMMAND_DELAY_S / dt)))
        self._tilt = (0.0, 0.0)
        self.euler: Vec = (0.0, 0.0, 0.0)
        """Estimated roll, pitch and heading (true north plus the compass's error), radians."""
        self.flow: tuple[float, float] = (0.0, 0.0)
        """Estimated velocity forward and right, level, m/s."""
        self.estimate = self._sense()

    @property
    def grounded(self) -> bool:
        """Whether it stands on the ground."""
        return self._airframe.grounded

    @property
    def position_enu_m(self) -> Vec:
        """Where it truly is."""
        return self._airframe.position

    @property
    def velocity_enu_m_s(self) -> Vec:
        """How it truly moves."""
        return self._airframe.velocity

    @property
    def true_tilt_rad(self) -> float:
        """Angle between its axis and the vertical."""
        _, x, y, _ = self._airframe.world_from_flu
        return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y))))

    def idle(self) -> None:
        """Let dt pass with the motors off (or cut, in the air)."""
        self._controller.reset()
        self._airframe.step(self.dt, 0.0 if self.grounded else 0.02 * self._airframe.thrust_max_n, (0.0, 0.0, 0.0))
        self._after()

    def hover(self, *, height_m: float | None, climb_m_s: float = 0.0, yaw_rate_rad_s: float = 0.0) -> None:
        """Let dt pass braking or hovering, at a height or with a climb rate."""
        self._delay(0.0, 0.0)
        self._fly(
            Demand(
                position=(None, None, height_m),
                velocity=(0.0, 0.0, None if height_m is not None else climb_m_s),
                yaw_rate=yaw_rate_rad_s,
            )
        )

    def tilt(
        self, roll_rad: float, pitch_rad: float, *, height_m: float | None, climb_m_s: float, yaw_rate_rad_s: float
    ) -> None:
        """Let dt pass with tilt angles (right and nose up positive), a climb rate or a height, and a turn rate."""
        roll, pitch = self._delay(roll_rad, pitch_rad)
        heading = self.euler[2]
        forward, right = -GRAVITY_M_S2 * math.tan(pitch), GRAVITY_M_S2 * math.tan(roll)
        s, c = math.sin(heading), math.cos(heading)
        self._fly(
            Demand(
                position=(None, None, height_m),
                velocity=(None, None, None if height_m is not None else climb_m_s),
                acceleration=(forward * s + right * c, forward * c - right * s, 0.0),
                yaw_rate=yaw_rate_rad_s,
            )
        )

    def truth(self, t_s: float) -> VehicleTruth:
        """The true state, stamped."""
        a = self._airframe
        attitude = multiply(a.world_from_flu, FLU_FROM_FRD)
        return VehicleTruth(t_s, _array(a.position), _array(a.velocity), np.array(attitude, dtype=np.float64))

    def place(self, position_enu_m: Vec) -> None:
        """Put the aircraft somewhere, at rest and at hover thrust: a start in the air."""
        self._airframe.place(position_enu_m)
        self.estimate = self._sense()

    def _delay(self, roll_rad: float, pitch_rad: float) -> tuple[float, float]:
        self._delayed.append((roll_rad, pitch_rad))
        wanted = self._delayed.popleft()
        blend = 1.0 - math.exp(-self.dt / TILT_TIME_S)
        self._tilt = (
            self._tilt[0] + blend * (wanted[0] - self._tilt[0]),
            self._tilt[1] + blend * (wanted[1] - self._tilt[1]),
        )
        return self._tilt

    def _fly(self, demand: Demand) -> None:
        if self.grounded:
            self._controller.reset()
        thrust, moment = self._controller.step(self.estimate, demand, self.dt, self._airframe.thrust_max_n)
        self._airframe.step(self.dt, thrust, moment)
        self._after()

    def _after(self) -> None:
        self.errors = self.sensors.step()
        self.estimate = self._sense()

    def _sense(self) -> EstimatedState:
        body, error = self._airframe, self.errors
        true = multiply(NED_FROM_ENU, multiply(body.world_from_flu, FLU_FROM_FRD))
        tilted = multiply(true, from_euler(error.roll_rad, error.pitch_rad, 0.0))
        ned_from_frd = multiply(from_euler(0.0, 0.0, error.heading_rad), tilted)
        self.euler = to_euler(ned_from_frd)
        true_heading = to_euler(true)[2]
        s, c = math.sin(true_heading), math.cos(true_heading)
        east, north, up = body.velocity
        if body.grounded:
            self.flow, climb = (0.0, 0.0), 0.0
        else:
            forward = (1.0 + error.flow_scale) * (east * s + north * c) + error.flow_m_s[0]
            right = (1.0 + error.flow_scale) * (east * c - north * s) + error.flow_m_s[1]
            self.flow, climb = (forward, right), up + error.climb_m_s
        # The loops work in the frame of the aircraft's own heading.
        s, c = math.sin(self.euler[2]), math.cos(self.euler[2])
        forward, right = self.flow
        return EstimatedState(
            position=(0.0, 0.0, body.position[2] + error.height_m),
            velocity=(forward * s + right * c, forward * c - right * s, climb),
            world_from_flu=multiply(NED_FROM_ENU, multiply(ned_from_frd, FLU_FROM_FRD)),
            rates_flu=body.rates_flu,
            heading=self.euler[2],
        )


def _array(v: Vec) -> Vector:
    return np.array(v, dtype=np.float64)
