"""Where points of the background appear to cameras: the camera at each frame, what was seen, and the derivatives.

A point has a direction d and an inverse distance rho, both seen from one place c0 in the middle of the path (inverse
depth: Civera, Davison & Montiel 2008; from one place for all, so that a point hangs on no frame's pose and one at
infinity is nothing special):

    y = R' (d + rho (c0 - c)),   predicted = (y_x / y_z, y_y / y_z)

A row of a rolling shutter is exposed at its own time, at which the camera has gone on turning and moving at the frame's
rates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from mission.bundle.rotations import rotation_logarithm
from mission.records import Matrix, Vector

LEAST_DEPTH = 0.05
"""Of y_z below which a point is no longer in front of the camera, with |d| = 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Cameras:
    """Where the camera was at each frame and how it moved; k frames."""

    t_s: Vector
    """(k,)."""
    rotation: NDArray[np.float64]
    """(k, 3, 3) world_from_camera."""
    position_m: Matrix
    """(k, 3) ENU."""
    turn_rate: Matrix
    """(k, 3) rad/s, camera axes."""
    velocity_m_s: Matrix
    """(k, 3) ENU."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Where points were seen; n of them."""

    frame: NDArray[np.intp]
    """(n,) place in `Cameras`."""
    point: NDArray[np.intp]
    """(n,) number of the point, 0 to m - 1."""
    measured: Matrix
    """(n, 2) tangents, without the lens's distortion."""
    delay_s: Vector
    """(n,) by how much later than the frame's time the row was exposed."""

    def only(self, keep: NDArray[np.bool_]) -> Rows:
        """Some of the rows; points keep their numbers."""
        return Rows(self.frame[keep], self.point[keep], self.measured[keep], self.delay_s[keep])


@dataclass(frozen=True, slots=True, eq=False)
class Landmarks:
    """Points of the background; m of them."""

    origin_m: Vector
    """(3,), c0."""
    direction: Matrix
    """(m, 3), unit."""
    nearness: Vector
    """(m,) rho, 1/m; may be zero or slightly negative for far points."""


def corrected(reported: Cameras, turn: NDArray[np.float64], place: Matrix) -> Cameras:
    """The reported cameras with rotations (k, 3, 3) in front of their attitudes and offsets (k, 3) on their positions.

    Their rates are corrected along: a rolling shutter must not hold on to the reported ones, which are of another size.
    """
    rotation = turn @ reported.rotation
    if len(reported.t_s) < 3:
        return replace(reported, rotation=rotation, position_m=reported.position_m + place)
    turning = np.gradient(rotation_logarithm(turn), reported.t_s, axis=0)
    return Cameras(
        reported.t_s,
        rotation,
        reported.position_m + place,
        reported.turn_rate + np.einsum("kji,kj->ki", rotation, turning),
        reported.velocity_m_s + np.gradient(place, reported.t_s, axis=0),
    )


def interpolated(
    from_s: Vector, turn: NDArray[np.float64], place: Matrix, to_s: Vector
) -> tuple[NDArray[np.float64], Matrix]:
    """Corrections at other times; before the first and after the last they stay what they are."""
    inside = np.clip(to_s, from_s[0], from_s[-1])
    turned = Slerp(from_s, Rotation.from_matrix(turn))(inside).as_matrix()
    return turned, np.stack([np.interp(inside, from_s, place[:, axis]) for axis in range(3)], axis=1)


def tangents(direction: Matrix) -> NDArray[np.float64]:
    """(m, 3, 2): two unit vectors across each direction."""
    least = np.argmin(np.abs(direction), axis=1)
    first = np.cross(direction, np.eye(3)[least])
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-9)
    return np.stack([first, np.cross(direction, first)], axis=2)


def linearise(
    cameras: Cameras, landmarks: Landmarks, rows: Rows
) -> tuple[Matrix, NDArray[np.float64], NDArray[np.float64]]:
    """Residual (2, n), and the derivative of the prediction by theta and position (2, 6, n) and by d, rho (2, 3, n).

    The rows come last, here and in what is made of it: numpy is fast along the last axis, and there are thousands.
    """
    residual, by_g, g, away = _seen(cameras, landmarks, rows)
    across = _of_rows(tangents(landmarks.direction), rows.point)
    by_point = np.empty((2, 3, len(rows.point)))
    by_point[:, :2] = np.einsum("ijn,jcn->icn", by_g, across)
    by_point[:, 2] = np.einsum("ijn,jn->in", by_g, away)
    return residual, _by_camera(by_g, g, landmarks, rows), by_point


