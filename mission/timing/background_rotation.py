"""The camera's own rotation, measured from the static background of successive frames."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.camera.model import CameraModel
from mission.camera.mounting import Mounting
from mission.records import CameraIntrinsics, Image, Matrix, Vector

_WORK_WIDTH_PX = 320
_MAX_CORNERS = 80
_REFILL_BELOW = 50
_MIN_POINTS = 12
_BACK_ERROR_PX = 0.5
_WINDOW = (13, 13)
_LEVELS = 3
_ROUNDS = 6
_SWAY_SIGMA = 0.02
"""Travel between two frames over the height: 1 m/s at 20 frames/s and 2.5 m."""
_TUKEY = 4.685
"""Cut of Tukey's biweight in units of sigma: 95 % efficient on Gaussian residuals."""


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """How the camera turned between two frames."""

    rotation_vector: Vector
    """(3,) rad, in the camera's axes: world_from_camera(now) = world_from_camera(before) * exp(rotation_vector)."""
    row_px: Vector
    """(3,): height in the picture at which each component holds (a rolling shutter exposed it at that row's time)."""
    points: int


class BackgroundRotation:
    """Measures the rotation from frame to frame: corners, pyramidal Lucas-Kanade there and back, a robust fit.

    Things that move by themselves or stand out from the ground do not follow; they lose their weight in the fit
    (Tukey's biweight, starting from the median) and their points are not followed any further.

    Args:
        intrinsics: of the frames.
        mounting: tells where down is while the aircraft is about level.
    """

    def __init__(self, intrinsics: CameraIntrinsics, mounting: Mounting) -> None:
        self._model = CameraModel(intrinsics)
        self._down: Vector = mounting.body_from_camera.inv().apply([0.0, 0.0, 1.0])
        self._scale = max(1.0, intrinsics.width_px / _WORK_WIDTH_PX)
        self._size = round(intrinsics.width_px / self._scale), round(intrinsics.height_px / self._scale)
        self._last: Image | None = None
        self._points: NDArray[np.float32] = np.empty((0, 2), dtype=np.float32)
        self.matched: tuple[Matrix, Matrix] | None = None
        """Points (n, 2) of the last two pictures that `measure` compared, in pixels of the intrinsics' size."""

    def restart(self) -> None:
        """Forget the last frame."""
        self._last = None

    def measure(self, image: Image) -> Turn | None:
        """The rotation since the last frame; None for the first one and when too little of the background was found.

        Args:
            image: BGR, of the intrinsics' size or scaled from it.
        """
        small = cv2.resize(image, self._size, interpolation=cv2.INTER_AREA)
        return self.measure_small(np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), dtype=np.uint8))

    @property
    def work_size(self) -> tuple[int, int]:
        """Width and height of the pictures that `measure_small` takes."""
        return self._size

    def measure_small(self, grey: Image) -> Turn | None:
        """The same from a grey picture of the work size.

        Args:
            grey: shape (height, width) of `work_size`.
        """
        self.matched = None
        turn = None
        if self._last is not None and len(self._points) >= _MIN_POINTS:
            turn = self._turn(self._last, grey)
        else:
            self._points = self._points[:0]
        if len(self._points) < _REFILL_BELOW:
            corners = cv2.goodFeaturesToTrack(grey, _MAX_CORNERS, 0.01, 12.0)
            found = np.empty((0, 2)) if corners is None else corners.reshape(-1, 2)
            self._points = np.asarray(found, dtype=np.float32)
        self._last = grey
        return turn

    def _turn(self, before: Image, now: Image) -> Turn | None:
        start = self._points.reshape(-1, 1, 2)
        there, found, _ = cv2.calcOpticalFlowPyrLK(before, now, start, start.copy(), winSize=_WINDOW, maxLevel=_LEVELS)
        back, returned, _ = cv2.calcOpticalFlowPyrLK(
            now, before, there, start.copy(), winSize=_WINDOW, maxLevel=_LEVELS
        )
        error = np.abs(back - start).reshape(-1, 2).max(axis=1)
        good = (found.ravel() == 1) & (returned.ravel() == 1) & (error < _BACK_ERROR_PX)
        old, new = self._points[good], np.asarray(there.reshape(-1, 2)[good], dtype=np.float32)
        self._points = new
        if len(new) < _MIN_POINTS:
            return None
        # The work picture's pixel (x, y) counts from the middle of its first pixel, the model's from the outer corner.
        self.matched = (old.astype(float) + 0.5) * self._scale, (new.astype(float) + 0.5) * self._scale
        turn, kept = rotation_between(*self.matched, self._model, self._down)
        self._points = new[kept]
        return turn


