"""The aircraft as its autopilot knows it: the airframe, the errors of the state estimate, and the flight controller."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mission.records import Vector
from sitl.aircraft.truth import VehicleTruth
from sitl.autopilot.airframe import GRAVITY_M_S2, Airframe
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.estimate_errors import EstimateErrors, StateError
from sitl.autopilot.flavour import Flavour
from sitl.autopilot.flight_controller import Demand, EstimatedState, FlightController
from sitl.autopilot.rotation import FLU_FROM_FRD, NED_FROM_ENU, Quat, Vec, from_euler, multiply, to_euler
from sitl.gauss_markov import GaussMarkov

_FULL_PUSH_RAD_S = 0.15
"""Turning at this or faster, PX4 strays as far from its hover as it does."""
_YAW_GYRO_BIAS_RAD_S = math.radians(0.6)
"""Spread between aircraft of how fast the nose drifts while PX4 is asked for a yaw rate of 0 (hover; more at speed)."""


class Vehicle:
    """Advanced in steps of dt seconds by `step`; `estimate` is all that its software may use."""

    def __init__(self, config: AutopilotConfig, flavour: Flavour, dt: float, rng: np.random.Generator) -> None:
        self.dt = dt
        self._errors = EstimateErrors(config.preset, dt, rng)
        self._error: StateError = self._errors.step()
        self.airframe = Airframe(flavour.drag_n_s_m, config.wind, config.heading_rad, rng)
        bias = 0.0 if config.noise == "none" else _YAW_GYRO_BIAS_RAD_S * float(rng.standard_normal())
        self.controller = FlightController(
            flavour.gains, self.airframe.mass_kg, self.airframe.thrust_max_n, self.airframe.inertia, bias
        )
        wander = config.preset.turning_push
        self._push: GaussMarkov | None = None
        if flavour.name == "px4" and wander.sigma > 0.0:
            self._push = GaussMarkov((wander, wander), dt, np.random.default_rng((config.seed, 13)))
        self.euler: Vec = (0.0, 0.0, 0.0)
        """Estimated roll, pitch and heading."""
        self.ned_from_frd: Quat = (1.0, 0.0, 0.0, 0.0)
        """Estimated attitude as MAVLink sends it."""
        self.estimate = self._sense()

    @property
    def hover_thrust_n(self) -> float:
        """Thrust that carries the weight."""
        return self.airframe.mass_kg * GRAVITY_M_S2

    def step(self, demand: Demand | None, thrust_limit_n: float) -> None:
        """Follow a demand (None: motors idle or off) for dt, then estimate the new state."""
        if demand is None:
            self.controller.reset()
            self.airframe.step(self.dt, min(thrust_limit_n, 0.02 * self.airframe.thrust_max_n), (0.0, 0.0, 0.0))
        else:
            if self.airframe.grounded:
                self.controller.reset()
            thrust, moment = self.controller.step(self.estimate, self._pushed(demand), self.dt, thrust_limit_n)
            self.airframe.step(self.dt, thrust, moment)
        self._error = self._errors.step()
        self.estimate = self._sense()

    def _pushed(self, demand: Demand) -> Demand:
        """The demand with what turning does to a hover."""
        if self._push is None:
            return demand
        self._push.step()
        turning = min(1.0, abs(self.estimate.rates_flu[2]) / _FULL_PUSH_RAD_S)
        east, north = (turning * self._push.values).tolist()
        ae, an, au = demand.acceleration
        return replace(demand, acceleration=(ae + east, an + north, au))

    def place(self, position: Vec) -> None:
        """Put the aircraft somewhere, at rest and at hover thrust: a start in the air."""
        self.airframe.place(position)
        self.estimate = self._sense()

    def truth(self, t_s: float) -> VehicleTruth:
        """The true state, stamped."""
        attitude = multiply(self.airframe.world_from_flu, FLU_FROM_FRD)
        return VehicleTruth(
            t_s, _vector(self.airframe.position), _vector(self.airframe.velocity), np.array(attitude, dtype=np.float64)
        )

    def _sense(self) -> EstimatedState:
        body, error = self.airframe, self._error
        true = multiply(NED_FROM_ENU, multiply(body.world_from_flu, FLU_FROM_FRD))
        tilted = multiply(true, from_euler(error.roll, error.pitch, 0.0))
        self.ned_from_frd = multiply(from_euler(0.0, 0.0, error.heading), tilted)
        self.euler = to_euler(self.ned_from_frd)
        return EstimatedState(
            _sum(body.position, error.position),
            body.velocity if body.grounded else _sum(body.velocity, error.velocity),
            multiply(NED_FROM_ENU, multiply(self.ned_from_frd, FLU_FROM_FRD)),
            body.rates_flu,
            self.euler[2],
        )


def _sum(a: Vec, b: Vec) -> Vec:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _vector(v: Vec) -> Vector:
    return np.array(v, dtype=np.float64)
