"""All that is known about the person who is followed, and what may be them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.records import Vector
from mission.track.appearance import Histogram
from mission.track.measure import Extent
from mission.track.motion import Motion
from mission.track.template import Template

NEAR = 0.25
"""A detection this far from where the body is expected, in body heights, may still be it."""
_SAME_HEIGHT = 0.25
"""Largest difference of the logarithms of two heights of the same body."""
_HALF_HEIGHT = 1.0
"""The same where part of the body is out of the picture."""
_GROWTH = 0.2
"""By how much the logarithm of the height may have changed, unseen, per second: walking past each other at 3 m."""
_STRETCHED = 0.07
"""A box whose lower side is this much lower than expected, in body heights, while its upper side is where it should be,
holds more than the body: its shadow or its reflection on the ground."""
_STRETCHED_S = 1.5
"""How long that is believed: later it was the expectation that was wrong."""
_MEETING = 0.28
"""Two people of whom one is this near to the other, sideways and in body heights, will cover each other."""
_SURELY_SOMEBODY = 0.4
"""Score from which on a body is believed to be somebody else."""
_PLACE_SIGMA = (0.08, 0.35)
"""Of a foretold place, in body heights, and its growth per second: the drone's own acceleration is not foretold."""
_SIZE_SIGMA = (0.06, 0.08)
"""Of the logarithm of a foretold height, and its growth per second."""
_FITS = 6.0
"""Chi-square, 2 degrees of freedom, that the target may have, and by which others must be worse: 95 %."""


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
    cut_off: bool = False
    """Part of the body is out of the picture, so its height cannot be measured."""
    met_s: float = -np.inf
    """When somebody of the same looks was last so close that the two might be mistaken for each other."""
    met_size: float = 0.0
    """Logarithm of that person's height over the target's, then."""
    returning: int = 0
    """In how many frames in a row somebody like the target was seen while coasting."""

    def may_be(self, body: Extent, roll_rad: float, within: float = NEAR, unseen_s: float = 0.0) -> bool:
        """Whether this may be the target, by place and height.

        Args:
            body: seen.
            roll_rad: of the camera.
            within: how far from where it is expected, in body heights.
            unseen_s: how long its height has not been measured.
        """
        height = self.motion.height_px
        room = _SAME_HEIGHT + _GROWTH * unseen_s
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


def meets(body: Extent, expected: Vector, height_px: float) -> bool:
    """Whether somebody else is about to cover the target, or to be covered by them."""
    aside = abs(body.centre[0] - expected[0]) / height_px
    alike = abs(np.log(body.height_px / height_px)) < 0.8
    return bool(body.score > _SURELY_SOMEBODY and aside < _MEETING and alike)


def told_apart(bodies: Sequence[Extent], target: Target, roll_rad: float) -> Extent | None:
    """Which of some people of the same looks is the target, by place and height; None where it could be either.

    Args:
        bodies: all who look like the target.
        target: as foretold, after it has met somebody, whose height it learns.
        roll_rad: of the camera.
    """
    for body in bodies:
        if (
            _measurable(body, target) and _size_cost(body, target, 0.0) > _FITS
        ):  # cannot be the target, so it is whom they met
            target.met_size = float(np.log(body.height_px / target.motion.height_px))
    costs = sorted((_cost(body, target, roll_rad), k) for k, body in enumerate(bodies))
    if not costs or costs[0][0] > _FITS:
        return None
    best = bodies[costs[0][1]]
    if len(costs) > 1:
        apart = min(abs(best.centre[0] - bodies[k].centre[0]) for _, k in costs[1:])
        clear = costs[1][0] - costs[0][0] > _FITS and apart > _MEETING * target.motion.height_px
        return best if clear else None
    # Somebody who is seen alone may be the other one, with the target behind, unless their heights differ.
    own = _size_cost(best, target, 0.0)
    return best if best.whole and _size_cost(best, target, target.met_size) - own > _FITS else None


def _cost(body: Extent, target: Target, roll_rad: float) -> float:
    """Chi-square with 2 degrees of freedom."""
    height = target.motion.height_px
    sigma = height * (_PLACE_SIGMA[0] + _PLACE_SIGMA[1] * (target.t_s - target.seen_s))
    place = away(body, target.motion.pixel, height, roll_rad) / sigma
    return place**2 + (_size_cost(body, target, 0.0) if _measurable(body, target) else 0.0)


def _measurable(body: Extent, target: Target) -> bool:
    """Whether the height says who this is: what is seen of half a body is the least that it can be."""
    return body.whole or body.height_px > target.motion.height_px


def _size_cost(body: Extent, target: Target, log_ratio: float) -> float:
    """Chi-square of a body whose height should be so many times the target's (its logarithm)."""
    sigma = _SIZE_SIGMA[0] + _SIZE_SIGMA[1] * (target.t_s - target.seen_s)
    return float((np.log(body.height_px / target.motion.height_px) - log_ratio) / sigma) ** 2


def away(body: Extent, expected: Vector, height_px: float, roll_rad: float) -> float:
    """How far a body's middle is from where it is expected, pixels; sideways only where its ends are not seen."""
    middle = body.middle(height_px, roll_rad)
    if middle is None:
        return abs(body.centre[0] - float(expected[0]))
    return float(np.hypot(*np.subtract(middle, expected)))


def beside(body: Extent, expected: Vector, height_px: float) -> bool:
    """Whether this is somebody else whom HOG might mean."""
    aside = abs(body.centre[0] - expected[0]) / height_px
    return body.score > 0.5 and 0.15 < aside < 0.6 and bool(abs(np.log(body.height_px / height_px)) < 0.5)
