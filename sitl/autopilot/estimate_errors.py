"""How the autopilot's own estimate of its state strays from the truth.

The figures come from two recorded flights with their truth (tests/data/tlogs): the root-mean-square change of the error
over a lag L was fitted with Gauss-Markov processes. Position, velocity and heading errors rise with L at first (second
order: `(1 + L/tau) exp(-L/tau)` correlated), PX4's tilt errors with the root of L (first order, `exp(-L/tau)`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sitl.autopilot.rotation import Vec
from sitl.gauss_markov import STILL, GaussMarkov, Wander

NoiseName = Literal["good", "rough", "none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class NoisePreset:
    """Errors of an estimator, none by default: SI units and radians; offsets are drawn once a flight."""

    horizontal: Wander = STILL
    vertical: Wander = STILL
    horizontal_velocity: Wander = STILL
    vertical_velocity: Wander = STILL
    roll: Wander = STILL
    pitch: Wander = STILL
    heading: Wander = STILL
    position_offset_m: float = 0.0
    height_offset_m: float = 0.0
    heading_offset_rad: float = 0.0
    tilt_offset_rad: float = 0.0
    gnss_sigma_m: float = 0.0
    """Of GPS_RAW_INT, which is not filtered."""
    gnss_accuracy_m: Vec = (0.3, 0.3, 0.1)
    """What GPS_RAW_INT reports: horizontal and vertical accuracy, m, and speed accuracy, m/s."""
    home_altitude_sigma_m: float = 0.0
    """PX4 only: how far its home altitude jumps in the first two minutes of a flight."""


_DEG = math.radians(1.0)

PRESETS: dict[NoiseName, NoisePreset] = {
    "good": NoisePreset(
        horizontal=Wander(0.033, 1.0),
        vertical=Wander(0.030, 12.0, 1),
        horizontal_velocity=Wander(0.026, 1.0),
        vertical_velocity=Wander(0.006, 0.5),
        roll=Wander(0.06 * _DEG, 3.0),
        pitch=Wander(0.06 * _DEG, 3.0),
        heading=Wander(0.24 * _DEG, 1.4),
        position_offset_m=0.03,
        height_offset_m=0.03,
        heading_offset_rad=1.5 * _DEG,
        tilt_offset_rad=0.5 * _DEG,
        gnss_sigma_m=0.05,
        gnss_accuracy_m=(0.3, 0.3, 0.1),
        home_altitude_sigma_m=0.0,
    ),
    "rough": NoisePreset(
        horizontal=Wander(0.150, 1.5),
        vertical=Wander(0.070, 0.7),
        horizontal_velocity=Wander(0.220, 2.0),
        vertical_velocity=Wander(0.070, 0.7),
        roll=Wander(1.1 * _DEG, 5.5, 1),
        pitch=Wander(0.5 * _DEG, 6.0, 1),
        heading=Wander(2.2 * _DEG, 1.8),
        position_offset_m=0.3,
        height_offset_m=0.3,
        heading_offset_rad=1.5 * _DEG,
        tilt_offset_rad=1.0 * _DEG,
        gnss_sigma_m=0.5,
        gnss_accuracy_m=(0.9, 1.78, 0.4),
        home_altitude_sigma_m=0.6,
    ),
    "none": NoisePreset(),
}


@dataclass(frozen=True, slots=True)
class StateError:
    """Estimate minus truth: position and velocity ENU; tilt about the body's forward and right axes; heading."""

    position: Vec = (0.0, 0.0, 0.0)
    velocity: Vec = (0.0, 0.0, 0.0)
    roll: float = 0.0
    pitch: float = 0.0
    heading: float = 0.0


class EstimateErrors:
    """The errors of one flight, advanced in fixed steps."""

    def __init__(self, preset: NoisePreset, dt: float, rng: np.random.Generator) -> None:
        p = preset
        self._offset = np.zeros(9)
        self._offset[0:2] = p.position_offset_m * rng.standard_normal(2)
        self._offset[2] = p.height_offset_m * rng.standard_normal()
        self._offset[6:8] = p.tilt_offset_rad * rng.standard_normal(2)
        self._offset[8] = p.heading_offset_rad * rng.standard_normal()
        self._processes = GaussMarkov(
            (
                *(p.horizontal, p.horizontal, p.vertical),
                *(p.horizontal_velocity, p.horizontal_velocity, p.vertical_velocity),
                *(p.roll, p.pitch, p.heading),
            ),
            dt,
            rng,
        )

    def step(self) -> StateError:
        """Advance by one step and return the errors."""
        self._processes.step()
        e, n, u, ve, vn, vu, roll, pitch, heading = (self._processes.values + self._offset).tolist()
        return StateError((e, n, u), (ve, vn, vu), roll, pitch, heading)
