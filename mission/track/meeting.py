"""Two people of the same looks who pass each other: both are foretold, and told apart by place and height, or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.records import Vector
from mission.track import noise
from mission.track.measure import Extent, astray, away
from mission.track.motion import Motion

_MEETING = 0.28
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
_PLACE_SIGMA = 0.06
"""Of where the middle of a box is beside the middle of the body, in body heights: half a body, and the gait."""
_SIZE_SIGMA = (0.06, 0.08)
"""Of the logarithm of a foretold height, and its growth per second."""
_SHARED_SIGMA = 0.15
"""How far, in body heights and per second, all may be astray together by the camera's own motion told wrongly."""
_FITS = 6.0
"""Chi-square, 2 degrees of freedom, that the target may have, and by which others must be worse: 95 %."""
_HIDDEN = 9.0
"""Chi-square from which on somebody is rather taken to be hidden, or out of the window, than to be who is seen."""


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
        return bool(there and aside < _MEETING and alike)

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


@dataclass(frozen=True, slots=True)
class ToldApart:
    """Who is who."""

    target: Extent
    other: Extent | None
    apart: bool
    """Whether they cover each other no more."""


def told_apart(
    bodies: Sequence[Extent], target: Motion, other: Other | None, t_s: float, seen_s: float, roll_rad: float
) -> ToldApart | None:
    """Who of some people of the same looks is who, by place and height; None where the target could be any or none.

    Args:
        bodies: all who look like the target.
        target: as foretold, after it has met somebody.
        other: whom it has met, as foretold.
        t_s: the frame's time.
        seen_s: when the target was last seen.
        roll_rad: of the camera.
    """
    own = [_fit(body, target, t_s - seen_s, roll_rad) for body in bodies]
    other_s = 0.0 if other is None else t_s - other.seen_s
    others = [None if other is None else _fit(body, other.motion, other_s, roll_rad) for body in bodies]
    shared_px = _SHARED_SIGMA * target.height_px * (t_s - seen_s)

    def cost(k: int) -> float:
        """Of the target's being the k-th, and the other one whoever is likeliest, or out of sight."""
        pairs = [0.0 if fit is None else _together(own[k], fit, shared_px) for n, fit in enumerate(others) if n != k]
        return min([own[k].cost + _HIDDEN, *pairs])

    told = sorted((cost(k), k) for k in range(len(bodies)))
    if not told or own[told[0][1]].cost > _FITS:
        return None
    best = told[0][1]
    if len(told) == 1:
        # Somebody who is seen alone may be the other one, with the target behind.
        rival = others[best]
        sure = bodies[best].whole and rival is not None and rival.cost - own[best].cost > _FITS
        return ToldApart(bodies[best], None, apart=True) if sure else None
    if told[1][0] - told[0][0] < _FITS:
        return None
    rest = [k for _, k in told[1:]]
    nearest = min(abs(bodies[best].centre[0] - bodies[k].centre[0]) for k in rest)
    costs = {k: fit.cost for k in rest if (fit := others[k]) is not None and fit.cost < _HIDDEN}
    likeliest = bodies[min(costs, key=lambda k: costs[k])] if costs else None
    return ToldApart(bodies[best], likeliest, nearest > _MEETING * target.height_px)


@dataclass(frozen=True, slots=True)
class _Fit:
    """How a body fits who was foretold."""

    astray_px: Vector
    """(2,) from where they should be."""
    sigma_px: float
    """Of that, per axis."""
    size: float
    """Chi-square of the height."""

    @property
    def cost(self) -> float:
        """Chi-square of place and height."""
        return float(self.astray_px @ self.astray_px) / self.sigma_px**2 + self.size


def _fit(body: Extent, motion: Motion, unseen_s: float, roll_rad: float) -> _Fit:
    height = motion.height_px
    sigma_px = float(np.hypot(_PLACE_SIGMA * height, motion.sigma_px.max()))
    size_sigma = max(_SIZE_SIGMA[0] + _SIZE_SIGMA[1] * unseen_s, motion.size_sigma)
    # What is seen of half a body is the least that it can be.
    counts = body.whole or body.height_px > height
    size = (float(np.log(body.height_px / height)) / size_sigma) ** 2 if counts else 0.0
    return _Fit(astray(body, motion.pixel, height, roll_rad), sigma_px, size)


def _together(target: _Fit, other: _Fit, shared_px: float) -> float:
    """Chi-square of two people at once, who may both be astray by the same: the camera turned more than was told."""
    a, b, shared = target.sigma_px**2, other.sigma_px**2, shared_px**2
    own = (b + shared) * target.astray_px @ target.astray_px + (a + shared) * other.astray_px @ other.astray_px
    both = 2.0 * shared * target.astray_px @ other.astray_px
    return float(own - both) / (a * b + shared * (a + b)) + target.size + other.size
