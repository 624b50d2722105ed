"""Somebody near who looks like the target: where they are, and whether they are about to cover it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.track import noise
from mission.track.measure import Extent, away
from mission.track.motion import Motion

MEETING = 0.28
"""Two people of whom one is this near to the other, sideways and in body heights, will cover each other."""
_SAME_DISTANCE = 0.8
"""Largest difference of the logarithms of their heights: who is much farther or nearer is told apart by it."""
_BESIDE = 0.15
"""Least distance, sideways and in body heights, at which somebody is first believed: nearer, a second box on the target
itself (without its feet, with an arm) is likelier than somebody who came from nowhere."""
_SURELY_SOMEBODY = 0.4
"""Score from which on a body is believed to be somebody else."""
_OVERLAPPING = 0.1
"""Overlap (intersection over union) of two boxes from which on one may be a second box on the same body."""
_SURELY_OVERLAPPING = 0.5
"""Score from which on it is believed to be somebody else all the same."""
_SAME_PLACE = 0.4
"""Somebody this far from where somebody was expected, in body heights, may still be them."""
_LOOKS = 2
"""In how many looks somebody must have been seen beside the target: a tree is taken for somebody once, now and then."""
_STILL_THERE_S = 1.0
"""How long somebody who is not seen any more is believed to be about to cover the target, or behind them."""


@dataclass(slots=True)
class Other:
    """Somebody who looks like the target. Changes from frame to frame."""

    motion: Motion
    seen_s: float
    looks: int = 1
    """In how many they were seen beside the target."""

    @classmethod
    def at(cls, body: Extent, target: Motion, t_s: float, roll_rad: float) -> Other:
        """Seen for the first time; who is cut off by the picture is taken to be as tall as the target, or taller."""
        height = body.tall(target.height_px)
        middle = body.middle(height, roll_rad) or body.centre
        size_sigma = noise.HEIGHT_SIGMA if body.whole else noise.CUT_OFF_SIZE_SIGMA
        return cls(Motion(middle, height, noise.BOX_SIDEWAYS_SIGMA, size_sigma), t_s)

    def see(self, body: Extent, t_s: float, roll_rad: float, *, alone: bool = True) -> None:
        """Seen again.

        Args:
            body: they.
            t_s: when.
            roll_rad: of the camera.
            alone: nobody else is in the same box, which says how tall they are.
        """
        if not self.motion.see_box(body, roll_rad):
            return
        if alone and (body.whole or body.height_px > self.motion.height_px):
            self.motion.see_height(body.height_px, noise.HEIGHT_SIGMA)
        self.seen_s = t_s

    def meets(self, target: Motion, t_s: float) -> bool:
        """Whether they should be about to cover the target by now, or to be covered, seen or not."""
        height = target.height_px
        aside = abs(float(self.motion.pixel[0] - target.pixel[0])) / height
        alike = abs(np.log(self.motion.height_px / height)) < _SAME_DISTANCE
        there = self.looks >= _LOOKS and t_s - self.seen_s < _STILL_THERE_S
        return bool(there and aside < MEETING and alike)

    def belied(self, target: Motion, t_s: float) -> bool:
        """Whether they are not where they should be, with the target not in front of them: a tree, or gone."""
        away_px = float(np.hypot(*(self.motion.pixel - target.pixel)))
        return self.seen_s < t_s and away_px > _SAME_PLACE * max(target.height_px, self.motion.height_px)


def may_be_taken_for(body: Extent, height_px: float) -> bool:
    """Whether a body is surely somebody, and about as near as a target of this height."""
    return bool(body.score > _SURELY_SOMEBODY and abs(np.log(body.height_px / height_px)) < _SAME_DISTANCE)


def seen_again(
    other: Other | None,
    bodies: Sequence[Extent],
    target: Motion,
    t_s: float,
    roll_rad: float,
    own: Extent | None = None,
) -> Other | None:
    """The way of the other one, with what a frame shows of people of the target's looks.

    Args:
        other: as foretold, None where there was none.
        bodies: all such people but the target.
        target: as foretold.
        t_s: the frame's time.
        roll_rad: of the camera.
        own: the target in this frame, where it is seen.
    """
    if not bodies:
        return other
    about = target if other is None else other.motion
    height = about.height_px
    body = min(bodies, key=lambda b: away(b, about.pixel, height, roll_rad))
    beside = _beside(body, target, own)
    if other is None or away(body, about.pixel, height, roll_rad) > _SAME_PLACE * height:
        return Other.at(body, target, t_s, roll_rad) if beside else other
    other.see(body, t_s, roll_rad)
    other.looks += beside
    return other


def _beside(body: Extent, target: Motion, own: Extent | None) -> bool:
    """Whether a body is somebody else, and no second box on the target itself."""
    if own is None:
        return abs(body.centre[0] - float(target.pixel[0])) > _BESIDE * target.height_px
    if body.score < _SURELY_OVERLAPPING and body.box.overlap(own.box) > _OVERLAPPING:
        return False
    return abs(body.centre[0] - own.centre[0]) > _BESIDE * own.height_px
