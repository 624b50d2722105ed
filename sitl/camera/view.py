"""What a picture should show: where each person's middle is in it, and how tall the body appears."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.records import Box, CameraIntrinsics, Vector
from sitl.camera.lens import project
from sitl.camera.renderer import CameraPose
from sitl.people.world import World

_NEAREST_M = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class PersonView:
    """One person in a picture."""

    centroid_enu_m: Vector
    """(3,): area-weighted centroid of the posed body's surface: what estimates are scored against."""
    pixel: tuple[float, float]
    """Where that point appears (distorted picture, (0, 0) = outer corner of the top left pixel)."""
    height_px: float
    """From the body's highest to its lowest point in the picture."""
    box: Box
    """Around the whole body, also where it is hidden or out of the picture."""
    depth_m: float
    """Along the optical axis."""
    in_picture: bool
    """Whether the whole box lies within the picture."""


def view_person(
    world: World,
    i: int,
    pose: CameraPose,
    camera: CameraIntrinsics,
    t_s: float,
    started_s: float | None,
    scene_started_s: float | None = None,
) -> PersonView | None:
    """Person i as the camera sees them at `t_s`, without rolling shutter; None when partly behind the camera."""
    surface = world.person_surface(i, t_s, started_s, scene_started_s)
    centroid = world.body.surface_centroid(surface)
    points = (np.vstack([surface, centroid]) - pose.position_enu_m) @ pose.world_from_camera
    if points[:, 2].min() < _NEAREST_M:
        return None
    pixels = project(points, camera)
    low, high = pixels[:-1].min(axis=0), pixels[:-1].max(axis=0)
    box = Box(float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1]))
    inside = low[0] >= 0.0 and low[1] >= 0.0 and high[0] <= camera.width_px and high[1] <= camera.height_px
    return PersonView(
        centroid_enu_m=centroid,
        pixel=(float(pixels[-1, 0]), float(pixels[-1, 1])),
        height_px=box.height_px,
        box=box,
        depth_m=float(points[-1, 2]),
        in_picture=bool(inside),
    )
