"""Bundle adjustment with priors: key frames' corrections and the background's points, from where the points appear.

Unknown are, per key frame, a rotation Exp(theta) in front of the reported attitude and an offset of the reported
position, and per point a direction and an inverse distance (`mission.steady.projection`). The points are eliminated
first (Schur complement; Triggs et al. 2000), what is left is solved by Cholesky. Outliers lose their weight by Geman &
McClure's function, whose scale starts wide and shrinks (graduated non-convexity).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csc_array

from mission.records import Matrix, Vector
from mission.steady.projection import Cameras, Landmarks, Rows, corrected, linearise, tangents
from mission.steady.rotations import cross_matrix, exponential, rotation_logarithm
from mission.steady.row_weights import length2_of, noise_scale, persistence, row_weights
from mission.steady.similarity import PosePrior, Similarity, most_likely_similarity

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
class Bundle:
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

    def moved(self, by: Similarity) -> Bundle:
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
) -> Bundle:
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
    settled, trust, moved = 0, np.empty(0), np.inf
    for step in range(steps):
        residual, by_camera, by_point = linearise(cameras, landmarks, rows)
        if settled < _REWEIGHTED:
            length2 = length2_of(residual)
            scale = noise_scale(length2, least_sigma)
            wide = start_scale * _NARROWING**step
            settled += wide <= _LIMIT * scale and moved < _NEAR
            trust = row_weights(length2, max(wide, _LIMIT * scale), scale, rows.point) / scale**2
        theta, offset, landmarks, factored = _step(
            by_camera, by_point, residual, trust, rows, prior, landmarks, cameras, turn, place
        )
        turn, place = exponential(theta) @ turn, place + offset
        similarity = most_likely_similarity(reported.position_m + place, reported.position_m, turn, prior, rounds=1)
        landmarks = _moved(landmarks, similarity)
        turn = similarity.turn @ turn
        arm = reported.position_m + place - similarity.pivot_m
        place = similarity.pivot_m + similarity.offset_m + similarity.scale * arm @ similarity.turn.T
        place = place - reported.position_m
        cameras = corrected(reported, turn, place)
        moved = max(float(np.abs(theta).max()), 0.1 * float(np.abs(offset).max()))
        if settled > 0 and moved < _CONVERGED:
            break
    residual, _, _ = linearise(cameras, landmarks, rows)
    length2 = length2_of(residual)
    scale = noise_scale(length2, least_sigma)
    weight = row_weights(length2, _LIMIT * scale, scale, rows.point)
    covariance = cho_solve(factored, np.eye(6 * len(cameras.t_s)), check_finite=False)
    covariance *= persistence(residual, weight, rows.frame, rows.point)
    agrees = length2 < (_LIMIT * scale) ** 2
    total = np.bincount(rows.point, minlength=points)
    still = np.bincount(rows.point, agrees, minlength=points) > 0.5 * total
    return Bundle(
        cameras, landmarks, residual, weight, scale, covariance, still, float(agrees.mean()), similarity, step + 1
    )


def _first_landmarks(cameras: Cameras, rows: Rows, points: int) -> Landmarks:
    """Each point in the mean direction of its sightings, far away."""
    turned = exponential(cameras.turn_rate[rows.frame] * rows.delay_s[:, None])
    ray = np.column_stack([rows.measured, np.ones(len(rows.measured))])
    ray = np.einsum("nij,njk,nk->ni", cameras.rotation[rows.frame], turned, ray, optimize=True)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    direction = np.zeros((points, 3))
    np.add.at(direction, rows.point, ray)
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    direction = np.where(length > 0.0, direction / np.maximum(length, 1e-9), [0.0, 0.0, 1.0])
    return Landmarks(cameras.position_m.mean(axis=0), direction, np.full(points, _FIRST_NEARNESS))


def _moved(landmarks: Landmarks, by: Similarity) -> Landmarks:
    """The points after a similarity."""
    place = by.pivot_m + by.offset_m + by.scale * by.turn @ (landmarks.origin_m - by.pivot_m)
    return Landmarks(place, landmarks.direction @ by.turn.T, landmarks.nearness / by.scale)


def _step(
    by_camera: NDArray[np.float64],
    by_point: NDArray[np.float64],
    residual: Matrix,
    weight: Vector,
    rows: Rows,
    prior: PosePrior,
    landmarks: Landmarks,
    cameras: Cameras,
    turn: NDArray[np.float64],
    place: Matrix,
) -> tuple[Matrix, Matrix, Landmarks, tuple[Matrix, bool]]:
    """One Gauss-Newton step: theta (k, 3), offset (k, 3), the factored Schur complement, the new landmarks."""
    count, points = len(turn), len(landmarks.nearness)
    residual = np.nan_to_num(residual)
    weighted = by_camera * weight[:, None, None]
    own = np.matmul(np.swapaxes(weighted, 1, 2), by_camera)
    pull = np.einsum("nij,ni->nj", weighted, residual)
    cross = np.matmul(np.swapaxes(weighted, 1, 2), by_point)
    point_own = np.matmul(np.swapaxes(by_point, 1, 2) * weight[:, None, None], by_point)
    point_pull = np.einsum("nij,ni->nj", by_point * weight[:, None, None], residual)

    blocks, gradient = summed(own, rows.frame, count), summed(pull, rows.frame, count)
    point_blocks, point_gradient = summed(point_own, rows.point, points), summed(point_pull, rows.point, points)
    point_blocks[:, [0, 1], [0, 1]] += _DIRECTION_DAMPING**-2
    point_blocks[:, 2, 2] += _NEARNESS_DAMPING**-2

    information = _held(cameras.position_m, float(np.einsum("kii->ki", blocks).mean()))
    every = np.arange(count)
    information[every, :, every, :] += blocks
    gradient = gradient.reshape(count, 6)
    angle = rotation_logarithm(turn)
    for axis in range(3):
        information[:, axis, :, axis] += prior.turn_information[axis]
        gradient[:, axis] -= prior.turn_information[axis] @ angle[:, axis]
        information[:, 3 + axis, :, 3 + axis] += prior.place_information[axis]
        gradient[:, 3 + axis] -= prior.place_information[axis] @ (place[:, axis] - prior.place_mean[axis])

    coupling = np.zeros((count, 6, points, 3))
    coupling[rows.frame, :, rows.point, :] = cross  # a point is seen once in a frame at most
    by_point_of = coupling.reshape(6 * count, points, 3)
    inverse = np.linalg.inv(point_blocks)
    reduced = np.einsum("npi,pij->npj", by_point_of, inverse, optimize=True)
    flat, reduced_flat = by_point_of.reshape(6 * count, -1), reduced.reshape(6 * count, -1)
    schur = information.reshape(6 * count, 6 * count) - reduced_flat @ flat.T
    factored = cho_factor(schur, lower=True, check_finite=False)
    solution = cho_solve(factored, gradient.ravel() - reduced_flat @ point_gradient.ravel(), check_finite=False)
    point_step = np.einsum("pij,pj->pi", inverse, point_gradient - (flat.T @ solution).reshape(points, 3))
    # A direction turns by at most half a radian a step, and stays a unit vector.
    across = np.einsum("pij,pj->pi", tangents(landmarks.direction), np.clip(point_step[:, :2], -0.5, 0.5))
    direction = landmarks.direction + across
    length = np.linalg.norm(direction, axis=1)
    nearness = np.clip((landmarks.nearness + point_step[:, 2]) / length, *_NEARNESS_RANGE)
    moved = Landmarks(landmarks.origin_m, direction / length[:, None], nearness)
    solved = solution.reshape(count, 6)
    return solved[:, :3], solved[:, 3:], moved, factored


def _held(position_m: Matrix, stiffness: float) -> NDArray[np.float64]:
    """(k, 6, k, 6): information that keeps a step from turning, moving or stretching all together.

    `most_likely_similarity` does that, exactly; left to the pictures it would follow what is noise to them.
    """
    arm = position_m - position_m.mean(axis=0)
    along = np.zeros((len(arm), 6, 7))
    along[:, 3:, 0] = arm
    along[:, :3, 1:4] = np.eye(3)
    along[:, 3:, 1:4] = -cross_matrix(arm)
    along[:, 3:, 4:] = np.eye(3)
    flat = along.reshape(-1, 7)
    flat = flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-9)
    return np.asarray(stiffness * flat @ flat.T).reshape(len(arm), 6, len(arm), 6)


def summed(values: NDArray[np.float64], group: NDArray[np.intp], groups: int) -> NDArray[np.float64]:
    """The sum of the rows of each group."""
    ones, ends = np.ones(len(values)), np.arange(len(values) + 1)
    total = csc_array((ones, group, ends), shape=(groups, len(values))) @ values.reshape(len(values), -1)
    return np.asarray(total).reshape(groups, *values.shape[1:])
