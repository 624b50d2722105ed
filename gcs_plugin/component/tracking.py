"""CAMERA_TRACKING_IMAGE_STATUS (275): where the target is in the picture, for the box that stations draw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from mission.track import Track

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

NOT_SET: Final = float("nan")


@dataclass(frozen=True, slots=True)
class TrackedBox:
    """A target in a picture of a size in pixels."""

    track: Track
    width_px: int
    height_px: int

    @property
    def lost(self) -> bool:
        """Whether it has to be chosen anew."""
        return self.track.state == "lost"


def camera_tracking_image_status(seen: TrackedBox | None) -> Message:
    """CAMERA_TRACKING_IMAGE_STATUS: the target's box as fractions of the picture; idle for None."""
    if seen is None:
        return mavlink.MAVLink_camera_tracking_image_status_message(
            mavlink.CAMERA_TRACKING_STATUS_FLAGS_IDLE,
            mavlink.CAMERA_TRACKING_MODE_NONE,
            0,
            *([NOT_SET] * 7),
        )
    box = seen.track.box
    status = mavlink.CAMERA_TRACKING_STATUS_FLAGS_ERROR if seen.lost else mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE
    return mavlink.MAVLink_camera_tracking_image_status_message(
        status,
        mavlink.CAMERA_TRACKING_MODE_RECTANGLE,
        mavlink.CAMERA_TRACKING_TARGET_DATA_IN_STATUS,
        seen.track.pixel[0] / seen.width_px,
        seen.track.pixel[1] / seen.height_px,
        NOT_SET,
        _fraction(box.left_px, seen.width_px),
        _fraction(box.top_px, seen.height_px),
        _fraction(box.right_px, seen.width_px),
        _fraction(box.bottom_px, seen.height_px),
    )


def _fraction(pixel: float, size_px: int) -> float:
    return min(max(pixel / size_px, 0.0), 1.0)
