"""The camera's own rotation, measured from the static background of successive frames."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mission.camera.model import CameraModel
from mission.records import CameraIntrinsics, Image, Matrix, Vector

_WORK_WIDTH_PX = 320
_MAX_CORNERS = 80
_REFILL_BELOW = 50
_MIN_POINTS = 12
_BACK_ERROR_PX = 0.5
_WINDOW = (13, 13)
_LEVELS = 3
_TUKEY = 4.685
"""Cut of Tukey's biweight in units of sigma: 95 % efficient on Gaussian residuals."""


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """How the camera turned between two frames."""

    rotation_vector: Vector
    """(3,) rad, in the camera's axes: world_from_camera(now) = world_from_camera(before) * exp(rotation_vector)."""
    mean_y_px: float
    """Mean height in the picture of the points that told it (for a rolling shutter)."""
    points: int


class BackgroundRotation:
    """Measures the rotation from frame to frame: corners, pyramidal Lucas-Kanade there and back, a robust fit.

    Translation and things that move by themselves do not follow one rotation; they lose their weight in the fit
    (Tukey's biweight, starting from the median) and their points are not followed any further.

    Args:
        intrinsics: of the frames.
    """

    def __init__(self, intrinsics: CameraIntrinsics) -> None:
        self._model = CameraModel(intrinsics)
        self._scale = max(1.0, intrinsics.width_px / _WORK_WIDTH_PX)
        self._size = round(intrinsics.width_px / self._scale), round(intrinsics.height_px / self._scale)
        self._last: Image | None = None
        self._points: NDArray[np.float32] = np.empty((0, 2), dtype=np.float32)

    def restart(self) -> None:
        """Forget the last frame."""
        self._last = None

    def measure(self, image: Image) -> Turn | None:
        """The rotation since the last frame; None for the first one and when too little of the background was found.

        Args:
            image: BGR, of the intrinsics' size or scaled from it.
        """
        small = cv2.resize(image, self._size, interpolation=cv2.INTER_AREA)
        grey: Image = np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
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
        rays = self._model.ray((np.concatenate([old, new]).astype(float) + 0.5) * self._scale)
        rays_old, rays_new = rays[: len(old)], rays[len(old) :]
        finite = np.isfinite(rays_old).all(axis=1) & np.isfinite(rays_new).all(axis=1)
        vector, weight = _robust_rotation(rays_old[finite], rays_new[finite])
        kept = np.zeros(len(new), dtype=bool)
        kept[np.flatnonzero(finite)[weight > 0.1]] = True
        self._points = new[kept]
        if np.count_nonzero(kept) < _MIN_POINTS:
            return None
        return Turn(vector, float((new[kept, 1].mean() + 0.5) * self._scale), int(np.count_nonzero(kept)))


def _robust_rotation(before: Matrix, now: Matrix) -> tuple[Vector, Vector]:
    """Rotation vector r with before = exp(r) now for most of the rays (N, 3), and each ray's weight, 0 to 1."""
    weight: Vector = np.ones(len(now))
    if len(now) < 3:
        return np.zeros(3), np.zeros(len(now))
    moved = before - now
    depth = np.maximum(now[:, 2], 0.1)
    vector: Vector = np.array([-np.median(moved[:, 1] / depth), np.median(moved[:, 0] / depth), 0.0])
    for _ in range(6):
        turned = Rotation.from_rotvec(vector)
        rays = turned.apply(now)
        residual = before - rays
        length = np.linalg.norm(residual, axis=1)
        scale = max(1.4826 * float(np.median(length)) / 1.18, 1e-5)  # the median of a Rayleigh variable is 1.18 sigma
        weight = np.square(np.clip(1.0 - np.square(length / (_TUKEY * scale)), 0.0, None))
        # d(before - rays) = step x ray, that is the matrix -[ray]x on the step.
        normal = np.eye(3) * weight.sum() - np.einsum("n,ni,nj->ij", weight, rays, rays)
        step = np.linalg.solve(normal + 1e-9 * np.eye(3), (weight[:, None] * np.cross(rays, residual)).sum(axis=0))
        vector = (Rotation.from_rotvec(step) * turned).as_rotvec()
        if np.linalg.norm(step) < 1e-7:
            break
    return vector, weight
