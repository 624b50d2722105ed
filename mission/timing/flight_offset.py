"""How late the video is in this flight: by the turn before the pattern, or by the pattern where it tells more."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from mission.pose.buffer import Pose
from mission.records import Frame, NoiseModel
from mission.timing.time_offset import TimeOffset, TimeOffsetMeter

UNKNOWN_OFFSET_S = 0.1
"""Uncertainty of the video's delay when it could not be measured."""
TURN_RATE_RAD_S = 0.3
"""Of an ordinary pattern: makes a wander of the heading of a wrong delay."""


class FlightOffset:
    """What is known of the offset by now.

    Args:
        meter: measures it; None when it shall not be measured.
    """

    def __init__(self, meter: TimeOffsetMeter | None) -> None:
        self.meter = meter
        self.found: TimeOffset | None = None
        """As measured on the turn or the pattern; None where neither told."""

    def add(self, frame: Frame) -> None:
        """A frame of the pattern; nothing is done with it where the turn told enough."""
        if self.meter is not None and self._wanted:
            self.meter.add(frame)

    def measure_again(self, pose_at: Callable[[float], Pose | None]) -> bool:
        """Take what the pattern's own movement tells, where the turn before it told less; whether that was so.

        Args:
            pose_at: the aircraft's reported pose at a program time.
        """
        better = self.meter.measure(pose_at) if self.meter is not None and self._wanted else None
        if better is None or (self.found is not None and better.sigma_s >= self.found.sigma_s):
            return False
        self.found = better
        return True

    @property
    def _wanted(self) -> bool:
        return self.found is None or not self.found.settled


def offset_uncertain(noise: NoiseModel, sigma_s: float = UNKNOWN_OFFSET_S) -> NoiseModel:
    """The noise of the pose at a frame's time when it is not known exactly how late the video is.

    Args:
        noise: of the reported pose at its own time.
        sigma_s: standard deviation of the video's delay; when not given, of one that nobody measured.
    """
    turned_rad = TURN_RATE_RAD_S * sigma_s
    return replace(
        noise,
        heading_sigma_rad=math.hypot(noise.heading_sigma_rad, turned_rad),
        tilt_sigma_rad=math.hypot(noise.tilt_sigma_rad, turned_rad / 2.0),
    )
