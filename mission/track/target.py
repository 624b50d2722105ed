"""All that is known about the person who is followed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.records import Vector
from mission.track.crowd import Crowd
from mission.track.detections import BodyDetection, innovation_length
from mission.track.motion import Motion
from mission.track.template import Template
from mission.track.track import TrackState

NEAR = 0.25
"""A detection this far from where the body is expected, in body heights, may still be it."""
_SAME_HEIGHT = 0.25
"""Largest difference of the logarithms of two heights of the same body."""
_HALF_HEIGHT = 1.0
"""The same where part of the body is out of the picture."""
_STRETCHED = 0.07
"""A box whose lower side is this much lower than expected, in body heights, while its upper side is where it should be,
holds more than the body: its shadow or its reflection on the ground."""
_STRETCHED_S = 1.5
"""How long that is believed: later it was the expectation that was wrong."""


@dataclass(slots=True)
class Target:
    """Changes from frame to frame."""

    t_s: float
    motion: Motion
    """As measured finely."""
    crowd: Crowd
    """Who is who."""
    template: Template | None
    seen_s: float
    """When it was last surely seen."""
    agreed_s: float
    """When a detector last agreed."""
    height_s: float
    """When the height was last measured."""
    whole_s: float
    """When a box last held nothing but the body."""
    look_s: float
    """When everybody was last looked at."""
    state: TrackState = "tracking"
    box: BodyDetection | None = None
    """The target in the last look at everybody."""
    near: tuple[BodyDetection, ...] = ()
    """The others in that look."""
    sure: int = 0
    """In how many looks running somebody was surely the target."""
    alike: float = 1.0
    """Likeness of the colours in the last look."""
    crowded: bool = False
    """Somebody else is so close that HOG might mean them."""
    cut_off: bool = False
    """Part of the body is out of the picture, so its height cannot be measured."""

    def predict(self, t_s: float, shift_px: tuple[float, float], passed: tuple[float, float]) -> float:
        """To the time of the next frame (`Motion.predict`); the time since the last one, seconds."""
        dt_s = max(t_s - self.t_s, 1e-3)
        self.t_s = t_s
        self.motion.predict(dt_s, shift_px, passed)
        self.crowd.predict(dt_s, shift_px, passed)
        return dt_s

    def may_be(self, body: BodyDetection, roll_rad: float) -> bool:
        """Whether this may be the target, who was seen a moment ago, by place and height.

        Args:
            body: seen.
            roll_rad: of the camera.
        """
        return self._fits(body, roll_rad, NEAR, _SAME_HEIGHT + self.motion.size_sigma)

    def _fits(self, body: BodyDetection, roll_rad: float, within: float, room: float) -> bool:
        height = self.motion.height_px
        smallest = room if body.whole else _HALF_HEIGHT
        if not -smallest < np.log(body.height_px / height) < room:
            return False
        return innovation_length(body, self.motion.pixel, height, roll_rad) < within * height

    def stretched(self, body: BodyDetection, roll_rad: float) -> bool:
        """Whether a box of the whole body holds its shadow too (see `_STRETCHED`)."""
        height = self.motion.height_px
        half = 0.5 * height * np.cos(roll_rad)
        middle = float(self.motion.pixel[1])
        too_high = abs(body.top[1] - (middle - half))
        too_low = body.bottom[1] - (middle + half)
        wrong = too_low > _STRETCHED * height and too_high < 0.5 * _STRETCHED * height
        if not wrong:
            self.whole_s = self.t_s
        return bool(wrong and self.t_s - self.whole_s < _STRETCHED_S)


def beside(body: BodyDetection, expected: Vector, height_px: float) -> bool:
    """Whether this is somebody else whom HOG might mean."""
    aside = abs(body.centre[0] - expected[0]) / height_px
    return body.score > 0.5 and 0.15 < aside < 0.6 and bool(abs(np.log(body.height_px / height_px)) < 0.5)
