"""How much each sighting of a point counts: outliers little, restless points less, things that move hardly at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mission.records import Matrix, Vector

_ORDINARY_ROWS = 3.0
"""A point's own variance is found as if it had been seen this many times more, with an ordinary one."""
_BEST_POINT = 4.0
"""No point counts more than this many ordinary ones."""


def length2_of(residual: Matrix) -> Vector:
    """(n,) squared lengths, infinite where the point is behind."""
    return np.where(np.isfinite(residual[:, 0]), np.einsum("ni,ni->n", residual, residual), np.inf)


def noise_scale(length2: Vector, least_sigma: float) -> float:
    """Standard deviation per axis of two-dimensional residuals, from their median (of a Rayleigh variable)."""
    finite = length2[np.isfinite(length2)]
    return max(float(np.sqrt(np.median(finite))) / 1.1774 if len(finite) else 1.0, least_sigma)


def geman_mcclure(length2: Vector, limit: float) -> Vector:
    """Weight of each residual."""
    return np.square(1.0 / (1.0 + length2 / limit**2))


def row_weights(length2: Vector, limit: float, scale: float, point: NDArray[np.intp]) -> Vector:
    """How much each row counts: Geman & McClure's weight of its own, times what its point deserves.

    A point that is off by more than others, time and again, is off for a reason (its window sees near ground from ever
    other sides, a leaf in the wind), so points count by the inverse of their own variance. One most of whose sightings
    do not fit moves by itself, and the rest that fit by chance count little.

    Args:
        length2: (n,) squared residuals.
        limit: length at which a row counts a quarter.
        scale: standard deviation of an ordinary row, per axis.
        point: (n,) which point each row is of.
    """
    robust = geman_mcclure(length2, limit)
    square = np.bincount(point, robust * np.where(np.isfinite(length2), length2, 0.0))
    number = np.bincount(point, robust)
    variance = (square + 2.0 * _ORDINARY_ROWS * scale**2) / (2.0 * (number + _ORDINARY_ROWS))
    share = number / np.maximum(np.bincount(point), 1)
    return np.asarray(robust * (np.square(share) * np.minimum(scale**2 / variance, _BEST_POINT))[point])


def persistence(residual: Matrix, weight: Vector, frame: NDArray[np.intp], point: NDArray[np.intp]) -> float:
    """By how much the variance of a sum is larger than if each row erred on its own: (1 + r) / (1 - r).

    r is the correlation of a point's residuals from one of its rows to the next (a first-order process).
    """
    order = np.lexsort((frame, point))
    first, second = order[:-1], order[1:]
    same = (point[first] == point[second]) & (weight[first] > 0.0) & (weight[second] > 0.0)
    first, second = first[same], second[same]
    both = weight[first] * weight[second]
    product = float(both @ np.einsum("ni,ni->n", residual[first], residual[second]))
    square = 0.5 * float(both @ (np.square(residual[first]).sum(axis=1) + np.square(residual[second]).sum(axis=1)))
    correlation = float(np.clip(product / square if square > 0.0 else 0.0, 0.0, 0.95))
    return (1.0 + correlation) / (1.0 - correlation)
