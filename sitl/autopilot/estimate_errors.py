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
from numpy.typing import NDArray

from sitl.autopilot.rotation import Vec

NoiseName = Literal["good", "rough", "none"]


@dataclass(frozen=True, slots=True)
class Wander:
    """A stationary Gauss-Markov process of first or second order."""

    sigma: float
    tau_s: float
    order: Literal[1, 2] = 2


@dataclass(frozen=True, slots=True)
class NoisePreset:
    """Errors of an estimator: SI units and radians; offsets are drawn once a flight."""

    horizontal: Wander
    vertical: Wander
    horizontal_velocity: Wander
    vertical_velocity: Wander
    roll: Wander
    pitch: Wander
    heading: Wander
    position_offset_m: float
    height_offset_m: float
    heading_offset_rad: float
    tilt_offset_rad: float
    gnss_sigma_m: float
    """Of GPS_RAW_INT, which is not filtered."""
    gnss_accuracy_m: Vec
    """What GPS_RAW_INT reports: horizontal and vertical accuracy, m, and speed accuracy, m/s."""
    home_altitude_sigma_m: float
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
    "none": NoisePreset(
        horizontal=Wander(0.0, 1.0),
        vertical=Wander(0.0, 1.0),
        horizontal_velocity=Wander(0.0, 1.0),
        vertical_velocity=Wander(0.0, 1.0),
        roll=Wander(0.0, 1.0),
        pitch=Wander(0.0, 1.0),
        heading=Wander(0.0, 1.0),
        position_offset_m=0.0,
        height_offset_m=0.0,
        heading_offset_rad=0.0,
        tilt_offset_rad=0.0,
        gnss_sigma_m=0.0,
        gnss_accuracy_m=(0.3, 0.3, 0.1),
        home_altitude_sigma_m=0.0,
    ),
}


class GaussMarkov:
    """Several independent processes advanced together in fixed steps of dt; `values` has one entry for each."""

    def __init__(self, wanders: tuple[Wander, ...], dt: float, rng: np.random.Generator) -> None:
        self._rng = rng
        self._sigma = np.array([w.sigma for w in wanders])
        self._second = np.array([w.order == 2 for w in wanders])
        ratio = dt / np.array([w.tau_s for w in wanders])
        decay = np.exp(-ratio)
        # z1 drives z2, both with time constant tau; stationary covariance [[2, 1], [1, 1]] gives z2 unit variance.
        first_variance = np.where(self._second, 2.0, 1.0)
        self._keep = decay
        self._couple = np.where(self._second, decay * ratio, 0.0)
        q11 = first_variance * (1.0 - decay**2)
        q12 = np.where(self._second, 1.0 - decay**2 * (2.0 * ratio + 1.0), 0.0)
        q22 = np.where(self._second, 1.0 - decay**2 * (2.0 * ratio**2 + 2.0 * ratio + 1.0), 0.0)
        self._l11 = np.sqrt(q11)
        self._l21 = q12 / np.maximum(self._l11, 1e-30)
        self._l22 = np.sqrt(np.maximum(q22 - self._l21**2, 0.0))
        n = len(wanders)
        self._z1 = np.sqrt(first_variance) * rng.standard_normal(n)
        self._z2 = self._z1 / 2.0 + math.sqrt(0.5) * rng.standard_normal(n)

    @property
    def values(self) -> NDArray[np.float64]:
        """The processes now."""
        return self._sigma * np.where(self._second, self._z2, self._z1)

    def step(self) -> None:
        """Advance by dt."""
        w = self._rng.standard_normal((2, len(self._sigma)))
        z1 = self._z1
        self._z1 = self._keep * z1 + self._l11 * w[0]
        self._z2 = self._keep * self._z2 + self._couple * z1 + self._l21 * w[0] + self._l22 * w[1]


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
