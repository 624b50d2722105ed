"""Bundle adjustment with priors: key frames' corrections and the background's points, from where the points appear.

Unknown are, per key frame, a rotation Exp(theta) in front of the reported attitude and an offset of the reported
position, and per point a direction and an inverse distance (`mission.bundle.projection`). The points are eliminated
first (Schur complement; Triggs et al. 2000), what is left is solved by Cholesky. Outliers lose their weight by Geman &
McClure's function, whose scale starts wide and shrinks (graduated non-convexity).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from mission.bundle.gauge_alignment import PosePrior, Similarity, most_likely_gauge
from mission.bundle.projection import (
    Cameras,
    Landmarks,
    Rows,
    corrected,
    exposed,
    linearise,
    residuals,
    tangents,
)
from mission.bundle.rotations import cross_matrix, exponential, rotation_logarithm
from mission.bundle.row_weights import length2_of, noise_scale, persistence, row_weights
from mission.records import Matrix, Vector

_NEARNESS_DAMPING = 0.5
_DIRECTION_DAMPING = 0.5
"""A step of this size (1/m, radians) costs one: keeps a point that is hardly seen where it is (Levenberg). A prior
towards zero would do so too, but it would pull the world apart, whose size the pictures do not hold."""
_FIRST_NEARNESS = 0.05
_NEARNESS_RANGE = (-0.2, 2.0)
_NARROWING = 0.5
"""Of the outliers' scale, from step to step."""
_LIMIT = 4.0
"""Of the outliers' scale in the end, in standard deviations of an ordinary row."""
_REWEIGHTED = 2
"""Rows are weighed so often at the scale of the end. Points that err together all along draw the solution towards
themselves a little more each time, over ten steps and more; on rendered flights that made headings no better."""
_NEAR, _CONVERGED = 4e-3, 1e-4
"""Radians (ten metres for one of them): a step after which the scale is that of the end, and one after which the next
is not worth its time."""
MAX_STEPS = 20


@dataclass(frozen=True, slots=True, eq=False)
class AdjustedBundle:
    """The most probable corrections."""

    cameras: Cameras
    landmarks: Landmarks
    residual: Matrix
    """(n, 2) tangents; NaN where the point would be behind the camera."""
    weight: Vector
    """(n,) 0 to 1, of each row in the last step."""
    scale: float
    """Standard deviation of an ordinary row's residual per axis, tangents."""
    covariance: Matrix
    """(6 k, 6 k) of the corrections' shape, frame by frame rotation (rad, ENU) and position (m): without what turns,
    moves or stretches all together. A point's rows err together for a while, which is allowed for."""
    still: NDArray[np.bool_]
    """(m,) whether each point agrees with a world that stands still."""
    still_share: float
    """Of the rows, how many do."""
    similarity: Similarity
    """The last one; its covariance is what stays unknown of the whole."""
    steps: int

    def moved(self, by: Similarity) -> AdjustedBundle:
        """The same pictures of a world that is turned, moved and stretched."""
        arm = self.cameras.position_m - by.pivot_m
        cameras = replace(
            self.cameras,
            rotation=by.turn @ self.cameras.rotation,
            position_m=by.pivot_m + by.offset_m + by.scale * arm @ by.turn.T,
            velocity_m_s=by.scale * self.cameras.velocity_m_s @ by.turn.T,
        )
        return replace(self, cameras=cameras, landmarks=_moved(self.landmarks, by), similarity=by)


