"""Tridiagonal precision (inverse covariance) matrices of first-order Markov processes at uneven times.

A Markov process observed at n times has an inverse covariance with one diagonal and one off-diagonal, whatever the
times are; that is what keeps the estimators' cost linear in the number of sightings (Rue & Held, Gaussian Markov
Random Fields, section 1.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.records import Matrix, Vector

_SHORTEST_STEP = 2e-3
"""Shortest step told apart, as a share of the correlation time: equal times would make the precision infinite."""
_SHORTEST_WALK_S = 1e-4
"""Shortest step of a random walk that is told apart, seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class Precision:
    """A symmetric tridiagonal matrix."""

    diagonal: Vector
    """(n,)."""
    off: Vector
    """(n - 1,), the element between each time and the next."""


def white(count: int) -> Precision:
    """Unit variance, independent from time to time."""
    return Precision(np.ones(count), np.zeros(max(count - 1, 0)))


def gauss_markov(steps_s: Vector, correlation_s: float) -> Precision:
    """Stationary, unit variance, correlation exp(-dt / correlation_s); white for a correlation time of zero.

    Args:
        steps_s: times between neighbours, shape (n - 1,), not negative.
        correlation_s: seconds.
    """
    count = len(steps_s) + 1
    if correlation_s <= 0.0:
        return white(count)
    rho = np.exp(-np.maximum(steps_s / correlation_s, _SHORTEST_STEP))
    innovation = 1.0 / (1.0 - rho * rho)  # one over the variance that is new at each step
    diagonal = np.ones(count)
    diagonal[1:] = innovation
    diagonal[:-1] += rho * rho * innovation
    return Precision(diagonal, -rho * innovation)


def random_walk(steps_s: Vector) -> Precision:
    """Zero at the first time, then growing by a variance of one per second.

    The first element stands for nothing: it is decoupled and has unit variance, so that the matrix stays regular.
    """
    count = len(steps_s) + 1
    innovation = 1.0 / np.maximum(steps_s, _SHORTEST_WALK_S)
    diagonal = np.ones(count)
    diagonal[1:] = innovation
    diagonal[1:-1] += innovation[1:]
    off = -innovation
    if count > 1:
        off[0] = 0.0
    return Precision(diagonal, off)


def white_noise_acceleration(steps_s: Vector) -> tuple[Matrix, Matrix]:
    """Position and velocity of a target that starts at zero and is driven by unit white-noise acceleration.

    Args:
        steps_s: times between neighbours, shape (n - 1,).

    Returns:
        Block-tridiagonal precision: diagonal blocks (n, 2, 2) and the blocks (n - 1, 2, 2) below them (row: the later
        time), both in the order position, velocity. The first block stands for nothing, as in `random_walk`.
        Source: Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, 6.2.2.
    """
    dt = np.maximum(steps_s, 2e-3)
    count = len(dt) + 1
    inverse = np.empty((count - 1, 2, 2))  # of the process noise [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]]
    inverse[:, 0, 0] = 12.0 / dt**3
    inverse[:, 0, 1] = inverse[:, 1, 0] = -6.0 / dt**2
    inverse[:, 1, 1] = 4.0 / dt
    forward = np.tile(np.eye(2), (count - 1, 1, 1))
    forward[:, 0, 1] = dt
    diagonal = np.zeros((count, 2, 2))
    diagonal[0] = np.eye(2)
    diagonal[1:] += inverse
    diagonal[1:-1] += np.swapaxes(forward[1:], 1, 2) @ inverse[1:] @ forward[1:]
    below = -inverse @ forward
    if count > 1:
        below[0] = 0.0
    return diagonal, below
