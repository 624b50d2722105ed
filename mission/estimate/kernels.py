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
    """A random walk that is zero at t = 0 and grows by unit variance each second, before and after, (n, n)."""
    return np.asarray(_one_side(t_s, t_s) * np.minimum(np.abs(t_s[:, None]), np.abs(t_s)))


def integrated_random_walk(t_s: Vector, other_s: Vector) -> Matrix:
    """Place whose velocity is a unit random walk, both zero at t = 0, (n, m)."""
    t, other = np.abs(t_s[:, None]), np.abs(other_s)
    first, last = np.minimum(t, other), np.maximum(t, other)
    return np.asarray(_one_side(t_s, other_s) * first * first * (3.0 * last - first) / 6.0)


def random_walk_by_place(t_s: Vector, other_s: Vector) -> Matrix:
    """Covariance of a unit random walk at `t_s` (rows) with its integral at `other_s` (columns), (n, m)."""
    other = np.abs(other_s)
    first = np.minimum(np.abs(t_s[:, None]), other)
    return np.asarray(_one_side(t_s, other_s) * np.sign(other_s) * (first * other - 0.5 * first * first))


def twice_integrated_random_walk(t_s: Vector, other_s: Vector) -> Matrix:
    """Place whose acceleration is a unit random walk, all zero at t = 0, (n, m)."""
    t, other = np.abs(t_s[:, None]), np.abs(other_s)
    first, lag = np.minimum(t, other), np.abs(t - other)
    return np.asarray(_one_side(t_s, other_s) * (first**5 / 20.0 + lag * first**4 / 8.0 + lag**2 * first**3 / 12.0))


def _one_side(t_s: Vector, other_s: Vector) -> Matrix:
    """One where two times are on the same side of zero: what happened before has no part in what comes after."""
    return np.asarray(t_s[:, None] * other_s > 0.0, dtype=np.float64)
