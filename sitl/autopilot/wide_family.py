"""Autopilots that nobody was told about: by how much a flight's errors may differ from what is usual.

The ranges are far wider than both presets of the simulated autopilot. Nothing here is shared with what the estimator or
the steadying believes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mission.records import Vector

LEVEL_RANGE = (0.3, 4.0)
"""Factors on the level of an error."""
TIME_RANGE = (0.2, 5.0)
"""Factors on its correlation time."""
CLAIM_RANGE = (0.4, 2.5)
"""Factors on an accuracy that is reported: it lies both ways."""
COMPASS_OFF_RAD = math.radians(10.0)
"""A compass is off by anything up to this."""
_STEPS_EVERY_S = 15.0
"""Mean time between two steps of a position that multipath displaces."""
_STEP_M = (0.1, 1.5)
_STEP_OVER_S = (0.1, 2.0)
_STEP_LASTS_S = (1.0, 20.0)


def factor(rng: np.random.Generator, low_high: tuple[float, float]) -> float:
    """A factor out of a range, its logarithm uniform."""
    return float(np.exp(rng.uniform(*np.log(low_high))))


@dataclass(frozen=True, slots=True)
class MultipathStep:
    """A displacement of the reported position that comes, stays a while and goes."""

    at_s: float
    over_s: float
    lasts_s: float
    east_north_m: tuple[float, float]

    @property
    def ends_s(self) -> float:
        """When it has gone."""
        return self.at_s + 2.0 * self.over_s + self.lasts_s

    def at(self, t_s: Vector) -> Vector:
        """Displacement (n, 2), m, at times (n,)."""
        come = np.clip((t_s - self.at_s) / self.over_s, 0.0, 1.0)
        gone = np.clip((t_s - self.ends_s + self.over_s) / self.over_s, 0.0, 1.0)
        return np.outer(come - gone, self.east_north_m)

    def now(self, t_s: float) -> tuple[float, float]:
        """Displacement, m, at one time."""
        share = min(max((t_s - self.at_s) / self.over_s, 0.0), 1.0) - min(
            max((t_s - self.ends_s + self.over_s) / self.over_s, 0.0), 1.0
        )
        return share * self.east_north_m[0], share * self.east_north_m[1]


def drawn_steps(rng: np.random.Generator, duration_s: float) -> list[MultipathStep]:
    """The steps of one flight; most short flights have none."""
    steps = []
    for _ in range(int(rng.poisson(duration_s / _STEPS_EVERY_S))):
        size, direction = factor(rng, _STEP_M), rng.uniform(0.0, 2.0 * math.pi)
        steps.append(
            MultipathStep(
                float(rng.uniform(0.0, duration_s)),
                factor(rng, _STEP_OVER_S),
                factor(rng, _STEP_LASTS_S),
                (size * math.sin(direction), size * math.cos(direction)),
            )
        )
    return steps
