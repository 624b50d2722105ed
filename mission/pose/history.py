"""Poses as they were known at one moment, for work that goes on in another thread."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from mission.clock import ClockMap
from mission.gimbal.listener import GimbalAt
from mission.pose.buffer import Pose, PoseBuffer
from mission.records import Matrix


@dataclass(frozen=True, slots=True, eq=False)
class PoseHistory:
    """A snapshot of an aircraft's poses, and of where its clock stands against ours."""

    poses: PoseBuffer
    clock: ClockMap
    position_covariance_m2: Matrix
    """(3, 3)."""
    attitude_covariance_rad2: Matrix
    """(3, 3), about the body's forward, right and down axes."""
    gimbal: GimbalAt | None = None
    """Where the camera is on a gimbal."""

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, Matrix]) -> PoseHistory:
        """From stored `PoseBuffer.rows`, `ClockMap.line` (not numbers where nothing was heard) and covariances.

        Args:
            arrays: positions, attitudes, clock, position_covariance, attitude_covariance.
        """
        line = arrays["clock"].tolist()
        clock = ClockMap() if math.isnan(line[0]) else ClockMap.on_line((line[0], line[1], line[2]))
        poses = PoseBuffer.of_rows(arrays["positions"], arrays["attitudes"])
        return cls(poses, clock, arrays["position_covariance"], arrays["attitude_covariance"])

    def at(self, t_s: float) -> Pose | None:
        """The pose at a program time; None where it was not known at the moment of the snapshot."""
        if not self.clock.ready:
            return None
        remote_s = self.clock.to_remote(t_s)
        pose = self.poses.at(remote_s, self.position_covariance_m2, self.attitude_covariance_rad2)
        if pose is None or self.gimbal is None:
            return None if pose is None else replace(pose, t_s=t_s)
        turned = self.gimbal(t_s, self.clock.to_remote, self.poses.attitude_at)
        return None if turned is None else replace(pose, t_s=t_s, world_from_gimbal_wxyz=turned)
