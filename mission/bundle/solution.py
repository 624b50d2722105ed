"""What steadying a sidestep gives: the camera's pose at every frame, how good it is, and what people want to see."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mission.bundle.rotations import exponential
from mission.records import Matrix, NoiseModel, Vector

_NORTH_TOLD_RAD = math.radians(2.0)
"""What a compass is off by is no news."""
PoseSource = Literal["attitude", "steadied"]
"""attitude: as the aircraft reports it, at most corrected as its neighbours are; steadied: from the frame's points."""


@dataclass(frozen=True, slots=True, eq=False)
class AdjustedPose:
    """The camera at one frame."""

    t_s: float
    """The frame's time as the video tells it."""
    position_enu_m: Vector
    """(3,)."""
    world_from_camera: Matrix
    """(3, 3)."""
    velocity_enu_m_s: Vector
    """(3,)."""
    turn_rate_rad_s: Vector
    """(3,), camera axes."""
    source: PoseSource
    points: int
    """Background points that it was fixed by."""


def rows_at(poses: Sequence[AdjustedPose], delay_s: Vector) -> tuple[Matrix, Matrix]:
    """Positions (n, 3) and world_from_camera quaternions (n, 4) a few milliseconds later, when rows were exposed.

    Args:
        poses: n of them.
        delay_s: (n,) since each pose.
    """
    if not poses:
        return np.zeros((0, 3)), np.zeros((0, 4))
    later = delay_s[:, None]
    turned = np.stack([pose.world_from_camera for pose in poses])
    turned = turned @ exponential(later * np.stack([pose.turn_rate_rad_s for pose in poses]))
    moved = later * np.stack([pose.velocity_enu_m_s for pose in poses])
    wxyz: Matrix = Rotation.from_matrix(turned).as_quat(scalar_first=True)
    return np.stack([pose.position_enu_m for pose in poses]) + moved, wxyz


@dataclass(frozen=True, slots=True, eq=False)
class PointTrails:
    """Where the background's points were, for pictures."""

    t_s: Vector
    """(n,) frame's time as the video tells it."""
    track: NDArray[np.intp]
    """(n,)."""
    pixel: Matrix
    """(n, 2), (0, 0) = outer corner of the top left pixel."""
    still: NDArray[np.bool_]
    """(n,) whether the point belongs to the still background."""


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeCurves:
    """The camera's attitude over the flight, reported and steadied; k frames."""

    t_s: Vector
    """(k,) as the video tells it."""
    reported_rad: Matrix
    """(k, 3): heading of the optical axis clockwise from north, its elevation, roll about it."""
    steadied_rad: Matrix
    """(k, 3), the same."""
    points: NDArray[np.intp]
    """(k,) background points that each frame was fixed by."""


@dataclass(frozen=True, slots=True, eq=False)
class BundleSolution:
    """The result; with `reason` set everything is as reported."""

    poses: tuple[AdjustedPose, ...]
    noise: NoiseModel
    """What the poses' errors are now."""
    curves: AttitudeCurves | None
    trails: PointTrails | None
    residual_px: float
    """Root mean square residual of the background's points per axis."""
    still_share: float
    """Share of the points' sightings that agree with a world that stands still; NaN where that was not found out."""
    reason: str | None = None
    """Why the telemetry's attitude was used as it is; None where it was steadied."""
    north_rad: float = 0.0
    """By how much the reported headings of the camera were off, clockwise positive, by the way that was flown."""
    north_sigma_rad: float = math.inf
    """How well the way that was flown tells north."""

    def note(self) -> str:
        """For the flight's log, in one sentence."""
        if self.reason is not None:
            return f"Attitude as the aircraft reports it, not steadied by the background: {self.reason}"
        frames = sum(pose.source == "steadied" for pose in self.poses)
        north = ""
        if abs(self.north_rad) > max(_NORTH_TOLD_RAD, 3.0 * self.north_sigma_rad):
            north = (
                f"; the reported heading of the camera was {math.degrees(self.north_rad):+.1f} degrees off "
                f"(+-{math.degrees(self.north_sigma_rad):.1f}), by the way that was flown"
            )
        return (
            f"Attitude and path steadied by the background in {frames} of {len(self.poses)} frames "
            f"({self.residual_px:.2f} px, {100.0 * self.still_share:.0f} % of the points stand still){north}"
        )


def not_adjusted(
    noise: NoiseModel, reason: str, trails: PointTrails | None = None, still_share: float = math.nan
) -> BundleSolution:
    """The answer where the pictures do not help."""
    return BundleSolution((), noise, None, trails, math.nan, still_share, reason)
