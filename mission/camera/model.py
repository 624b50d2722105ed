"""Pixel to bearing and back: a pinhole with OpenCV's five-parameter distortion.

Pixels count from the outer corner of the top left pixel, so the middle of that pixel is (0.5, 0.5); OpenCV's own
functions count from its middle. Camera axes: x right, y down, z out of the lens.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mission.records import CameraIntrinsics, Matrix, Vector

_UNDISTORT = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
"""OpenCV's default stops after five rounds, which leaves pixels of error at the edge of a wide lens."""

NO_BEND = 1e-12
"""A coefficient of the distortion below this moves no pixel."""
MOST_BEND = 10.0
"""A `largest_bend` beyond this is of no lens."""


class CameraModel:
    """Maps pixels to rays and points to pixels (OpenCV, "Camera Calibration and 3D Reconstruction")."""

    def __init__(self, intrinsics: CameraIntrinsics) -> None:
        self.intrinsics = intrinsics
        self.matrix: Matrix = np.array(
            [
                [intrinsics.fx, 0.0, intrinsics.cx - 0.5],
                [0.0, intrinsics.fy, intrinsics.cy - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )
        """(3, 3), as OpenCV wants it: the origin in the middle of the top left pixel."""
        self.distortion: Vector = np.array(intrinsics.distortion, dtype=float)
        """(5,) k1, k2, p1, p2, k3."""
        self.max_radius = _fold_radius(intrinsics)
        """Largest tangent of the angle off the axis up to which the radial distortion is one to one."""

    def ray(self, pixel: ArrayLike) -> Vector:
        """Unit rays in the camera frame.

        Args:
            pixel: (2,) or (N, 2) pixels in the distorted picture, (0, 0) = outer corner.

        Returns:
            (3,) or (N, 3); NaN where no ray of the lens model reaches that pixel.
        """
        given = np.asarray(pixel, dtype=float)
        flat = given.reshape(-1, 2)
        if len(flat) == 0:
            return np.empty((0, 3))
        points = np.ascontiguousarray(flat - 0.5).reshape(-1, 1, 2)
        tangents = cv2.undistortPointsIter(
            points, self.matrix, self.distortion, np.eye(3), np.eye(3), _UNDISTORT
        ).reshape(-1, 2)
        rays: Matrix = np.ones((len(flat), 3))
        rays[:, :2] = tangents
        if np.any(self.distortion):
            # The fixed-point iteration can settle on nothing, or beyond the fold: only a ray that projects back counts.
            back = self._project_unchecked(rays)
            bad = ~(np.linalg.norm(back - flat, axis=1) < 0.01) | (np.hypot(*tangents.T) > self.max_radius)
            rays[bad] = np.nan
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return rays.reshape(*given.shape[:-1], 3)

    def project(self, points_camera: ArrayLike) -> Vector:
        """Pixels of points given in the camera frame.

        Args:
            points_camera: (3,) or (N, 3), metres or any scale.

        Returns:
            (2,) or (N, 2) pixels in the distorted picture, which may lie outside of it.

        Raises:
            ValueError: a point is behind the camera, or further off its axis than the lens model reaches; ask
                `in_reach`.
        """
        given = np.asarray(points_camera, dtype=float)
        flat = given.reshape(-1, 3)
        if len(flat) == 0:
            return np.empty((0, 2))
        if not np.all(self.in_reach(flat)):
            raise ValueError("a point is behind the camera, or further off its axis than the lens model reaches")
        return self._project_unchecked(flat).reshape(*given.shape[:-1], 2)

    def in_reach(self, points_camera: ArrayLike) -> NDArray[np.bool_]:
        """Which points can be projected: in front of the camera and where the distortion is still one to one.

        Args:
            points_camera: (3,) or (N, 3).

        Returns:
            () or (N,).
        """
        points = np.asarray(points_camera, dtype=float)
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        reach: NDArray[np.bool_] = np.asarray((z > 0.0) & (np.hypot(x, y) <= self.max_radius * z))
        return reach

    def _project_unchecked(self, points: Matrix) -> Matrix:
        zero = np.zeros(3)
        pixels, _ = cv2.projectPoints(np.ascontiguousarray(points), zero, zero, self.matrix, self.distortion)
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2) + 0.5


def from_field_of_view(width_px: int, height_px: int, hfov_rad: float) -> CameraIntrinsics:
    """Intrinsics of an ideal lens: square pixels, the axis through the middle, no distortion.

    Args:
        width_px: width of the picture.
        height_px: height of the picture.
        hfov_rad: full horizontal angle of view, below pi.

    Raises:
        ValueError: the angle is not between 0 and pi, or the picture has no size.
    """
    if not 0.0 < hfov_rad < math.pi:
        raise ValueError(f"horizontal field of view {hfov_rad} rad is not between 0 and pi")
    if width_px < 1 or height_px < 1:
        raise ValueError(f"picture size {width_px} x {height_px} px")
    focal = width_px / 2.0 / math.tan(hfov_rad / 2.0)
    return CameraIntrinsics(width_px, height_px, focal, focal, width_px / 2.0, height_px / 2.0)


def largest_bend(intrinsics: CameraIntrinsics) -> float:
    """How far the strongest term of the distortion moves the picture's corners, in their distance from the axis.

    A real lens stays below one; the value may be infinite.
    """
    k1, k2, p1, p2, k3 = (abs(k) for k in intrinsics.distortion)
    across = max(intrinsics.cx, intrinsics.width_px - intrinsics.cx) / intrinsics.fx
    down = max(intrinsics.cy, intrinsics.height_px - intrinsics.cy) / intrinsics.fy
    r = math.hypot(across, down)
    return max(k1 * r * r, k2 * r * r * r * r, k3 * r * r * r * r * r * r, 3.0 * p1 * r, 3.0 * p2 * r)


def _fold_radius(intrinsics: CameraIntrinsics) -> float:
    """Where r (1 + k1 r^2 + k2 r^4 + k3 r^6) stops growing: beyond it a point would appear inside the picture again."""
    k1, k2, _, _, k3 = (k if abs(k) > NO_BEND else 0.0 for k in intrinsics.distortion)
    roots = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])  # d/dr, in r^2; np.roots drops leading zeros
    squares = [root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0.0]
    return math.sqrt(min(squares)) if squares else math.inf
