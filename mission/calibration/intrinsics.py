"""Intrinsics and distortion from pictures of a flat board (Zhang 2000, through OpenCV's calibrateCamera)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from mission.calibration.board import Board, Corners
from mission.camera.camera import Camera
from mission.camera.mounting import Mounting
from mission.errors import CalibrationError, CalibrationInputError
from mission.records import CameraIntrinsics, Image, Matrix

MIN_PICTURES = 8
_SAME_SHARE = 0.02
"""Corners that moved by less than this share of the picture's width make it the same picture again."""
_MAX_FOCAL_SIGMA = 0.01
_MIN_COVERAGE = 0.35
_MIN_TILT_SPREAD_RAD = math.radians(15.0)
"""Boards that all face the lens fit any focal length, at another distance (Zhang 2000, section 3.3)."""
_OUTLIER = 3.0
_OUTLIER_PX = 0.5
_MAX_RMS_PX = 2.0
_VARY = (
    "Take 15 to 20 pictures with the board tilted by 20 to 45 degrees to all sides, near and far, "
    "and some with it in each corner of the picture."
)

Verdict = Literal["used", "no board", "too similar", "outlier", "other size", "unreadable"]


@dataclass(frozen=True, slots=True)
class PictureReport:
    """What became of one picture."""

    name: str
    verdict: Verdict
    corners: int = 0
    rms_px: float | None = None


@dataclass(frozen=True, slots=True)
class BoardCalibration:
    """A calibrated camera and how well the pictures fit it."""

    camera: Camera
    rms_px: float
    focal_sigma: float
    """Relative standard deviation of the focal length, from the fit."""
    coverage: float
    """Share of the picture that the corners of all boards span."""
    pictures: tuple[PictureReport, ...]


def read_pictures(folder: Path | str) -> list[tuple[str, Image | None]]:
    """All pictures of a folder by name, None for those that cannot be read.

    As the sensor gave them: what EXIF says of how the camera was held would turn the lens, too.

    Raises:
        CalibrationError: no such folder, or no pictures in it.
    """
    place = Path(folder)
    if not place.is_dir():
        raise CalibrationInputError(f"There is no folder {folder}", "Give the folder with the pictures of the board.")
    suffixes = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"}
    paths = sorted(path for path in place.iterdir() if path.suffix.lower() in suffixes)
    if not paths:
        raise CalibrationInputError(
            f"There are no pictures in {folder}", "Put PNG or JPEG pictures of the board there."
        )
    pictures: list[tuple[str, Image | None]] = []
    for path in paths:
        image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        pictures.append((path.name, None if image is None else np.asarray(image, dtype=np.uint8)))
    return pictures


def calibrate_board(
    pictures: Iterable[tuple[str, Image | None]], board: Board, mounting: Mounting | None = None
) -> BoardCalibration:
    """Calibrate from pictures of a board.

    Args:
        pictures: name and BGR picture (None: unreadable).
        board: what is in them.
        mounting: of the camera; looking straight ahead when not given.

    Raises:
        CalibrationError: too few or too similar pictures, or a fit that cannot be trusted; the message says what to do.
    """
    reports, found, size = _find(pictures, board)
    if len(found) < MIN_PICTURES:
        counts = ", ".join(f"{sum(r.verdict == v for r in reports)} {v}" for v in ("no board", "too similar"))
        raise CalibrationError(
            f"Only {len(found)} pictures of the board can be used ({counts}), it takes {MIN_PICTURES}",
            _VARY + " Check the numbers of columns and rows (squares, not corners).",
        )
    fit = _fit([corners for _, corners in found], size)
    limit = max(_OUTLIER * float(np.median(fit.per_picture)), _OUTLIER_PX)
    kept = [one for one, rms in zip(found, fit.per_picture, strict=True) if rms <= limit]
    outliers = {name for (name, _), rms in zip(found, fit.per_picture, strict=True) if rms > limit}
    if outliers and len(kept) >= MIN_PICTURES:
        fit = _fit([corners for _, corners in kept], size)
    else:
        kept, outliers = found, set()
    rms_of = {name: float(rms) for (name, _), rms in zip(kept, fit.per_picture, strict=True)}
    reports = [
        replace(one, verdict="outlier") if one.name in outliers else replace(one, rms_px=rms_of.get(one.name))
        for one in reports
    ]
    coverage = _coverage([corners for _, corners in kept], size)
    _judge(fit, coverage)
    note = f"{board.name}, {len(kept)} pictures, rms {fit.rms_px:.2f} px"
    mounted = mounting if mounting is not None else Mounting.tilted(0.0)
    # The fit's own sigma knows nothing of a bent board or of focus; a per mille is as good as it gets.
    camera = Camera(fit.intrinsics, mounted, True, focal_sigma=max(2.0 * fit.focal_sigma, 0.001), provenance=note)
    return BoardCalibration(camera, fit.rms_px, fit.focal_sigma, coverage, tuple(reports))


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    intrinsics: CameraIntrinsics
    rms_px: float
    focal_sigma: float
    per_picture: Matrix
    tilt_spread_rad: float
    """Largest angle between the planes of two boards."""


