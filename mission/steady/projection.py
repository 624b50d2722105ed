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

from mission.records import Matrix, Vector
from mission.steady.rotations import cross_matrix, rotation_logarithm

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
    """Residual (n, 2), and the derivative of the prediction by theta and position (n, 2, 6) and by d, rho (n, 2, 3)."""
    residual, by_g, g, away = _seen(cameras, landmarks, rows)
    by_point = np.empty((len(g), 2, 3))
    by_point[:, :, :2] = by_g @ tangents(landmarks.direction)[rows.point]
    by_point[:, :, 2] = np.einsum("nij,nj->ni", by_g, away)
    return residual, _by_camera(by_g, g, landmarks, rows), by_point


def linearise_cameras(cameras: Cameras, landmarks: Landmarks, rows: Rows) -> tuple[Matrix, NDArray[np.float64]]:
    """The same for points that are known: residual (n, 2), and the derivative by theta and position (n, 2, 6)."""
    residual, by_g, g, _ = _seen(cameras, landmarks, rows)
    return residual, _by_camera(by_g, g, landmarks, rows)


def _seen(cameras: Cameras, landmarks: Landmarks, rows: Rows) -> tuple[Matrix, NDArray[np.float64], Matrix, Matrix]:
    """Residual (n, 2), d(prediction) / dg (n, 2, 3), g = d + rho (c0 - c) (n, 3), and c0 - c (n, 3)."""
    rotation = cameras.rotation[rows.frame]
    delay_s = rows.delay_s[:, None]
    away = landmarks.origin_m - (cameras.position_m[rows.frame] + delay_s * cameras.velocity_m_s[rows.frame])
    g = landmarks.direction[rows.point] + landmarks.nearness[rows.point, None] * away
    y = _turned_back(np.einsum("nji,nj->ni", rotation, g), delay_s * cameras.turn_rate[rows.frame])
    behind = ~(y[:, 2] > LEAST_DEPTH)
    inverse = 1.0 / np.where(behind, 1.0, y[:, 2])
    ideal = y[:, :2] * inverse[:, None]
    residual = rows.measured - ideal
    residual[behind] = np.nan
    # d(ideal) / dy R'. How far the camera turns within the row's delay, half a degree, matters to the residual only.
    by_g = (np.swapaxes(rotation, 1, 2)[:, :2] - ideal[:, :, None] * rotation[:, None, :, 2]) * inverse[:, None, None]
    by_g[behind] = 0.0
    return residual, by_g, g, away


def _by_camera(by_g: NDArray[np.float64], g: Matrix, landmarks: Landmarks, rows: Rows) -> NDArray[np.float64]:
    found = np.empty((len(g), 2, 6))
    found[:, :, :3] = by_g @ cross_matrix(g)
    found[:, :, 3:] = -landmarks.nearness[rows.point, None, None] * by_g
    return found


def _turned_back(vector: Matrix, turn: Matrix) -> Matrix:
    """Exp(turn)' v of many (n, 3), by Rodrigues' formula without a matrix for each."""
    angle = np.sqrt(np.einsum("ni,ni->n", turn, turn))[:, None]
    once = _cross(turn, vector)
    first, second = np.sinc(angle / np.pi), 0.5 * np.square(np.sinc(0.5 * angle / np.pi))
    return np.asarray(vector - first * once + second * _cross(turn, once))


def _cross(a: Matrix, b: Matrix) -> Matrix:
    ax, ay, az = a.T
    bx, by, bz = b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
