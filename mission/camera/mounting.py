"""How the camera sits on the airframe: its direction and its place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mission.pose.buffer import Pose
from mission.records import Vector

Quaternion = tuple[float, float, float, float]
"""w, x, y, z, of unit length."""

_BODY_FROM_LEVEL_CAMERA = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Looking straight ahead: camera z is body forward, camera x is body right, camera y is body down."""


@dataclass(frozen=True, slots=True)
class Mounting:
    """Rotation and lever arm of a fixed camera; body is forward-right-down, camera is right-down-out."""

    body_from_camera_wxyz: Quaternion
    position_body_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The lens, seen from the point whose position the aircraft reports."""

    @classmethod
    def tilted(cls, tilt_down_rad: float, position_body_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mounting:
        """A camera that looks ahead, turned down by an angle (negative: up).

        Args:
            tilt_down_rad: angle between the lens axis and the body's forward axis.
            position_body_m: forward, right, down, metres.
        """
        # About the camera's own x axis, which is the body's right: a positive turn would raise z, hence the sign.
        matrix = _BODY_FROM_LEVEL_CAMERA @ Rotation.from_rotvec([-tilt_down_rad, 0.0, 0.0]).as_matrix()
        return cls(wxyz(Rotation.from_matrix(matrix)), position_body_m)

    @property
    def body_from_camera(self) -> Rotation:
        """As a rotation that acts on vectors."""
        return rotation(self.body_from_camera_wxyz)

    @property
    def tilt_down_rad(self) -> float:
        """Angle of the lens axis below the body's forward-right plane."""
        forward, right, down = self.body_from_camera.apply([0.0, 0.0, 1.0])
        return math.atan2(down, math.hypot(forward, right))

    def world_from_camera_wxyz(self, pose: Pose) -> Quaternion:
        """The camera's attitude in the world (ENU) when the aircraft has this pose."""
        return wxyz(rotation(pose.world_from_body_wxyz) * self.body_from_camera)

    def position_enu_m(self, pose: Pose) -> Vector:
        """Where the lens is, (3,) ENU metres, when the aircraft has this pose."""
        lever: Vector = rotation(pose.world_from_body_wxyz).apply(np.asarray(self.position_body_m))
        return np.asarray(pose.position_enu_m, dtype=float) + lever


def rotation(quaternion_wxyz: Quaternion | Vector) -> Rotation:
    """From w, x, y, z to SciPy's rotation (which counts x, y, z, w)."""
    w, x, y, z = (float(part) for part in quaternion_wxyz)
    return Rotation.from_quat([x, y, z, w])


def wxyz(turned: Rotation) -> Quaternion:
    """From SciPy's rotation to w, x, y, z with w >= 0."""
    x, y, z, w = (float(part) for part in turned.as_quat())
    sign = -1.0 if w < 0.0 else 1.0
    return sign * w, sign * x, sign * y, sign * z
