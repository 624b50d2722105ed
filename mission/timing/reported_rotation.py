"""What the attitude reports say about a rotation, on a fine grid of times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter1d

from mission.camera.camera import Camera
from mission.pose.buffer import Pose
from mission.records import Matrix, Vector
from mission.sighting import cameras_at

_GRID_S = 0.01
SMOOTH_S = 0.04
"""Standard deviation of the smoothing of the reports: quicker than any turn of an aircraft that carries a camera."""


@dataclass(frozen=True, slots=True, eq=False)
class ReportedRotation:
    """What the telemetry says about the camera's rotation, on a fine grid of times."""

    times_s: Vector
    angle_rad: Matrix
    """(N, 3): rotation about the camera's own axes, added up since the first time."""
    gaps: Vector
    """(N,): how many unknown steps there were up to here."""

    @classmethod
    def collect(
        cls, pose_at: Callable[[float], Pose | None], camera: Camera, from_s: float, to_s: float
    ) -> ReportedRotation:
        """Ask for the attitude all along a span of time."""
        times = np.arange(from_s, to_s + _GRID_S, _GRID_S)
        poses = [pose_at(float(t_s)) for t_s in times]
        known = np.array([pose is not None for pose in poses])
        steps = np.zeros((len(times), 3))
        if np.count_nonzero(known) > 1:
            world_from_camera, _ = cameras_at([pose for pose in poses if pose is not None], camera)
            steps[np.flatnonzero(known)[1:]] = (world_from_camera[:-1].inv() * world_from_camera[1:]).as_rotvec()
        # The reports' own noise, interpolated, would make one offset look better than the next; a symmetric smoothing
        # takes it away and moves no edge. Seen through the smoothing, an unknown step spoils its surroundings too.
        angle = gaussian_filter1d(np.cumsum(steps, axis=0), SMOOTH_S / _GRID_S, axis=0, mode="nearest", truncate=3.0)
        unknown = binary_dilation(~known, iterations=round(3.0 * SMOOTH_S / _GRID_S))
        return cls(times, angle, np.cumsum(unknown).astype(float))

    def known(self, spans: Matrix) -> NDArray[np.bool_]:
        """Which time spans (N, 2) are covered without a gap."""
        first = np.searchsorted(self.times_s, spans[:, 0], side="right") - 1
        last = np.searchsorted(self.times_s, spans[:, 1])
        inside = (first >= 0) & (last < len(self.times_s))
        first, last = np.clip(first, 0, None), np.clip(last, None, len(self.times_s) - 1)
        covered: NDArray[np.bool_] = inside & (self.gaps[last] == self.gaps[first])
        return covered

    def turn(self, spans: Matrix, axis: Vector) -> Vector:
        """Rotation (N,) about an axis (3,) of the camera's in each time span (N, 2)."""
        angle = self.angle_rad @ axis
        begun, ended = (np.interp(times, self.times_s, angle) for times in spans.T)
        return np.asarray(ended - begun)
