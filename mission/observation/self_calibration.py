"""The focal length and the camera's tilt from rotation: what the picture turned by against what the log says.

Seen through a lens whose focal length is taken too short, every turn looks too large by the same factor; seen by a
camera that is tilted otherwise than believed, a turn about the vertical is about another of the camera's axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from mission.camera.camera import Camera
from mission.logs.pose_log import PoseLog
from mission.observation.rotation_curve import RotationCurve, TimedTurn
from mission.observation.time_search import STEP_S, log_rates, picture_rates
from mission.records import Matrix, Vector

_ROUNDS = 4
_SMOOTH_S = 0.3
"""Both curves are smoothed alike: the noise of the reports would make every turn look too small."""
_BACKGROUND_M = 10.0
_MOST_TRAVEL = 0.15
"""Apparent turn by travel past things at that distance, over the turn, in what is compared."""
_LEAST_TURN_RAD = math.radians(15.0)
_FLOOR = 0.03
"""A distortion that nobody knows makes turns seem smaller towards the edges: as a pinhole the lens looks longer."""
_MOST_SIGMA = 0.05
_BLOCK_S = 2.0
"""Errors are alike for about so long."""


@dataclass(frozen=True, slots=True)
class FoundLens:
    """A focal length that was measured."""

    camera: Camera
    sigma: float
    """Relative."""
    turned_rad: float
    """How far the camera turned to and fro meanwhile."""


def with_focal_length(camera: Camera, factor: float, sigma: float, note: str) -> Camera:
    """The camera with another focal length.

    Args:
        camera: as it was taken to be.
        factor: new over old focal length.
        sigma: relative uncertainty of the new one.
        note: how it was obtained.
    """
    lens = camera.intrinsics
    intrinsics = replace(lens, fx=lens.fx * factor, fy=lens.fy * factor)
    return replace(camera, intrinsics=intrinsics, focal_sigma=sigma, provenance=note)


def find_focal_length(curve: RotationCurve, log: PoseLog, camera: Camera, offset_s: float) -> FoundLens | None:
    """The focal length under which the picture turns as far as the log says.

    Args:
        curve: of the whole video.
        log: with the attitude.
        camera: a first guess of the lens, to a factor of two.
        offset_s: between video and log, to 0.1 s.

    Returns:
        None where the flight turned too little to tell to 5 %.
    """
    if log.pointing is None:
        return None
    now = camera
    slope = _Slope(1.0, math.inf, 0.0)
    for _ in range(_ROUNDS):
        found = _slope(curve.turns(now), log, now, offset_s)
        if found is None:
            return None
        slope = found
        now = with_focal_length(now, float(np.clip(slope.gain, 0.5, 2.0)), slope.sigma, "")
        if abs(slope.gain - 1.0) < 5e-4:
            break
    sigma = math.hypot(slope.sigma, _FLOOR)
    if sigma > _MOST_SIGMA or slope.turned_rad < _LEAST_TURN_RAD:
        return None
    width, focal = now.intrinsics.width_px, now.intrinsics.fx
    view_deg = 2.0 * math.degrees(math.atan(width / 2.0 / focal))
    note = f"focal length from the flight's own turns ({view_deg:.1f} deg of view, to {100.0 * sigma:.1f} %)"
    return FoundLens(with_focal_length(now, 1.0, sigma, note), sigma, slope.turned_rad)


@dataclass(frozen=True, slots=True)
class _Slope:
    gain: float
    sigma: float
    turned_rad: float


def _slope(turns: Sequence[TimedTurn], log: PoseLog, camera: Camera, offset_s: float) -> _Slope | None:
    """Picture over log by least squares, about the two axes across the line of sight.

    A roll about the lens's axis looks the same through any lens, so it is left out.
    """
    seen, told, known = _aligned(turns, log, camera, offset_s)
    if np.count_nonzero(known) < 20:
        return None
    known &= _turns_more_than_it_passes(turns, told, log, offset_s)
    if np.count_nonzero(known) < 10:
        return None
    seen, told = seen[known][:, :2], told[known][:, :2]
    power = float(np.sum(told**2))
    if power < 1e-9:
        return None
    gain = float(np.sum(seen * told)) / power
    if not 0.2 < gain < 5.0:
        return None
    # Residuals in blocks, each taken as one number: neighbours err alike.
    size = max(1, round(_BLOCK_S / STEP_S))
    score = np.sum((seen - gain * told) * told, axis=1)
    blocks = np.add.reduceat(score, np.arange(0, len(score), size))
    sigma = float(np.sqrt(np.sum(blocks**2))) / power / gain
    turned = float(np.ptp(np.cumsum(told, axis=0) * STEP_S, axis=0).max())
    return _Slope(gain, sigma, turned)


def _turns_more_than_it_passes(
    turns: Sequence[TimedTurn], told: Matrix, log: PoseLog, offset_s: float
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Where (n,) the picture moves by rotation rather than by travel past things at an ordinary distance.

    Who flies sideways and keeps a target in view turns against the travel all the time: the near background then seems
    to turn less, which would be taken for a longer lens.
    """
    t_s = turns[0].from_s + STEP_S * (np.arange(len(told)) + 0.5) - offset_s
    speed = np.linalg.norm(
        np.column_stack([np.interp(t_s, log.positions.t_s, axis) for axis in log.positions.velocity_m_s.T]), axis=1
    )
    return np.asarray(speed / _BACKGROUND_M < _MOST_TRAVEL * np.linalg.norm(told[:, :2], axis=1), dtype=np.bool_)


