"""The paper's way to a focal length: one object at a known place (Kim & Yow 2015, Table I, theta/p)."""

from __future__ import annotations

import math

from mission.camera.camera import Camera
from mission.camera.mounting import Mounting
from mission.errors import CalibrationError, CalibrationInputError
from mission.records import CameraIntrinsics

_DISTANCE_SIGMA_M = 0.01
_PIXEL_SIGMA_PX = 2.0


def calibrate_theta(
    depth_m: float, side_m: float, offset_px: float, width_px: int, height_px: int, mounting: Mounting | None = None
) -> Camera:
    """A pinhole camera from one sighting: f = offset / tan(theta), tan(theta) = side / depth.

    The paper's object stands at 0.92 m depth and 0.57 m to the side, at the edge of a 640 px picture, 320 px from the
    middle: f = 516.5 px. (Its table prints arctan(Z/P) for what is arctan(P/Z).) Square pixels, the axis in the middle
    and no distortion are assumed, so this is far less than a board tells, and `focal_sigma` says so.

    Args:
        depth_m: from the lens to the object along the lens axis.
        side_m: from the axis to the object, horizontally.
        offset_px: from the picture's middle to the object, horizontally.
        width_px: width of the picture.
        height_px: height of the picture.
        mounting: of the camera; looking straight ahead when not given.

    Raises:
        CalibrationError: a distance that is not positive, an object outside of the picture, or one so near to the
            middle that it says little.
    """
    for name, value in (("depth", depth_m), ("side distance", side_m), ("pixel offset", offset_px)):
        if not (math.isfinite(value) and value > 0.0):
            raise CalibrationInputError(f"The {name} {value} is not a positive number", "Measure it again.")
    if width_px < 16 or height_px < 16:
        raise CalibrationInputError(f"A picture of {width_px} x {height_px} px is too small", "Check width and height.")
    if offset_px > width_px / 2.0:
        raise CalibrationInputError(
            f"{offset_px:.0f} px from the middle is outside of a picture {width_px} px wide",
            "Count the pixels from the middle of the picture to the object.",
        )
    sigma = math.hypot(_DISTANCE_SIGMA_M / depth_m, _DISTANCE_SIGMA_M / side_m, _PIXEL_SIGMA_PX / offset_px)
    if sigma > 0.1:
        raise CalibrationError(
            f"The focal length would be uncertain by {100.0 * sigma:.0f} %",
            "Put the object further to the side, near the picture's edge, and measure larger distances.",
        )
    focal = offset_px * depth_m / side_m
    lens = CameraIntrinsics(width_px, height_px, focal, focal, width_px / 2.0, height_px / 2.0)
    mounted = mounting if mounting is not None else Mounting.tilted(0.0)
    note = f"object at {depth_m} m depth, {side_m} m aside, {offset_px} px from the middle"
    return Camera(lens, mounted, True, focal_sigma=sigma, provenance=note)