def rotation_between(
    before_px: Matrix, now_px: Matrix, model: CameraModel, down: Vector
) -> tuple[Turn | None, NDArray[np.bool_]]:
    """The camera's rotation from points that are matched already, and which of them (n,) agree with it.

    Args:
        before_px: (n, 2) in the picture before.
        now_px: (n, 2) in this one.
        model: the lens.
        down: (3,) unit vector, camera axes.
    """
    rays = model.ray(np.concatenate([before_px, now_px]))
    rays_old, rays_new = rays[: len(before_px)], rays[len(before_px) :]
    finite = np.isfinite(rays_old).all(axis=1) & np.isfinite(rays_new).all(axis=1)
    vector, weight, row_px = _robust_rotation(rays_old[finite], rays_new[finite], down, now_px[finite, 1])
    kept = np.zeros(len(now_px), dtype=bool)
    kept[np.flatnonzero(finite)[weight > 0.1]] = True
    if np.count_nonzero(kept) < _MIN_POINTS:
        return None, kept
    return Turn(vector, row_px, int(np.count_nonzero(kept))), kept


def _robust_rotation(before: Matrix, now: Matrix, down: Vector, row: Vector) -> tuple[Vector, Vector, Vector]:
    """Rotation vector r with before = exp(r) now for most of the rays (N, 3), each ray's weight, and the row of r.

    Rays that point below the horizon see the ground: a translation T at height h moves them by (ray . down) T / h
    across the ray (planar parallax), which is estimated along, so that the aircraft's sway is not taken for a turn.

    The fit is a weighted mean of what the points say; the same weights make the row (of each component) from theirs.
    """
    weight: Vector = np.ones(len(now))
    if len(now) < 3:
        return np.zeros(3), np.zeros(len(now)), np.zeros(3)
    moved = before - now
    depth = np.maximum(now[:, 2], 0.1)
    matrix = _matrix(np.array([-np.median(moved[:, 1] / depth), np.median(moved[:, 0] / depth), 0.0]))
    sway: Vector = np.zeros(3)
    row_px: Vector = np.zeros(3)
    for _ in range(_ROUNDS):
        rays = now @ matrix.T
        nearness = np.clip(rays @ down, 0.0, None)
        across = nearness[:, None] * (sway - (rays @ sway)[:, None] * rays)
        residual = before - rays - across
        length = np.sqrt(np.einsum("ni,ni->n", residual, residual))
        scale = max(1.4826 * float(np.median(length)) / 1.18, 1e-5)  # the median of a Rayleigh variable is 1.18 sigma
        weight = np.square(np.clip(1.0 - np.square(length / (_TUKEY * scale)), 0.0, None))
        # d(before - rays) = step x ray, that is -[ray]x on the step, and nearness (1 - ray ray') on the sway.
        jacobian = np.zeros((len(now), 3, 6))
        x, y, z = rays.T
        jacobian[:, 0, 1], jacobian[:, 0, 2] = z, -y
        jacobian[:, 1, 0], jacobian[:, 1, 2] = -z, x
        jacobian[:, 2, 0], jacobian[:, 2, 1] = y, -x
        jacobian[:, :, 3:] = nearness[:, None, None] * (np.eye(3) - rays[:, :, None] * rays[:, None, :])
        flat = jacobian.reshape(-1, 6)
        weighted = flat * np.repeat(weight, 3)[:, None]
        prior = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) * (scale / _SWAY_SIGMA) ** 2
        normal = weighted.T @ flat + np.diag(prior + 1e-9)
        gradient = weighted.T @ residual.ravel() - prior * np.concatenate([np.zeros(3), sway])
        by_row = weighted.T @ (flat[:, :3] * np.repeat(row, 3)[:, None])
        solved = np.linalg.solve(normal, np.column_stack([gradient, by_row]))
        step, row_px = solved[:, 0], np.diag(solved[:3, 1:])
        matrix = _matrix(step[:3]) @ matrix
        sway = sway + step[3:]
        if np.linalg.norm(step) < 1e-6:
            break
    vector, _ = cv2.Rodrigues(matrix)
    return np.asarray(vector, dtype=np.float64).ravel(), weight, np.asarray(row_px, dtype=np.float64)


def _matrix(rotation_vector: Vector) -> Matrix:
    return np.asarray(cv2.Rodrigues(rotation_vector)[0], dtype=np.float64)
