"""Covariance functions of the processes that move targets and disturb cameras, at times in seconds.

Sources: Rasmussen & Williams, Gaussian Processes for Machine Learning, 4.2; Solin & Sarkka, Explicit link between
periodic covariance functions and state space models; Wahba, Spline Models, 1.1 (integrated Wiener processes).
"""

from __future__ import annotations

import numpy as np

from mission.records import Matrix, Vector


def exponential(t_s: Vector, correlation_s: float) -> Matrix:
    """First-order Gauss-Markov process of unit variance, (n, n); white for a correlation time of zero."""
    lag = np.abs(t_s[:, None] - t_s)
    if correlation_s <= 0.0:
        return np.asarray(lag == 0.0, dtype=np.float64)
    return np.asarray(np.exp(-lag / correlation_s))


def random_walk(t_s: Vector) -> Matrix:
    """A random walk that is zero at t = 0 and grows by unit variance each second, (n, n)."""
    return np.asarray(np.minimum(t_s[:, None], t_s))


def integrated_random_walk(t_s: Vector, other_s: Vector) -> Matrix:
    """Place whose velocity is a unit random walk, both zero at t = 0, (n, m)."""
    first, last = np.minimum(t_s[:, None], other_s), np.maximum(t_s[:, None], other_s)
    return np.asarray(first * first * (3.0 * last - first) / 6.0)


def random_walk_by_place(t_s: Vector, other_s: Vector) -> Matrix:
    """Covariance of a unit random walk at `t_s` (rows) with its integral at `other_s` (columns), (n, m)."""
    first = np.minimum(t_s[:, None], other_s)
    return np.asarray(first * other_s - 0.5 * first * first)


def twice_integrated_random_walk(t_s: Vector, other_s: Vector) -> Matrix:
    """Place whose acceleration is a unit random walk, all zero at t = 0, (n, m)."""
    first, lag = np.minimum(t_s[:, None], other_s), np.abs(t_s[:, None] - other_s)
    return np.asarray(first**5 / 20.0 + lag * first**4 / 8.0 + lag**2 * first**3 / 12.0)
