"""From a tracked frame and the aircraft's pose to a sighting: the record that the estimators get."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from mission.camera.camera import Camera
from mission.camera.model import CameraModel
from mission.camera.mounting import Mounting
from mission.pose.buffer import Pose
from mission.records import Matrix, Sighting, Vector
from mission.track import Track


def world_from_camera(pose: Pose, camera: Camera) -> Rotation:
    """How the camera was turned: the attitude of what carries it, then the mounting on that.

    Raises:
        ValueError: the camera is on a gimbal of which the pose tells nothing.
    """
    return cameras_at((pose,), camera)[0][0]


def camera_position(pose: Pose, camera: Camera) -> Vector:
    """Where the camera was, ENU, shape (3,); of one on a gimbal, where the gimbal's pivot was."""
    body = Rotation.from_quat(pose.world_from_body_wxyz, scalar_first=True)
    return np.asarray(pose.position_enu_m + body.apply(np.asarray(camera.mounting.position_body_m)))


def cameras_at(poses: Sequence[Pose], camera: Camera) -> tuple[Rotation, Matrix]:
    """World_from_camera and ENU positions (n, 3) of many poses at once.

    Raises:
        ValueError: the camera is on a gimbal of which a pose tells nothing.
    """
    body = Rotation.from_quat(np.array([pose.world_from_body_wxyz for pose in poses]), scalar_first=True)
    carrier = body if camera.gimbal == "none" else Rotation.from_quat(_gimbals(poses), scalar_first=True)
    turned = carrier * Rotation.from_quat(camera.mounting.body_from_camera_wxyz, scalar_first=True)
    place = np.array([pose.position_enu_m for pose in poses]) + body.apply(np.asarray(camera.mounting.position_body_m))
    return turned, np.asarray(place, dtype=np.float64)


def level_mounting(pose: Pose | None, camera: Camera) -> Mounting:
    """How the camera sits on a level aircraft that it looks ahead from; of a gimbal's camera, as it looks now."""
    if camera.gimbal == "none" or pose is None:
        return camera.mounting
    up = float(world_from_camera(pose, camera).apply([0.0, 0.0, 1.0])[2])
    return Mounting.tilted(-math.asin(min(1.0, max(-1.0, up))), camera.mounting.position_body_m)


def _gimbals(poses: Sequence[Pose]) -> Matrix:
    told = [pose.world_from_gimbal_wxyz for pose in poses if pose.world_from_gimbal_wxyz is not None]
    if len(told) < len(poses):
        raise ValueError("the camera is on a gimbal, and the aircraft's pose does not tell the gimbal's attitude")
    return np.array(told)


def sighting(track: Track, t_s: float, pose: Pose, camera: Camera) -> Sighting:
    """The sighting of a track at the time `t_s` at which its row was exposed, with the pose of that time."""
    return sighting_from(
        track, t_s, camera_position(pose, camera), world_from_camera(pose, camera).as_quat(scalar_first=True)
    )


def sighting_from(track: Track, t_s: float, position_enu_m: Vector, world_from_camera_wxyz: Vector) -> Sighting:
    """The same with the camera's own place, ENU (3,), and its attitude as a quaternion (4,)."""
    east, north, up = position_enu_m.tolist()
    w, x, y, z = world_from_camera_wxyz.tolist()
    return Sighting(
        t_s=t_s,
        position_enu_m=(east, north, up),
        world_from_camera_wxyz=(w, x, y, z),
        pixel=(float(track.pixel[0]), float(track.pixel[1])),
        height_px=track.height_px,
        pixel_sigma_px=track.pixel_sigma_px,
        size_sigma=track.size_sigma,
    )


def azimuth_of(pixel: tuple[float, float], pose: Pose, camera: Camera) -> float:
    """Azimuth of a pixel's line of sight, radians clockwise from north."""
    ray = world_from_camera(pose, camera).apply(CameraModel(camera.intrinsics).ray(np.array(pixel)))
    return float(np.arctan2(ray[0], ray[1]))


def roll_of(pose: Pose, camera: Camera) -> float:
    """Roll of the camera about its optical axis, radians, positive with the right side of the picture down."""
    right, down = world_from_camera(pose, camera).apply([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return float(np.arctan2(-right[2], -down[2]))


def rotation_shift(pixel: tuple[float, float], before: Pose, now: Pose, camera: Camera) -> tuple[float, float]:
    """How far a distant point at `pixel` moves in the image by the camera's rotation alone, pixels (x, y)."""
    model = CameraModel(camera.intrinsics)
    world = world_from_camera(before, camera).apply(model.ray(np.array(pixel)))
    turned = world_from_camera(now, camera).inv().apply(world)
    if turned[2] <= 0.1:
        return 0.0, 0.0
    x, y = model.project(turned).tolist()
    return x - pixel[0], y - pixel[1]
