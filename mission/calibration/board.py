"""Calibration boards: where the corners of a chessboard or a ChArUco board are in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from mission.errors import CalibrationInputError
from mission.records import Image, Matrix

_MIN_CORNERS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """A board found in a picture."""

    board_m: Matrix
    """(N, 3) corners on the board, z = 0."""
    pixels: Matrix
    """(N, 2), (0, 0) = outer corner of the top left pixel."""


class Board(Protocol):
    """A flat pattern of known size."""

    @property
    def name(self) -> str:
        """For the report."""
        ...

    def find(self, image: Image) -> Corners | None:
        """The board's corners in a BGR picture; None when it is not (wholly enough) there."""
        ...


class Chessboard:
    """A chessboard; all inner corners must be visible.

    Args:
        columns: squares in a row.
        rows: squares in a column.
        square_m: side of a square.

    Raises:
        CalibrationInputError: fewer than 4 squares a side, or no size.
    """

    def __init__(self, columns: int, rows: int, square_m: float) -> None:
        _check(columns, rows, square_m)
        self._inner = columns - 1, rows - 1
        across, down = np.meshgrid(np.arange(columns - 1), np.arange(rows - 1))
        corners = np.column_stack([across.ravel(), down.ravel(), np.zeros(across.size)]) * square_m
        self._points: Matrix = np.asarray(corners, dtype=np.float64)

    @property
    def name(self) -> str:
        """For the report."""
        return "chessboard"

    def find(self, image: Image) -> Corners | None:
        """All inner corners, or None."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCornersSB(grey, self._inner, flags=flags)
        if not found:
            return None
        return Corners(self._points, np.asarray(corners, dtype=float).reshape(-1, 2) + 0.5)


class CharucoBoard:
    """A ChArUco board, of which a part is enough.

    Args:
        columns: squares in a row.
        rows: squares in a column.
        square_m: side of a square.
        marker_m: side of a marker.
        dictionary: OpenCV's name of the marker dictionary, such as ``DICT_5X5_100``.

    Raises:
        CalibrationInputError: an impossible board or an unknown dictionary.
    """

    def __init__(self, columns: int, rows: int, square_m: float, marker_m: float, dictionary: str) -> None:
        _check(columns, rows, square_m)
        if not 0.0 < marker_m < square_m:
            raise CalibrationInputError("The markers of a ChArUco board must be smaller than its squares")
        label = dictionary.upper() if dictionary.upper().startswith("DICT_") else f"DICT_{dictionary.upper()}"
        number = getattr(cv2.aruco, label, None)
        if number is None:
            raise CalibrationInputError(f"OpenCV has no marker dictionary {label}", "Use for example DICT_5X5_100.")
        markers = cv2.aruco.getPredefinedDictionary(number)
        self.board = cv2.aruco.CharucoBoard((columns, rows), square_m, marker_m, markers)
        self._detector = cv2.aruco.CharucoDetector(self.board)

    @property
    def name(self) -> str:
        """For the report."""
        return "ChArUco board"

    def find(self, image: Image) -> Corners | None:
        """The chessboard corners between the markers seen, eight at least."""
        corners, ids, _, _ = self._detector.detectBoard(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        if ids is None or len(ids) < _MIN_CORNERS:
            return None
        points = np.asarray(self.board.getChessboardCorners(), dtype=float)[np.asarray(ids).ravel()]
        if np.linalg.matrix_rank(points[:, :2] - points[0, :2]) < 2:
            return None  # all in one row: says nothing about the view
        return Corners(points, np.asarray(corners, dtype=float).reshape(-1, 2) + 0.5)


def _check(columns: int, rows: int, square_m: float) -> None:
    if columns < 4 or rows < 4:
        raise CalibrationInputError(f"A board of {columns} x {rows} squares is too small", "Use 4 x 4 squares or more.")
    if not square_m > 0.0:
        raise CalibrationInputError("The squares of the board have no size", "Measure one and give it in millimetres.")
