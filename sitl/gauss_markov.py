"""Errors that wander: stationary Gauss-Markov processes, correlated as `exp(-L/tau)` or `(1 + L/tau) exp(-L/tau)`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Wander:
    """A stationary Gauss-Markov process of first or second order."""

    sigma: float
    tau_s: float
    order: Literal[1, 2] = 2


STILL = Wander(0.0, 1.0)
"""No error at all."""


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
