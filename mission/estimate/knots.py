"""Sightings averaged over short windows ("knots"), with the covariances that their errors have there.

What a target does between two frames is not told apart by an estimate, but a dense covariance of all frames would cost
the cube of their number. Within a quarter of a second everything is close to linear in time, so residuals and their
derivatives are averaged there, each frame by its own weight, and every error process is averaged with the same
weights: cov = A K(t, t) A', whatever its correlation (Rasmussen & Williams, Gaussian Processes, 9.4: linear functionals
of a process).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.estimate.observations import Observations
from mission.records import Matrix, Vector

_WINDOW_S = 0.35
_FEWEST, _MOST = 12, 60


@dataclass(frozen=True, slots=True, eq=False)
class Knots:
    """Averaging weights of one flight's sightings."""

    bearing: Matrix
    """(k, n), weights of the bearings; each row sums to one."""
    size: Matrix
    """(k, n), weights of the apparent heights; a row of zeros where no sighting of the window has one."""
    t_s: Vector
    """(k,), mean times."""
    sized: Vector
    """(k,), whether the window has an apparent height."""

    def averaged(self, kernel: Matrix) -> Matrix:
        """Covariance (k, k) of the averages of a process whose covariance at the sightings is `kernel` (n, n)."""
        averaged: Matrix = self.bearing @ kernel @ self.bearing.T
        return averaged


def knots(seen: Observations, t_s: Vector) -> Knots:
    """Windows of equal length over the time in which there are sightings.

    Args:
        seen: observations in time order, three at least.
        t_s: (n,), their times.
    """
    t = t_s
    count = len(t)
    gaps = np.diff(t, prepend=t[0])
    # Long gaps, as between two passes, hold no windows.
    typical = max(float(np.median(gaps[1:])), 1e-6)
    active = np.cumsum(np.minimum(gaps, max(4.0 * typical, _WINDOW_S)))
    windows = int(np.clip(round(float(active[-1]) / _WINDOW_S), _FEWEST, _MOST))
    edge = np.linspace(0.0, float(active[-1]) + 1e-9, windows + 1)
    label = np.clip(np.searchsorted(edge, active, side="right") - 1, 0, windows - 1)
    _, label = np.unique(label, return_inverse=True)
    member = np.zeros((int(label.max()) + 1, count))
    member[label, np.arange(count)] = 1.0
    bearing = member * np.square(seen.scale[:, 0, 0])
    bearing /= bearing.sum(axis=1, keepdims=True)
    size = member * np.square(seen.size_scale)
    total = size.sum(axis=1)
    sized = total > 0.0
    return Knots(bearing, size / np.where(sized, total, 1.0)[:, None], bearing @ t, sized)
