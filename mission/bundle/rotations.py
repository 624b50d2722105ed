"""Many small rotations at once: the exponential map of SO(3) and its inverse (Rodrigues' formula)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mission.records import Matrix


def exponential(vector: Matrix) -> NDArray[np.float64]:
    """(n, 3, 3) rotations by the rotation vectors (n, 3)."""
    angle = np.sqrt(np.einsum("ni,ni->n", vector, vector))
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.square(np.sinc(0.5 * angle / np.pi))
    k = cross_matrix(vector)
    return np.asarray(np.eye(3) + a[:, None, None] * k + b[:, None, None] * (k @ k))


def cross_matrix(vector: Matrix) -> NDArray[np.float64]:
    """(n, 3, 3): the matrix [v]x of each vector (n, 3), with [v]x w = v x w."""
    x, y, z = vector.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def rotation_logarithm(rotation: NDArray[np.float64]) -> Matrix:
    """(n, 3) rotation vectors of rotations (n, 3, 3) by less than a quarter turn."""
    skew = 0.5 * (rotation - np.swapaxes(rotation, 1, 2))
    vector = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    longer = np.where(sine > 1e-9, np.arcsin(np.minimum(sine, 1.0)) / np.maximum(sine, 1e-12), 1.0)
    return np.asarray(vector * longer)