def adjust(
    cameras: Cameras,
    rows: Rows,
    prior: PosePrior,
    least_sigma: float,
    start_scale: float,
    steps: int = MAX_STEPS,
) -> AdjustedBundle:
    """The most probable cameras and points.

    After each Gauss-Newton step all is turned, moved and stretched together to agree best with the telemetry. That
    changes no residual, and it spares the many small steps that a valley without slope would take.

    Args:
        cameras: as reported.
        rows: what was seen.
        prior: how the reports err.
        least_sigma: no point is seen better than this, tangents.
        start_scale: how far off a row may be at first and still count, tangents.
        steps: Gauss-Newton steps at most.
    """
    reported, points = cameras, int(rows.point.max()) + 1
    landmarks = _first_landmarks(cameras, rows, points)
    turn, place = np.tile(np.eye(3), (len(cameras.t_s), 1, 1)), np.zeros((len(cameras.t_s), 3))
    coupling = _Coupling(rows, len(cameras.t_s), points)
    settled, trust, moved = 0, np.empty(0), np.inf
    for step in range(steps):
        residual, by_camera, by_point = linearise(cameras, landmarks, rows)
        if settled < _REWEIGHTED:
            length2 = length2_of(residual.T)
            scale = noise_scale(length2, least_sigma)
            wide = start_scale * _NARROWING**step
            settled += wide <= _LIMIT * scale and moved < _NEAR
            trust = row_weights(length2, max(wide, _LIMIT * scale), scale, rows.point) / scale**2
        theta, offset, landmarks, factored = _step(
            by_camera, by_point, residual, trust, rows, coupling, prior, landmarks, cameras, turn, place
        )
        turn, place = exponential(theta) @ turn, place + offset
        similarity = most_likely_gauge(reported.position_m + place, reported.position_m, turn, prior, rounds=1)
        landmarks = _moved(landmarks, similarity)
        turn = similarity.turn @ turn
        arm = reported.position_m + place - similarity.pivot_m
        place = similarity.pivot_m + similarity.offset_m + similarity.scale * arm @ similarity.turn.T
        place = place - reported.position_m
        cameras = corrected(reported, turn, place)
        moved = max(float(np.abs(theta).max()), 0.1 * float(np.abs(offset).max()))
        if settled > 0 and moved < _CONVERGED:
            break
    residual = residuals(cameras, landmarks, rows).T
    length2 = length2_of(residual)
    scale = noise_scale(length2, least_sigma)
    weight = row_weights(length2, _LIMIT * scale, scale, rows.point)
    shape = (6, len(cameras.t_s))
    covariance = cho_solve(factored, np.eye(6 * len(cameras.t_s)), check_finite=False)
    covariance = covariance.reshape(*shape, *shape).transpose(1, 0, 3, 2).reshape(covariance.shape)
    covariance *= persistence(residual, weight, rows.frame, rows.point)
    agrees = length2 < (_LIMIT * scale) ** 2
    total = np.bincount(rows.point, minlength=points)
    still = np.bincount(rows.point, agrees, minlength=points) > 0.5 * total
    return AdjustedBundle(
        cameras, landmarks, residual, weight, scale, covariance, still, float(agrees.mean()), similarity, step + 1
    )


def _first_landmarks(cameras: Cameras, rows: Rows, points: int) -> Landmarks:
    """Each point in the mean direction of its sightings, far away."""
    ray = exposed(cameras, rows, np.vstack([rows.measured.T, np.ones(len(rows.point))]))
    direction = summed(ray / np.linalg.norm(ray, axis=0), rows.point, points).T
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    direction = np.where(length > 0.0, direction / np.maximum(length, 1e-9), [0.0, 0.0, 1.0])
    return Landmarks(cameras.position_m.mean(axis=0), direction, np.full(points, _FIRST_NEARNESS))


def _moved(landmarks: Landmarks, by: Similarity) -> Landmarks:
    """The points after a similarity."""
    place = by.pivot_m + by.offset_m + by.scale * by.turn @ (landmarks.origin_m - by.pivot_m)
    return Landmarks(place, landmarks.direction @ by.turn.T, landmarks.nearness / by.scale)


class _Coupling:
    """The product of the derivatives by cameras and by points, as the one matrix that the points are eliminated with.

    Most of it is the same zeros in every step, and memory that is new each time costs more than what is reckoned in it.
    """

    def __init__(self, rows: Rows, frames: int, points: int) -> None:
        self._product = np.zeros((6, frames, 3, points))
        number = np.arange(3)[:, None]
        self._places = (rows.frame * 3 + number) * points + rows.point

    def filled(self, by_camera: NDArray[np.float64], by_point: NDArray[np.float64]) -> Matrix:
        """(6 k, 3 m) from the derivatives (2, 6, n) and (2, 3, n); a point is seen once in a frame at most."""
        product = np.einsum("ian,icn->acn", by_camera, by_point)
        for matrix, values in zip(self._product.reshape(6, -1), product, strict=True):
            matrix[self._places] = values
        return self._product.reshape(6 * self._product.shape[1], -1)


