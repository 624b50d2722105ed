"""How the errors of a reported pose hang together in time: Gauss-Markov processes of first and second order.

A first-order process is correlated by exp(-d / tau), a second-order one, whose rate is finite, by
(1 + d / tau) exp(-d / tau) (Brown & Hwang, Introduction to Random Signals and Applied Kalman Filtering, 3.8). What
real autopilots' errors look like was measured on two recorded flights: heading, position and velocity are of second
order, the tilt of the restless one of first order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mission.records import Matrix, Vector


@dataclass(frozen=True, slots=True)
class GaussMarkov:
    """A stationary process."""

    sigma: float
    tau_s: float
    order: Literal[1, 2] = 2

    def covariance(self, t_s: Vector) -> Matrix:
        """(n, n) at the times (n,)."""
        lag = np.abs(t_s[:, None] - t_s[None, :]) / self.tau_s
        shape = np.exp(-lag) * (1.0 if self.order == 1 else 1.0 + lag)
        return np.asarray(self.sigma**2 * shape)

    def integral_covariance(self, t_s: Vector) -> Matrix:
        """(n, n) of the process integrated from the first of the times, which are ascending."""
        fine = np.linspace(t_s[0], t_s[-1], _FINE)
        step = fine[1] - fine[0]
        rows = np.zeros((_FINE, _FINE))
        rates = self.covariance(fine)
        rows[1:] = np.cumsum(0.5 * (rates[1:] + rates[:-1]), axis=0) * step
        twice = np.zeros_like(rows)
        twice[:, 1:] = np.cumsum(0.5 * (rows[:, 1:] + rows[:, :-1]), axis=1) * step
        place = (t_s - t_s[0]) / step
        low = np.clip(place.astype(int), 0, _FINE - 2)
        part = place - low
        across = twice[low] * (1.0 - part[:, None]) + twice[low + 1] * part[:, None]
        return np.asarray(across[:, low] * (1.0 - part) + across[:, low + 1] * part)

    def scaled(self, factor: float) -> GaussMarkov:
        """The same process, larger."""
        return replace(self, sigma=factor * self.sigma)


_FINE = 160
"""Steps of the numerical integration."""
