"""One camera: its lens, how it is mounted, how late and how slowly it delivers, and how well all that is known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from mission.camera.model import from_field_of_view
from mission.camera.mounting import Mounting
from mission.errors import CalibrationError, CalibrationInputError
from mission.records import CameraIntrinsics, NoiseModel

GimbalKind = Literal["none", "mavlink"]
"""none: fixed to the airframe. mavlink: on a gimbal that reports its attitude by MAVLink."""
CALIBRATED_FOCAL_SIGMA = 0.003
UNCALIBRATED_FOCAL_SIGMA = 0.05
"""Data sheets quote the diagonal for the horizontal view, or the photo's for the video's: 5 % is the usual damage."""


@dataclass(frozen=True, slots=True)
class Camera:
    """One camera: its lens, how it is mounted, how late and how slowly it delivers, and how well all that is known."""

    intrinsics: CameraIntrinsics
    mounting: Mounting
    calibrated: bool
    readout_s: float = 0.0
    """Time from the first to the last row of a rolling shutter."""
    latency_s: float = 0.0
    """From the middle of the exposure until the picture arrives, of the fastest pictures."""
    focal_sigma: float = CALIBRATED_FOCAL_SIGMA
    """Relative uncertainty of the focal length; it stands for the whole lens (see `widen`)."""
    provenance: str = ""
    """How the figures were obtained."""
    gimbal: GimbalKind = "none"
    """What the mounting is on: the airframe, or a gimbal that tells its attitude."""
    gimbal_age_s: float = 0.0
    """How much older the gimbal's angles are than their time stamps."""

    @classmethod
    def from_field_of_view(
        cls,
        width_px: int,
        height_px: int,
        hfov_rad: float,
        mounting: Mounting | None = None,
        readout_s: float = 0.0,
        latency_s: float = 0.0,
    ) -> Camera:
        """A camera without a calibration; `calibrated` is False, and callers warn and use `widen`.

        Args:
            width_px: width of the picture.
            height_px: height of the picture.
            hfov_rad: full horizontal angle of view.
            mounting: looking straight ahead when not given.
            readout_s: time from the first to the last row of a rolling shutter.
            latency_s: from the middle of the exposure until the picture arrives.

        Raises:
            CalibrationInputError: the angle or the size is impossible.
        """
        try:
            intrinsics = from_field_of_view(width_px, height_px, hfov_rad)
        except ValueError as error:
            raise CalibrationInputError(
                f"Camera: {error}", "Give the full horizontal angle of the video picture."
            ) from None
        note = f"horizontal field of view {math.degrees(hfov_rad):.1f} deg as given, not calibrated"
        mounted = mounting if mounting is not None else Mounting.tilted(0.0)
        return cls(intrinsics, mounted, False, readout_s, latency_s, UNCALIBRATED_FOCAL_SIGMA, note)

    def row_time_s(self, t_s: float, y_px: float) -> float:
        """When the row at height `y_px` (0 = outer edge of the top row) of a frame of time `t_s` was exposed."""
        return t_s + (y_px / self.intrinsics.height_px - 0.5) * self.readout_s

    def widen(self, noise: NoiseModel, offset_px: tuple[float, float] | None = None) -> NoiseModel:
        """The noise of sightings made with this camera, given the noise of a perfect lens.

        A focal length that is wrong by a fraction s moves a target at distance r from the middle of the picture by s r
        pixels, in the same way in the whole flight. That is a constant bearing error of s r / f (about the vertical
        from the horizontal distance, about the camera's x axis from the vertical one), plus an error of the same size
        that changes as the target moves through the picture. The first goes into the heading and tilt bias, the
        second into the pixel noise. The same r stands for an uncalibrated lens's unknown centre and distortion.

        Args:
            noise: without the lens's share.
            offset_px: typical distance (rms, across and down) of the target from the middle of the picture; a quarter
                of the picture's width and height when not given.
        """
        lens = self.intrinsics
        across, down = offset_px if offset_px is not None else (lens.width_px / 4.0, lens.height_px / 4.0)
        moved_x, moved_y = self.focal_sigma * across, self.focal_sigma * down
        return replace(
            noise,
            pixel_sigma_px=math.hypot(noise.pixel_sigma_px, max(moved_x, moved_y)),
            heading_bias_sigma_rad=math.hypot(noise.heading_bias_sigma_rad, moved_x / lens.fx),
            tilt_bias_sigma_rad=math.hypot(noise.tilt_bias_sigma_rad, moved_y / lens.fy),
        )

    def for_picture(self, width_px: int, height_px: int) -> Camera:
        """The same camera delivering another picture size of the same shape (scaled, not cropped).

        Raises:
            CalibrationError: the shape differs, so the picture was cropped in an unknown way.
        """
        lens = self.intrinsics
        if (width_px, height_px) == (lens.width_px, lens.height_px):
            return self
        across, down = width_px / lens.width_px, height_px / lens.height_px
        if abs(across / down - 1.0) > 0.01:
            raise CalibrationError(
                f"The camera file is for {lens.width_px} x {lens.height_px} pictures, "
                f"the video is {width_px} x {height_px}: another shape",
                "Calibrate with pictures taken in the video's own mode.",
            )
        scaled = replace(
            lens,
            width_px=width_px,
            height_px=height_px,
            fx=lens.fx * across,
            fy=lens.fy * down,
            cx=lens.cx * across,
            cy=lens.cy * down,
        )
        return replace(self, intrinsics=scaled)