def _aligned(
    turns: Sequence[TimedTurn], log: PoseLog, camera: Camera, offset_s: float
) -> tuple[Matrix, Matrix, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Smoothed rates (n, 3) of the picture and of the log on one grid, and where both are known."""
    assert log.pointing is not None
    picture, reported = picture_rates(turns), log_rates(log.pointing, camera)
    t_s = picture.start_s + STEP_S * (np.arange(len(picture.known)) + 0.5) - offset_s
    grid = reported.start_s + STEP_S * (np.arange(len(reported.known)) + 0.5)
    if len(grid) < 2 or len(t_s) < 2:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=bool)
    told = np.column_stack([np.interp(t_s, grid, reported.rate[:, axis]) for axis in range(3)])
    both = (np.interp(t_s, grid, reported.known, left=0.0, right=0.0) > 0.99) & (picture.known > 0.5)
    sigma = _SMOOTH_S / STEP_S

    def smoothed(rate: Matrix) -> Matrix:
        weight = gaussian_filter1d(both.astype(float), sigma)
        return np.asarray(
            gaussian_filter1d(np.where(both[:, None], rate, 0.0), sigma, axis=0) / np.maximum(weight, 1e-6)[:, None]
        )

    whole = gaussian_filter1d(both.astype(float), sigma) > 0.9
    return smoothed(picture.rate), smoothed(told), whole & both


def find_tilt(turns: Sequence[TimedTurn], log: PoseLog, camera: Camera, offset_s: float) -> tuple[float, float] | None:
    """How far the camera is tilted down more than its mounting says, and its sigma, radians.

    Only for a camera that is fixed on the airframe and looks ahead. Turns of the heading tell it: seen by a camera that
    is tilted by an angle, they are about its vertical and its optical axis in the ratio of cosine to sine.

    Returns:
        None where the flight turned too little to tell to 2 degrees.
    """
    if log.pointing is None or log.gimbal is not None:
        return None
    seen, told, known = _aligned(turns, log, camera, offset_s)
    if np.count_nonzero(known) < 20:
        return None
    seen, told = seen[known], told[known]
    total, shares = 0.0, (0.0, 0.0)
    for _ in range(3):
        turned = Rotation.from_rotvec([total, 0.0, 0.0]).apply(told)
        across = np.column_stack([turned[:, 1], turned[:, 2]])
        off = np.column_stack([seen[:, 1], seen[:, 2]]) - across
        slope = np.column_stack([-turned[:, 2], turned[:, 1]])
        power = float(np.sum(slope**2))
        if power < 1e-4:
            return None
        score = np.sum(off * slope, axis=1)
        total += float(np.sum(score)) / power
        size = max(1, round(_BLOCK_S / STEP_S))
        blocks: Vector = np.add.reduceat(score, np.arange(0, len(score), size))
        shares = float(np.sqrt(np.sum(blocks**2))) / power, power
    sigma = math.hypot(shares[0], math.radians(0.3))
    return None if sigma > math.radians(2.0) else (total, sigma)
