"""Where somebody is in the picture and how tall they are, as the association of people needs it: coarse and robust.

Units are pixels, and body heights where it says so. Values, so that hypotheses can share them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

_SPEED_SIGMA = 0.6
"""Body heights per second, of people who walk, stop and turn."""
_SPEED_S = 3.0
"""How long they keep to it."""
_SIZE_RATE_SIGMA = 0.12
"""Of the logarithm of the height, per root second."""
_PLACE_SIGMA = 0.05
"""Of the middle of a detector's box, body heights."""
_ASTRAY_SIGMA = 0.25
"""The same where part of the body is hidden."""
_SIZE_SIGMA = 0.08
_WRONG_SIZE_SIGMA = 0.35
_ASTRAY = 0.1
"""Share of boxes that hold but a part of the body, or more than it."""
_TRUSTED = 2.5
"""Innovations beyond this many standard deviations count as much as one of that size."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What a detector's box says: the body's middle and the logarithm of its height."""

    x_px: float
    y_px: float
    log_height: float | None
    """None where the picture cuts the body off."""


@dataclass(frozen=True, slots=True)
class Walk:
    """Kalman filter of place and velocity with the same covariance in both directions, and of the height."""

    x_px: float
    y_px: float
    log_height: float
    u_px_s: float = 0.0
    v_px_s: float = 0.0
    place_var: float = _PLACE_SIGMA**2
    """Body heights squared."""
    cross_var: float = 0.0
    speed_var: float = _SPEED_SIGMA**2
    size_var: float = _SIZE_SIGMA**2

    @property
    def height_px(self) -> float:
        """Of the body."""
        return math.exp(self.log_height)

    @property
    def sigma(self) -> float:
        """Of the place, body heights."""
        return math.sqrt(self.place_var)

    def predicted(self, dt_s: float, shift_px: tuple[float, float], passed: tuple[float, float]) -> Walk:
        """At a later time.

        Args:
            dt_s: how much later.
            shift_px: how far the camera's rotation moved the picture.
            passed: how far its travel moved people, in their own heights.
        """
        kept = math.exp(-dt_s / _SPEED_S)
        reach = _SPEED_S * (1.0 - kept)
        # What a first-order Gauss-Markov velocity adds.
        walked = _SPEED_S**2 * (2.0 * dt_s / _SPEED_S - 3.0 + 4.0 * kept - kept**2)
        height = self.height_px
        return replace(
            self,
            x_px=self.x_px + reach * self.u_px_s + shift_px[0] + passed[0] * height,
            y_px=self.y_px + reach * self.v_px_s + shift_px[1] + passed[1] * height,
            u_px_s=kept * self.u_px_s,
            v_px_s=kept * self.v_px_s,
            place_var=self.place_var
            + 2.0 * reach * self.cross_var
            + reach**2 * self.speed_var
            + _SPEED_SIGMA**2 * walked,
            cross_var=kept * (self.cross_var + reach * self.speed_var) + _SPEED_SIGMA**2 * _SPEED_S * (1.0 - kept) ** 2,
            speed_var=kept**2 * self.speed_var + _SPEED_SIGMA**2 * (1.0 - kept**2),
            size_var=self.size_var + _SIZE_RATE_SIGMA**2 * dt_s,
        )

    def log_likelihood(self, seen: Seen) -> float:
        """Of a box, per body height squared and unit of the logarithm of the height; heavy tails for partial boxes."""
        height = self.height_px
        off = ((seen.x_px - self.x_px) ** 2 + (seen.y_px - self.y_px) ** 2) / height**2
        place = 0.0
        for share, sigma in ((1.0 - _ASTRAY, _PLACE_SIGMA), (_ASTRAY, _ASTRAY_SIGMA)):
            variance = self.place_var + sigma**2
            place += share * math.exp(-0.5 * off / variance) / (math.tau * variance)
        if seen.log_height is None:
            return math.log(place + 1e-12)
        size = 0.0
        for share, sigma in ((1.0 - _ASTRAY, _SIZE_SIGMA), (_ASTRAY, _WRONG_SIZE_SIGMA)):
            variance = self.size_var + sigma**2
            size += (
                share
                * math.exp(-0.5 * (seen.log_height - self.log_height) ** 2 / variance)
                / math.sqrt(math.tau * variance)
            )
        return math.log(place + 1e-12) + math.log(size + 1e-12)

    def updated(self, seen: Seen) -> Walk:
        """With a box."""
        height = self.height_px
        du, dv = seen.x_px - self.x_px, seen.y_px - self.y_px
        variance = self.place_var + _PLACE_SIGMA**2
        excess = max(1.0, math.hypot(du, dv) / height / (_TRUSTED * math.sqrt(variance)))
        gain, rate = self.place_var / (variance * excess), self.cross_var / (variance * excess)
        log_height, size_var = self.log_height, self.size_var
        if seen.log_height is not None:
            off = seen.log_height - log_height
            total = size_var + _SIZE_SIGMA**2
            share = size_var / total / max(1.0, abs(off) / (_TRUSTED * math.sqrt(total)))
            log_height, size_var = log_height + share * off, (1.0 - share) * size_var
        return Walk(
            self.x_px + gain * du,
            self.y_px + gain * dv,
            log_height,
            self.u_px_s + rate * du,
            self.v_px_s + rate * dv,
            self.place_var - gain * self.place_var,
            self.cross_var - gain * self.cross_var,
            max(self.speed_var - rate * self.cross_var, 1e-4),
            size_var,
        )
