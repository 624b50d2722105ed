"""Two people of the same looks who pass each other: both are foretold, and told apart by place and height, or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.track import noise
from mission.track.measure import Extent, away
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
_SAME_PLACE = 0.4
"""Somebody this far from where somebody was expected, in body heights, may still be them."""
_STILL_THERE_S = 1.0
"""How long somebody who is not seen any more is believed to be about to cover the target, or behind them."""
_PLACE_SIGMA = 0.06
"""Of where the middle of a box is beside the middle of the body, in body heights: half a body, and the gait."""
_SIZE_SIGMA = (0.06, 0.08)
"""Of the logarithm of a foretold height, and its growth per second."""
_FITS = 6.0
"""Chi-square, 2 degrees of freedom, that the target may have, and by which others must be worse: 95 %."""
_HIDDEN = 9.0
"""Chi-square from which on somebody is rather taken to be hidden, or out of the window, than to be who is seen."""


@dataclass(slots=True)
class Other:
    """Somebody who looks like the target. Changes from frame to frame."""

    motion: Motion
    seen_s: float

    @classmethod
    def at(cls, body: Extent, t_s: float, roll_rad: float) -> Other:
        """Seen for the first time."""
        middle = body.middle(body.height_px, roll_rad) or body.centre
        return cls(Motion(middle, body.height_px, noise.BOX_SIDEWAYS_SIGMA, noise.HEIGHT_SIGMA), t_s)

    def see(self, body: Extent, t_s: float, roll_rad: float) -> None:
        """Seen again."""
        middle = body.middle(self.motion.height_px, roll_rad)
        if middle is None:
            return
        for axis, value in enumerate(middle):
            self.motion.see(axis, value, noise.BOX_SIDEWAYS_SIGMA)
        if body.whole:
            self.motion.see_height(body.height_px, noise.HEIGHT_SIGMA)
        self.seen_s = t_s

    def meets(self, target: Motion, t_s: float) -> bool:
        """Whether they should be about to cover the target by now, or to be covered, seen or not."""
        height = target.height_px
        aside = abs(float(self.motion.pixel[0] - target.pixel[0])) / height
        alike = abs(np.log(self.motion.height_px / height)) < _SAME_DISTANCE
        return bool(t_s - self.seen_s < _STILL_THERE_S and aside < _MEETING and alike)


def may_be_taken_for(body: Extent, height_px: float) -> bool:
    """Whether a body is surely somebody, and about as near as a target of this height."""
    return bool(body.score > _SURELY_SOMEBODY and abs(np.log(body.height_px / height_px)) < _SAME_DISTANCE)


def seen_again(
    other: Other | None, bodies: Sequence[Extent], target: Motion, t_s: float, roll_rad: float
) -> Other | None:
    """The way of the other one, with what a frame shows of people of the target's looks.

    Args:
        other: as foretold, None where there was none.
        bodies: all such people but the target.
        target: as foretold.
        t_s: the frame's time.
        roll_rad: of the camera.
    """
    if not bodies:
        return other
    about = target if other is None else other.motion
    height = about.height_px
    body = min(bodies, key=lambda b: away(b, about.pixel, height, roll_rad))
    if other is None or away(body, about.pixel, height, roll_rad) > _SAME_PLACE * height:
        aside = abs(body.centre[0] - float(target.pixel[0]))
        return Other.at(body, t_s, roll_rad) if aside > _BESIDE * target.height_px else other
    other.see(body, t_s, roll_rad)
    return other


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
    own = [_cost(body, target, t_s - seen_s, roll_rad) for body in bodies]
    others = [0.0 if other is None else _cost(body, other.motion, t_s - other.seen_s, roll_rad) for body in bodies]
    told = sorted(
        (own[k] + min([_HIDDEN, *(c for n, c in enumerate(others) if n != k)]), k) for k in range(len(bodies))
    )
    if not told or own[told[0][1]] > _FITS:
        return None
    best = told[0][1]
    if len(told) == 1:
        # Somebody who is seen alone may be the other one, with the target behind.
        sure = bodies[best].whole and others[best] - own[best] > _FITS
        return ToldApart(bodies[best], None, apart=True) if sure else None
    if told[1][0] - told[0][0] < _FITS:
        return None
    rest = [k for _, k in told[1:]]
    nearest = min(abs(bodies[best].centre[0] - bodies[k].centre[0]) for k in rest)
    rival = min(rest, key=lambda k: others[k])
    return ToldApart(
        bodies[best], bodies[rival] if others[rival] < _HIDDEN else None, nearest > _MEETING * target.height_px
    )


def _cost(body: Extent, motion: Motion, unseen_s: float, roll_rad: float) -> float:
    """Chi-square of a body's being who was foretold, 2 degrees of freedom."""
    height = motion.height_px
    sigma = np.hypot(_PLACE_SIGMA * height, float(motion.sigma_px.max()))
    place = float(away(body, motion.pixel, height, roll_rad) / sigma) ** 2
    # What is seen of half a body is the least that it can be.
    if not body.whole and body.height_px < height:
        return place
    return place + float(np.log(body.height_px / height) / (_SIZE_SIGMA[0] + _SIZE_SIGMA[1] * unseen_s)) ** 2
