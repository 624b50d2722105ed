"""A wall with a row of ArUco markers: where the camera was, from one picture of it.

The markers have the ids 0, 1, 2, ... from left to right, all of one size, their middles equally far apart in one line.
Wall axes: x to the right, y down, z into the wall; zero is the middle of marker 0. The camera's place comes from all
corners of all markers in view (perspective-n-point; Lepetit, Moreno-Noguer & Fua 2009, then refined).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from mission.camera.model import CameraModel
from mission.errors import CalibrationInputError
from mission.records import CameraIntrinsics, Image, Matrix, Vector

LEAST_MARKERS = 2
"""One alone leaves tilt and place mixed up."""
LARGEST_RMS_PX = 2.0
_MOST_MARKERS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class WallSight:
    """Where the camera was in one picture."""

    position_m: Vector
    """(3,) wall axes; z is negative, in front of the wall."""
    rms_px: float
    markers: int


class MarkerWall:
    """A row of markers.

    Args:
        dictionary: OpenCV's name of the marker dictionary, such as ``DICT_4X4_50``.
        marker_m: side of a marker.
        spacing_m: from the middle of one to that of the next.

    Raises:
        CalibrationInputError: an unknown dictionary, or sizes that cannot be.
    """

    def __init__(self, dictionary: str, marker_m: float, spacing_m: float) -> None:
        label = dictionary.upper() if dictionary.upper().startswith("DICT_") else f"DICT_{dictionary.upper()}"
        number = getattr(cv2.aruco, label, None)
        if number is None:
            raise CalibrationInputError(f"OpenCV has no marker dictionary {label}", "Use for example DICT_4X4_50.")
        if not 0.0 < marker_m < spacing_m < 100.0:
            raise CalibrationInputError(
                f"Markers of {marker_m:g} m cannot stand {spacing_m:g} m apart", "Measure both, in metres."
            )
        self._spacing_m = spacing_m
        half = marker_m / 2.0
        self._corners = np.array([[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]])
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        self.dictionary = cv2.aruco.getPredefinedDictionary(number)
        self._detector = cv2.aruco.ArucoDetector(self.dictionary, parameters)

    def look(self, image: Image, lens: CameraIntrinsics) -> WallSight | None:
        """Where the camera was when it took a picture; None when too few markers can be seen, or they do not fit.

        Args:
            image: BGR.
            lens: of that picture's size.
        """
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        corners, ids, _ = self._detector.detectMarkers(grey)
        # Where nothing was found OpenCV hands out no ids rather than none of them.
        numbers = [int(n) for n in np.asarray(ids).ravel()] if len(corners) else []
        usable = [(n, np.asarray(c, float).reshape(4, 2)) for n, c in zip(numbers, corners, strict=True)]
        usable = [(n, c) for n, c in usable if n < _MOST_MARKERS and numbers.count(n) == 1]
        if len(usable) < LEAST_MARKERS:
            return None
        points = np.vstack([self._corners + np.array([n * self._spacing_m, 0.0, 0.0]) for n, _ in usable])
        return _solved(points, np.vstack([c for _, c in usable]), CameraModel(lens), len(usable))


def _solved(points_m: Matrix, pixels: Matrix, model: CameraModel, markers: int) -> WallSight | None:
    centred = points_m - points_m.mean(axis=0)  # IPPE wants the plane's points around its zero
    found, turn, shift, errors = cv2.solvePnPGeneric(
        centred, pixels, model.matrix, model.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    if not found:
        return None
    best = int(np.argmin(np.asarray(errors).ravel()))
    rotation, translation = cv2.solvePnPRefineLM(
        centred, pixels, model.matrix, model.distortion, turn[best], shift[best]
    )
    projected, _ = cv2.projectPoints(centred, rotation, translation, model.matrix, model.distortion)
    rms = float(np.sqrt(np.mean(np.sum((projected.reshape(-1, 2) - pixels) ** 2, axis=1))))
    camera_from_wall, _ = cv2.Rodrigues(rotation)
    place = -camera_from_wall.T @ translation.ravel() + points_m.mean(axis=0)
    if not (np.isfinite(place).all() and rms <= LARGEST_RMS_PX and place[2] < 0.0):
        return None
    return WallSight(np.asarray(place, dtype=np.float64), rms, markers)
