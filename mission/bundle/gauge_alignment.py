"""What pictures cannot tell, from the telemetry: where the path lies, how large it is, and where north and up are.

Turning, moving and stretching the cameras and the points together changes no picture. Those seven numbers come from
the reported path and attitude alone, by least squares with the errors' own covariances.

An aircraft flies by its own estimate, so the true path holds some of that estimate's errors, and plain least squares
would count the wandering of the path as knowledge of its size. So reports are compared with the path along its slow,
planned part (instrumental variables; Fuller, Measurement Error Models, 1.4), and the covariance is that of this
estimator. On simulated flights with rough estimates the size still came out too small by 2 to 3 %, within its sigma.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.bundle.rotations import cross_matrix, exponential, rotation_logarithm
from mission.records import Matrix, Vector

SCALE, TURN, PLACE = 0, slice(1, 4), slice(4, 7)
"""Places of the logarithm of the scale, the rotation vector and the offset among the seven numbers."""
ROUNDS = 3
_PLANNED_SHARE = 0.95
"""Of the path's variance: three metres out and back are far more than any estimate strays."""
_LEAST_WAVES = 2


@dataclass(frozen=True, slots=True, eq=False)
class PosePrior:
    """What the telemetry says of the corrections: one quadratic form per axis (east, north, up) over all k frames."""

    turn_information: NDArray[np.float64]
    """(3, k, k) of the attitude's correction about each axis; its most likely value is zero."""
    place_information: NDArray[np.float64]
    """(3, k, k) of the position's correction along each axis."""
    place_mean: Matrix
    """(3, k), its most likely value."""


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """x -> pivot + offset + scale * turn (x - pivot)."""

    scale: float
    turn: Matrix
    """(3, 3)."""
    offset_m: Vector
    """(3,)."""
    pivot_m: Vector
    """(3,)."""
    covariance: Matrix
    """(7, 7) of log scale, rotation vector (rad, ENU) and offset (m): what the telemetry leaves open."""


def most_likely_gauge(
    position_m: Matrix, reported_m: Matrix, turned: NDArray[np.float64], prior: PosePrior, rounds: int = ROUNDS
) -> Similarity:
    """The similarity that brings a path and its attitudes nearest to the reported ones.

    Args:
        position_m: (k, 3), the path.
        reported_m: (k, 3), the reported one.
        turned: (k, 3, 3), the attitudes: rotations in front of the reported ones.
        prior: how the reports err.
        rounds: linearisations; one is enough where the next call begins from this one's result.
    """
    pivot = position_m.mean(axis=0)
    log_scale, turn, offset = 0.0, np.eye(3), np.zeros(3)
    count = len(position_m)
    slow = _planned(position_m)
    inverse: Matrix = np.eye(7)
    left: Matrix = np.eye(7)
    for _ in range(rounds):
        arm = np.exp(log_scale) * (position_m - pivot) @ turn.T
        angle = rotation_logarithm(turn @ turned)
        place = pivot + offset + arm - reported_m
        planned = np.exp(log_scale) * (slow - pivot) @ turn.T
        information, left, gradient = np.zeros((7, 7)), np.zeros((7, 7)), np.zeros(7)
        for axis in range(3):
            jacobian = np.zeros((count, 7))
            jacobian[:, 1 + axis] = 1.0
            weighted = prior.turn_information[axis] @ jacobian
            information += jacobian.T @ weighted
            left += jacobian.T @ weighted
            gradient -= weighted.T @ angle[:, axis]
            jacobian, instrument = _by_place(arm, axis), _by_place(planned, axis)
            weighted = prior.place_information[axis] @ instrument
            information += weighted.T @ jacobian
            left += weighted.T @ instrument
            gradient -= weighted.T @ (place[:, axis] - prior.place_mean[axis])
        information[SCALE, SCALE] += 1.0  # a path that does not move has no scale: then it stays as it is
        left[SCALE, SCALE] += 1.0
        inverse = np.asarray(np.linalg.inv(information), dtype=np.float64)
        step = inverse @ gradient
        log_scale += float(np.clip(step[SCALE], -0.5, 0.5))
        turn = exponential(step[None, TURN])[0] @ turn
        offset = offset + step[PLACE]
    covariance = inverse @ left @ inverse.T
    return Similarity(float(np.exp(log_scale)), turn, offset, pivot, covariance)


def _by_place(arm: Matrix, axis: int) -> Matrix:
    """(k, 7): how one coordinate of each place changes with the seven numbers, the path being `arm` (k, 3)."""
    jacobian = np.zeros((len(arm), 7))
    jacobian[:, SCALE] = arm[:, axis]
    jacobian[:, TURN] = -cross_matrix(arm)[:, axis]
    jacobian[:, 4 + axis] = 1.0
    return jacobian


def _planned(position_m: Matrix) -> Matrix:
    """The path (k, 3) without its faster wandering: the first waves of its cosine transform that hold nearly all."""
    count = len(position_m)
    waves = np.cos(np.pi * np.outer(np.arange(count) + 0.5, np.arange(count)) / count)
    waves /= np.linalg.norm(waves, axis=0)
    part = waves.T @ position_m
    energy = np.square(part[1:]).sum(axis=1)
    most = _PLANNED_SHARE * max(float(energy.sum()), 1e-12)
    kept = 1 + max(_LEAST_WAVES, int(np.searchsorted(np.cumsum(energy), most)) + 1)
    return np.asarray(waves[:, :kept] @ part[:kept])