def _step(
    by_camera: NDArray[np.float64],
    by_point: NDArray[np.float64],
    residual: Matrix,
    weight: Vector,
    rows: Rows,
    coupling: _Coupling,
    prior: PosePrior,
    landmarks: Landmarks,
    cameras: Cameras,
    turn: NDArray[np.float64],
    place: Matrix,
) -> tuple[Matrix, Matrix, Landmarks, tuple[Matrix, bool]]:
    """One Gauss-Newton step: theta (k, 3), offset (k, 3), the factored Schur complement, the new landmarks.

    The Schur complement is that of the numbers (6, k): the first one of all frames, the second one of all frames ...
    """
    count, points = len(turn), len(landmarks.nearness)
    root = np.sqrt(weight)
    by_camera, by_point, residual = root * by_camera, root * by_point, root * np.nan_to_num(residual)

    blocks, pull = camera_equations(by_camera, residual, rows.frame, count)
    information = _held(cameras.position_m, float(np.einsum("kii->ki", blocks).mean()))
    every = np.arange(count)
    information[:, every, :, every] += blocks
    gradient, angle = pull.T, rotation_logarithm(turn)
    for axis in range(3):
        information[axis, :, axis] += prior.turn_information[axis]
        gradient[axis] -= prior.turn_information[axis] @ angle[:, axis]
        information[3 + axis, :, 3 + axis] += prior.place_information[axis]
        gradient[3 + axis] -= prior.place_information[axis] @ (place[:, axis] - prior.place_mean[axis])

    point_blocks = summed(np.einsum("ian,icn->acn", by_point, by_point), rows.point, points)
    point_blocks += np.diag([_DIRECTION_DAMPING**-2, _DIRECTION_DAMPING**-2, _NEARNESS_DAMPING**-2])[:, :, None]
    # In units in which each point's own information is one, what eliminating them takes away is a matrix times its own
    # transpose: half the work.
    unit = np.moveaxis(np.linalg.inv(np.linalg.cholesky(np.moveaxis(point_blocks, 2, 0))), 0, 2)
    by_point = np.einsum("acn,icn->ian", unit.take(rows.point, axis=2), by_point)
    point_gradient = summed(np.einsum("ian,in->an", by_point, residual), rows.point, points)
    both = coupling.filled(by_camera, by_point)
    schur = information.reshape(6 * count, 6 * count) - both @ both.T
    factored = cho_factor(schur, lower=True, check_finite=False)
    solution = cho_solve(factored, gradient.ravel() - both @ point_gradient.ravel(), check_finite=False)
    left = point_gradient - (solution @ both).reshape(3, points)
    point_step = np.einsum("acp,ap->pc", unit, left)
    # A direction turns by at most half a radian a step, and stays a unit vector.
    across = np.einsum("pij,pj->pi", tangents(landmarks.direction), np.clip(point_step[:, :2], -0.5, 0.5))
    direction = landmarks.direction + across
    length = np.linalg.norm(direction, axis=1)
    nearness = np.clip((landmarks.nearness + point_step[:, 2]) / length, *_NEARNESS_RANGE)
    moved = Landmarks(landmarks.origin_m, direction / length[:, None], nearness)
    solved = solution.reshape(6, count).T
    return solved[:, :3], solved[:, 3:], moved, factored


def _held(position_m: Matrix, stiffness: float) -> NDArray[np.float64]:
    """(6, k, 6, k): information that keeps a step from turning, moving or stretching all together.

    `most_likely_gauge` does that, exactly; left to the pictures it would follow what is noise to them.
    """
    arm = position_m - position_m.mean(axis=0)
    along = np.zeros((6, len(arm), 7))
    along[3:, :, 0] = arm.T
    along[:3, :, 1:4] = np.eye(3)[:, None]
    along[3:, :, 1:4] = -np.swapaxes(cross_matrix(arm), 0, 1)
    along[3:, :, 4:] = np.eye(3)[:, None]
    flat = along.reshape(-1, 7)
    flat = flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-9)
    return np.asarray(stiffness * flat @ flat.T).reshape(6, len(arm), 6, len(arm))


def camera_equations(
    by_camera: NDArray[np.float64], residual: Matrix, frame: NDArray[np.intp], frames: int
) -> tuple[NDArray[np.float64], Matrix]:
    """Each camera's own information (k, 6, 6) and gradient (k, 6).

    Args:
        by_camera: (2, 6, n) derivatives, weighted by the root of each row's weight.
        residual: (2, n), weighted likewise.
        frame: (n,) which camera each row is of.
        frames: k.
    """
    information, gradient = np.zeros((frames, 6, 6)), np.zeros((frames, 6))
    order = np.argsort(frame, kind="stable")
    ends = np.searchsorted(frame[order], np.arange(frames + 1)).tolist()
    for number, (first, last) in enumerate(pairwise(ends)):
        own = order[first:last]
        jacobian = np.swapaxes(by_camera.take(own, axis=2), 0, 1).reshape(6, -1)
        information[number] = jacobian @ jacobian.T
        gradient[number] = jacobian @ residual.take(own, axis=1).ravel()
    return information, gradient


def summed(values: NDArray[np.float64], group: NDArray[np.intp], groups: int) -> NDArray[np.float64]:
    """(..., groups): the sums of values (..., n) of the same group."""
    sums = [np.bincount(group, row, groups) for row in values.reshape(-1, len(group))]
    return np.array(sums, dtype=np.float64).reshape(*values.shape[:-1], groups)
