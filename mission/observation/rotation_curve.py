"""How the picture turned over a whole video, kept as matched points, so that it can be told again for another lens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mission.camera.camera import Camera
from mission.camera.model import CameraModel
from mission.observation.file_video import Picture
from mission.pose.buffer import Pose
from mission.records import Vector
from mission.timing.background_rotation import BackgroundRotation, Turn, rotation_between

INTERVAL_S = 0.08
"""Between pictures that are compared, at least: slower turns are measured better over longer, quick ones are lost."""
MOST_GAP_S = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """Points of the background in two pictures, pixels."""

    from_s: float
    to_s: float
    before_px: NDArray[np.float32]
    """(n, 2); many are kept, to a thousandth of a pixel."""
    now_px: NDArray[np.float32]
    """(n, 2)."""


@dataclass(frozen=True, slots=True, eq=False)
class TimedTurn:
    """How the camera turned between two times of the video."""

    from_s: float
    to_s: float
    turn: Turn


class RotationCurve:
    """Compares pictures as they come; about 1.5 ms a picture.

    Args:
        camera: as it is known now.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._background = BackgroundRotation(camera.intrinsics, camera.mounting)
        self._last_s: float | None = None
        self.pairs: list[Matched] = []
        """In order of time."""

    def add(self, picture: Picture) -> None:
        """Take in a picture, unless one has just been."""
        if self._last_s is not None:
            since_s = picture.t_s - self._last_s
            if since_s < INTERVAL_S - 1e-6:
                return
            if since_s > MOST_GAP_S:
                self._background.restart()
        self._background.measure_small(picture.grey(*self._background.work_size))
        matched = self._background.matched
        if matched is not None and self._last_s is not None:
            before, now = matched
            self.pairs.append(Matched(self._last_s, picture.t_s, before.astype(np.float32), now.astype(np.float32)))
        self._last_s = picture.t_s

    def turns(self, camera: Camera, pose_at: Callable[[float], Pose | None] | None = None) -> list[TimedTurn]:
        """The camera's turns as seen through a lens.

        Args:
            camera: the lens, and the mounting that tells where down is.
            pose_at: the carrier's pose at a time of the video, where it is known by now: tells where down is on a
                gimbal.
        """
        model = CameraModel(camera.intrinsics)
        level: Vector = camera.mounting.body_from_camera.inv().apply([0.0, 0.0, 1.0])
        found = []
        for pair in self.pairs:
            down = level
            pose = None if pose_at is None else pose_at(0.5 * (pair.from_s + pair.to_s))
            if pose is not None:
                body = Rotation.from_quat(pose.world_from_body_wxyz, scalar_first=True)
                down = (body * camera.mounting.body_from_camera).inv().apply([0.0, 0.0, -1.0])
            turn, _ = rotation_between(pair.before_px.astype(float), pair.now_px.astype(float), model, down)
            if turn is not None:
                found.append(TimedTurn(pair.from_s, pair.to_s, turn))
        return found
