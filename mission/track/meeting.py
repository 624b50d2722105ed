"""Two people of the same looks who pass each other are told apart by place and height, or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.records import Vector
from mission.track.measure import Extent, astray
from mission.track.motion import Motion
from mission.track.other import MEETING, Other

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
    return ToldApart(bodies[best], likeliest, nearest > MEETING * target.height_px)


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
