"""The lens: from rays to pixels with OpenCV's distortion model, and from the pinhole picture to the distorted one.

Pixels count from the outer corner of the top left pixel: the middle of pixel (column, row) is (column, row) + 0.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from mission.records import CameraIntrinsics, Image, Vector

_MARGIN_PX = 3


def distort(ideal: Vector, camera: CameraIntrinsics) -> Vector:
    """Where the lens puts ideal image points (Brown-Conrady, as in OpenCV's calib3d).

    Args:
        ideal: (N, 2), x/z and y/z.
        camera: the lens.

    Returns:
        (N, 2), pixels.
    """
    k1, k2, p1, p2, k3 = camera.distortion
    x, y = ideal[:, 0], ideal[:, 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack([camera.fx * xd + camera.cx, camera.fy * yd + camera.cy], 1)


def project(points_camera: Vector, camera: CameraIntrinsics) -> Vector:
    """Pixels of points in front of the camera: (N, 3), metres, camera frame -> (N, 2)."""
    return distort(points_camera[:, :2] / points_camera[:, 2:], camera)


def undistort(pixels: Vector, camera: CameraIntrinsics) -> Vector:
    """Ideal image points (x/z, y/z) of pixels: (N, 2) -> (N, 2); exact to 1e-9 within the picture."""
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    points = np.ascontiguousarray(pixels, np.float64).reshape(-1, 1, 2)
    ideal = cv2.undistortPointsIter(points, matrix, np.array(camera.distortion), np.eye(3), np.eye(3), stop)
    return np.asarray(ideal.reshape(-1, 2), np.float64)


@dataclass(frozen=True, slots=True)
class Canvas:
    """The pinhole picture that is rendered: large enough for all that the lens sees."""

    width_px: int
    height_px: int
    focal_px: float
    centre_px: tuple[float, float]


class Lens:
    """Turns rendered pinhole pictures into what this camera sees."""

    def __init__(self, camera: CameraIntrinsics) -> None:
        self.camera = camera
        columns, rows = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
        ideal = undistort(np.stack([columns.ravel(), rows.ravel()], 1), camera)
        focal = max(camera.fx, camera.fy)
        low, high = focal * ideal.min(axis=0) - _MARGIN_PX, focal * ideal.max(axis=0) + _MARGIN_PX
        centre = (float(-low[0]), float(-low[1]))
        self.canvas = Canvas(
            width_px=4 * math.ceil((high[0] - low[0]) / 4.0),
            height_px=4 * math.ceil((high[1] - low[1]) / 4.0),
            focal_px=focal,
            centre_px=centre,
        )
        self.ideal_bounds = (ideal.min(axis=0), ideal.max(axis=0))
        """Smallest and largest x/z, y/z in the picture."""
        rays = np.column_stack([ideal, np.ones(len(ideal))])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        middle = rays.mean(axis=0)
        self.axis: Vector = middle / np.linalg.norm(middle)
        """(3,): middle of all that the lens sees, camera frame."""
        self.cone = float(np.arccos((rays @ self.axis).min()))
        """Largest angle from `axis` to a ray in the picture, radians."""
        # cv2.remap puts (0, 0) at the middle of the top left pixel.
        places = (focal * ideal + np.array(centre) - 0.5).astype(np.float32)
        self._map = cv2.convertMaps(
            places[:, 0].reshape(camera.height_px, camera.width_px),
            places[:, 1].reshape(camera.height_px, camera.width_px),
            cv2.CV_16SC2,
        )

    def picture(self, rendered: Image) -> Image:
        """The distorted picture of a rendered canvas."""
        return np.asarray(cv2.remap(rendered, self._map[0], self._map[1], cv2.INTER_LINEAR), np.uint8)