def _find(
    pictures: Iterable[tuple[str, Image | None]], board: Board
) -> tuple[list[PictureReport], list[tuple[str, Corners]], tuple[int, int]]:
    reports: list[PictureReport] = []
    found: list[tuple[str, Corners]] = []
    size: tuple[int, int] | None = None
    for name, image in pictures:
        if image is None:
            reports.append(PictureReport(name, "unreadable"))
            continue
        picture_size = (int(image.shape[1]), int(image.shape[0]))
        size = size or picture_size
        corners = board.find(image) if picture_size == size else None
        verdict: Verdict = "used"
        if picture_size != size:
            verdict = "other size"
        elif corners is None:
            verdict = "no board"
        elif any(_same(corners, other, size[0]) for _, other in found):
            verdict = "too similar"
        reports.append(PictureReport(name, verdict, 0 if corners is None else len(corners.pixels)))
        if verdict == "used" and corners is not None:
            found.append((name, corners))
    return reports, found, size or (0, 0)


def _same(one: Corners, other: Corners, width_px: int) -> bool:
    shared = {tuple(np.round(point, 6)): pixel for point, pixel in zip(other.board_m, other.pixels, strict=True)}
    moved = [
        float(np.linalg.norm(pixel - shared[key]))
        for point, pixel in zip(one.board_m, one.pixels, strict=True)
        if (key := tuple(np.round(point, 6))) in shared
    ]
    return len(moved) >= 4 and float(np.mean(moved)) < _SAME_SHARE * width_px


def _fit(found: Sequence[Corners], size: tuple[int, int]) -> _Fit:
    fit = _solve(found, size, 0)
    k3, k3_sigma = fit[1][4], fit[2][4]
    if abs(k3) < 3.0 * k3_sigma:  # not seen by these pictures: it would only bend what lies outside of them
        fit = _solve(found, size, cv2.CALIB_FIX_K3)
    matrix, (k1, k2, p1, p2, k3), _, focal_sigma, rms_px, per_picture, spread = fit
    lens = CameraIntrinsics(
        *size, matrix[0, 0], matrix[1, 1], matrix[0, 2] + 0.5, matrix[1, 2] + 0.5, (k1, k2, p1, p2, k3)
    )
    return _Fit(lens, rms_px, focal_sigma, per_picture, spread)


def _solve(
    found: Sequence[Corners], size: tuple[int, int], flags: int
) -> tuple[Matrix, tuple[float, float, float, float, float], tuple[float, ...], float, float, Matrix, float]:
    boards = [corners.board_m.astype(np.float32) for corners in found]
    pixels = [(corners.pixels - 0.5).astype(np.float32) for corners in found]
    try:
        rms, matrix, distortion, turns, _, sigmas, _, per_picture = cv2.calibrateCameraExtended(
            boards, pixels, size, np.eye(3), np.zeros(5), flags=flags
        )
    except cv2.error as error:
        raise CalibrationError(f"The pictures do not determine a camera: {error.err}", _VARY) from None
    k1, k2, p1, p2, k3 = (float(value) for value in np.ravel(distortion)[:5])
    sigma = np.ravel(sigmas)
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    spread = float(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)).max())
    focal_sigma = math.hypot(sigma[0], sigma[1]) / math.sqrt(2.0) / float(matrix[0, 0])
    return (
        np.asarray(matrix, dtype=float),
        (k1, k2, p1, p2, k3),
        tuple(float(value) for value in sigma[4:9]),
        focal_sigma,
        float(rms),
        np.asarray(per_picture, dtype=float).ravel(),
        spread,
    )


def _coverage(found: Sequence[Corners], size: tuple[int, int]) -> float:
    hull = cv2.convexHull(np.concatenate([corners.pixels for corners in found]).astype(np.float32))
    return float(cv2.contourArea(hull)) / (size[0] * size[1])


def _judge(fit: _Fit, coverage: float) -> None:
    if not fit.rms_px <= _MAX_RMS_PX:
        raise CalibrationError(
            f"The corners miss the fitted camera by {fit.rms_px:.1f} px rms",
            "Check columns, rows and square size, that the board is flat, and that the pictures are sharp.",
        )
    if fit.tilt_spread_rad < _MIN_TILT_SPREAD_RAD:
        raise CalibrationError(
            "The pictures are too similar: the board is tilted by at most "
            f"{math.degrees(fit.tilt_spread_rad):.0f} degrees between them, which does not tell the focal length",
            _VARY,
        )
    if not fit.focal_sigma <= _MAX_FOCAL_SIGMA:
        raise CalibrationError(
            f"The pictures are too similar: the focal length stays uncertain by {100.0 * fit.focal_sigma:.1f} %", _VARY
        )
    if coverage < _MIN_COVERAGE:
        raise CalibrationError(
            f"The board was seen in only {100.0 * coverage:.0f} % of the picture's area, so the distortion of the rest "
            "is unknown",
            _VARY,
        )
