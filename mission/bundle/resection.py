"""The camera at every frame from points that are known by now: one small robust least-squares problem a frame.

Between the key frames of the bundle the corrections are interpolated; from there each frame's own points move its
pose to where they fit best, all frames at once (motion-only bundle adjustment). Where a frame shows too few points,
the interpolated correction stands: the telemetry bridges it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.bundle.adjustment import AdjustedBundle, camera_equations
from mission.bundle.projection import Cameras, Rows, corrected, interpolated, linearise_cameras, residuals
from mission.bundle.rotations import exponential
from mission.bundle.row_weights import length2_of, row_weights
from mission.records import Matrix, Vector

_ROUNDS = 3
_TURN_SIGMA = 0.005
_PLACE_SIGMA_M = 0.03
"""How far a frame may be from the correction between its neighbours: a slow error hardly moves within 0.2 s."""
LEAST_POINTS = 12


@dataclass(frozen=True, slots=True, eq=False)
class Resection:
    """The cameras at all frames."""

    cameras: Cameras
    turn: NDArray[np.float64]
    """(k, 3, 3), rotations in front of the reported attitudes."""
    points: NDArray[np.intp]
    """(k,) points that each frame was fixed by; 0 where its neighbours' correction stands."""
    residual: Vector
    """(k,) root mean square of their residuals per axis, tangents; NaN where there are none."""


def resect(
    reported: Cameras, bundle: AdjustedBundle, turn: NDArray[np.float64], place: Matrix, rows: Rows
) -> Resection:
    """Fix every frame.

    Args:
        reported: the cameras at all k frames as reported.
        bundle: points and key frames.
        turn: (b, 3, 3), the key frames' rotations in front of the reported attitudes.
        place: (b, 3), the key frames' offsets of the reported positions.
        rows: the bundle's points in all frames.
    """
    count = len(reported.t_s)
    turn, place = interpolated(bundle.cameras.t_s, turn, place, reported.t_s)
    number = np.bincount(rows.frame, minlength=count)
    fixed = number >= LEAST_POINTS
    rows = rows.only(fixed[rows.frame])
    cameras = corrected(reported, turn, place)
    damping = np.repeat([_TURN_SIGMA**-2, _PLACE_SIGMA_M**-2], 3)
    moved = np.zeros((count, 6))
    weight = np.zeros(len(rows.frame))
    for _ in range(_ROUNDS):
        residual, by_camera = linearise_cameras(cameras, bundle.landmarks, rows)
        length2 = length2_of(residual.T)
        weight = row_weights(length2, 4.0 * bundle.scale, bundle.scale, rows.point) / bundle.scale**2
        root = np.sqrt(weight)
        own, pull = camera_equations(root * by_camera, root * np.nan_to_num(residual), rows.frame, count)
        step = np.linalg.solve(own + np.diag(damping), (pull - damping * moved)[:, :, None])[:, :, 0]
        moved = moved + step
        turn, place = exponential(np.asarray(step[:, :3], dtype=np.float64)) @ turn, place + step[:, 3:]
        cameras = corrected(reported, turn, place)
    residual = residuals(cameras, bundle.landmarks, rows).T
    good = (weight * bundle.scale**2 > 0.25) & np.isfinite(residual[:, 0])
    points = np.bincount(rows.frame[good], minlength=count)
    square = np.bincount(rows.frame[good], length2_of(residual)[good], minlength=count)
    with np.errstate(invalid="ignore", divide="ignore"):
        rms = np.sqrt(square / (2.0 * points))
    return Resection(cameras, turn, points, rms)