def linearise_cameras(cameras: Cameras, landmarks: Landmarks, rows: Rows) -> tuple[Matrix, NDArray[np.float64]]:
    """The same for points that are known: residual (2, n), and the derivative by theta and position (2, 6, n)."""
    residual, by_g, g, _ = _seen(cameras, landmarks, rows)
    return residual, _by_camera(by_g, g, landmarks, rows)


def residuals(cameras: Cameras, landmarks: Landmarks, rows: Rows) -> Matrix:
    """(2, n), measured less predicted; NaN where the point would be behind the camera."""
    return _seen(cameras, landmarks, rows)[0]


def exposed(cameras: Cameras, rows: Rows, ray: Matrix) -> Matrix:
    """Rays (3, n) of the cameras at their rows' times in world axes."""
    rotation, turn = _of_rows(cameras.rotation, rows.frame), rows.delay_s * _of_rows(cameras.turn_rate, rows.frame)
    return np.asarray(np.einsum("ijn,jn->in", rotation, _turned_back(ray, -turn)))


def _seen(cameras: Cameras, landmarks: Landmarks, rows: Rows) -> tuple[Matrix, NDArray[np.float64], Matrix, Matrix]:
    """Residual (2, n), d(prediction) / dg (2, 3, n), g = d + rho (c0 - c) (3, n), and c0 - c (3, n)."""
    rotation, position, turn_rate, velocity = (
        _of_rows(values, rows.frame)
        for values in (cameras.rotation, cameras.position_m, cameras.turn_rate, cameras.velocity_m_s)
    )
    away = landmarks.origin_m[:, None] - (position + rows.delay_s * velocity)
    g = _of_rows(landmarks.direction, rows.point) + landmarks.nearness[rows.point] * away
    y = _turned_back(np.einsum("ijn,in->jn", rotation, g), rows.delay_s * turn_rate)
    behind = ~(y[2] > LEAST_DEPTH)
    inverse = 1.0 / np.where(behind, 1.0, y[2])
    ideal = y[:2] * inverse
    residual = rows.measured.T - ideal
    residual[:, behind] = np.nan
    # d(ideal) / dy R'. How far the camera turns within the row's delay, half a degree, matters to the residual only.
    by_g = (np.swapaxes(rotation[:, :2], 0, 1) - ideal[:, None] * rotation[:, 2]) * inverse
    by_g[:, :, behind] = 0.0
    return residual, by_g, g, away


def _by_camera(by_g: NDArray[np.float64], g: Matrix, landmarks: Landmarks, rows: Rows) -> NDArray[np.float64]:
    found = np.empty((2, 6, len(rows.point)))
    found[0, :3], found[1, :3] = _cross(by_g[0], g), _cross(by_g[1], g)
    found[:, 3:] = -landmarks.nearness[rows.point] * by_g
    return found


def _of_rows(values: NDArray[np.float64], number: NDArray[np.intp]) -> NDArray[np.float64]:
    """(..., n): for each row the one of the values (k, ...) that it belongs to."""
    return np.moveaxis(values, 0, -1).take(number, axis=-1)


def _turned_back(vector: Matrix, turn: Matrix) -> Matrix:
    """Exp(turn)' v of many (3, n), by Rodrigues' formula without a matrix for each."""
    angle = np.sqrt(np.einsum("in,in->n", turn, turn))
    once = _cross(turn, vector)
    first, second = np.sinc(angle / np.pi), 0.5 * np.square(np.sinc(0.5 * angle / np.pi))
    return np.asarray(vector - first * once + second * _cross(turn, once))


def _cross(a: Matrix, b: Matrix) -> Matrix:
    """The cross products of many (3, n)."""
    (ax, ay, az), (bx, by, bz) = a, b
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
