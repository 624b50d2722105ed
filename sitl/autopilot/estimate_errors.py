"""How the autopilot's own estimate of its state strays from the truth.

The figures come from two recorded flights with their truth (tests/data/tlogs): the root-mean-square change of the error
over a lag L was fitted with Gauss-Markov processes. Position, velocity and heading errors rise with L at first (second
order: `(1 + L/tau) exp(-L/tau)` correlated), PX4's tilt errors with the root of L (first order, `exp(-L/tau)`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from sitl.autopilot.rotation import Vec
from sitl.autopilot.wide_family import (
    CLAIM_RANGE,
    COMPASS_OFF_RAD,
    LEVEL_RANGE,
    TIME_RANGE,
    MultipathStep,
    drawn_steps,
    factor,
)
from sitl.gauss_markov import STILL, GaussMarkov, Wander

NoiseName = Literal["good", "rough", "none", "wide"]


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
    turning_push: Wander = STILL
    """PX4 only: acceleration, m/s2 per horizontal axis, by which it strays from its hover while it turns."""
    compass_off_rad: float = 0.0
    """Of the heading, besides what `heading_offset_rad` draws."""
    steps: tuple[MultipathStep, ...] = ()
    """Of the horizontal position."""


_DEG = math.radians(1.0)

PRESETS: dict[Literal["good", "rough", "none"], NoisePreset] = {
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
        turning_push=Wander(0.5, 0.6),
    ),
    "none": NoisePreset(),
}
NOISE_NAMES: tuple[NoiseName, ...] = get_args(NoiseName)
_LONGEST_S = 1200.0
"""How long steps go on to come."""


@lru_cache(maxsize=64)
def preset_of(name: NoiseName, seed: int) -> NoisePreset:
    """The errors of an autopilot; of a `wide` one they are drawn by the flight's seed."""
    return drawn_preset(np.random.default_rng((seed, 11))) if name == "wide" else PRESETS[name]


def drawn_preset(rng: np.random.Generator) -> NoisePreset:
    """An autopilot that nobody was told about: somewhere from `good` to `rough` in each error, and far beyond both."""
    good, rough = PRESETS["good"], PRESETS["rough"]

    def between(one: float, other: float) -> float:
        return factor(rng, (min(one, other), max(one, other)))

    def level(one: float, other: float) -> float:
        return between(one, other) * factor(rng, LEVEL_RANGE)

    def wander(one: Wander, other: Wander) -> Wander:
        tau = between(one.tau_s, other.tau_s) * factor(rng, TIME_RANGE)
        return Wander(level(one.sigma, other.sigma), tau, 1 if rng.random() < 0.5 else 2)

    claim = factor(rng, CLAIM_RANGE)
    accuracy = [math.sqrt(a * b) * claim for a, b in zip(good.gnss_accuracy_m, rough.gnss_accuracy_m, strict=True)]
    return NoisePreset(
        horizontal=wander(good.horizontal, rough.horizontal),
        vertical=wander(good.vertical, rough.vertical),
        horizontal_velocity=wander(good.horizontal_velocity, rough.horizontal_velocity),
        vertical_velocity=wander(good.vertical_velocity, rough.vertical_velocity),
        roll=wander(good.roll, rough.roll),
        pitch=wander(good.pitch, rough.pitch),
        heading=wander(good.heading, rough.heading),
        position_offset_m=level(good.position_offset_m, rough.position_offset_m),
        height_offset_m=level(good.height_offset_m, rough.height_offset_m),
        tilt_offset_rad=level(good.tilt_offset_rad, rough.tilt_offset_rad),
        gnss_sigma_m=level(good.gnss_sigma_m, rough.gnss_sigma_m),
        gnss_accuracy_m=(accuracy[0], accuracy[1], accuracy[2]),
        home_altitude_sigma_m=float(rng.uniform(0.0, 2.0 * rough.home_altitude_sigma_m)),
        turning_push=Wander(float(rng.uniform(0.0, 0.8)), rough.turning_push.tau_s * factor(rng, (0.5, 2.0))),
        compass_off_rad=float(rng.uniform(-COMPASS_OFF_RAD, COMPASS_OFF_RAD)),
        steps=tuple(drawn_steps(rng, _LONGEST_S)),
    )


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
        self._offset[8] = p.heading_offset_rad * rng.standard_normal() + p.compass_off_rad
        self._steps = p.steps
        self._dt = dt
        self._ticks = 0
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
        now = self._ticks * self._dt
        self._ticks += 1
        for step in self._steps:
            if step.at_s < now < step.ends_s:
                east, north = step.now(now)
                e, n = e + east, n + north
        return StateError((e, n, u), (ve, vn, vu), roll, pitch, heading)
