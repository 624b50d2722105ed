"""All that is known about the person who is followed, and what may be them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.records import Vector
from mission.track.appearance import Histogram
from mission.track.measure import Extent, away
from mission.track.motion import Motion
from mission.track.other import Other
from mission.track.template import Template

NEAR = 0.25
"""A detection this far from where the body is expected, in body heights, may still be it."""
_SAME_HEIGHT = 0.25
"""Largest difference of the logarithms of two heights of the same body."""
_SAME_HEIGHT_AGAIN = 0.12
"""The same for who comes back into sight: a box may hold too much for a moment, but who is taken for the target from
now on, and by nothing else, must be as tall."""
_HALF_HEIGHT = 1.0
"""The same where part of the body is out of the picture."""
_GROWTH = 0.2
"""By how much the logarithm of the height may have changed, unseen, per second: walking past each other at 3 m."""
_REACH = (0.2, 0.85)
"""How far from where it is expected who comes back may be, in body heights, and how much farther per second: the way of
who walks 1.5 m/s."""
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
    earlier: Motion
    """What the motion was a quarter to half a second ago, and has led to since without being measured."""
    next_earlier: Motion
    earlier_s: float
    """When `next_earlier` was taken."""
    looks: Histogram
    template: Template | None
    seen_s: float
    """When it was last surely seen."""
    agreed_s: float
    """When a detector last agreed."""
    height_s: float
    """When the height was last measured."""
    whole_s: float
    """When a box last held nothing but the body."""
    crowded: bool = False
    """Somebody else is so close that HOG might mean them."""
    company_s: float = -np.inf
    """When somebody else was last seen near."""
    cut_off: bool = False
    """Part of the body is out of the picture, so its height cannot be measured."""
    met_s: float = -np.inf
    """When somebody of the same looks was last so close that the two might be mistaken for each other."""
    told_s: float = -np.inf
    """When it was last told from somebody of the same looks beside it, too close to be measured."""
    other: Other | None = None
    """Somebody of the same looks who was near."""
    returning: int = 0
    """In how many frames in a row somebody like the target was seen while coasting."""

    @property
    def known_s(self) -> float:
        """When it was last known where it is."""
        return max(self.seen_s, self.told_s)

    def foretell(self, t_s: float, shift_px: tuple[float, float], passed: tuple[float, float]) -> None:
        """To the time of the next frame (`Motion.predict`)."""
        dt_s = max(t_s - self.t_s, 1e-3)
        self.t_s = t_s
        motions = [self.motion, self.earlier, self.next_earlier]
        if self.other is not None:
            motions.append(self.other.motion)
        for motion in motions:
            motion.predict(dt_s, shift_px, passed)

    def may_be(self, body: Extent, roll_rad: float) -> bool:
        """Whether this may be the target, who was seen a moment ago, by place and height.

        Args:
            body: seen.
            roll_rad: of the camera.
        """
        return self._fits(body, roll_rad, NEAR, _SAME_HEIGHT + self.motion.size_sigma)

    def may_be_again(self, body: Extent, roll_rad: float, hidden_s: float) -> bool:
        """Whether this may be the target, who was out of sight, by place and height.

        Args:
            body: seen.
            roll_rad: of the camera.
            hidden_s: for how long.
        """
        room = _SAME_HEIGHT_AGAIN + max(_GROWTH * hidden_s, self.motion.size_sigma)
        return self._fits(body, roll_rad, _REACH[0] + _REACH[1] * hidden_s, room)

    def _fits(self, body: Extent, roll_rad: float, within: float, room: float) -> bool:
        height = self.motion.height_px
        smallest = room if body.whole else _HALF_HEIGHT
        if not -smallest < np.log(body.height_px / height) < room:
            return False
        return away(body, self.motion.pixel, height, roll_rad) < within * height

    def stretched(self, body: Extent, roll_rad: float) -> bool:
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


def beside(body: Extent, expected: Vector, height_px: float) -> bool:
    """Whether this is somebody else whom HOG might mean."""
    aside = abs(body.centre[0] - expected[0]) / height_px
    return body.score > 0.5 and 0.15 < aside < 0.6 and bool(abs(np.log(body.height_px / height_px)) < 0.5)
