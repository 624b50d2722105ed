"""What a likeness of colours says about who is seen: its statistics are learnt during the flight."""

from __future__ import annotations

import math

_SAME = (0.72, 0.14)
_OTHER = (0.35, 0.18)
"""Mean and standard deviation before anything is learnt, of the target's own looks and of other people's."""
_PRIOR_LOOKS = 8.0
"""How many looks that counts for."""
_MEMORY_LOOKS = 120.0
"""After how many looks what was learnt is forgotten: the light changes."""
_LEAST_SIGMA = 0.07
_FLOOR = (0.004, 0.03)
"""Share of looks that follow no statistics: half hidden, in the shade, blurred; of the target's own and of others'."""


class LikenessModel:
    """Evidence, in nats, that somebody is the target, by the likeness of the colours (`appearance.likeness`).

    A log likelihood ratio of two normal distributions, each with a floor: how alike the target is to itself from look
    to look, and how alike other people are to it. Where the two are the same it is zero: clothes then tell nothing.
    """

    def __init__(self) -> None:
        self._same = _Learnt(*_SAME)
        self._other = _Learnt(*_OTHER)

    def learn(self, alike: float, *, same: bool) -> None:
        """Take in the likeness of somebody of whom it is known whether they are the target."""
        (self._same if same else self._other).add(alike)

    def evidence(self, alike: float) -> float:
        """Log likelihood ratio of the target against somebody else; it grows with the likeness."""
        same, other = self._same, self._other
        if same.mean <= other.mean:
            return 0.0
        own = same.density(min(alike, same.mean), _FLOOR[0])
        others = other.density(max(alike, other.mean), _FLOOR[1])
        return math.log(own / others)

    def usual(self, alike: float, sigmas: float = 2.0) -> bool:
        """Whether the target itself would look like this, or more alike, in most looks."""
        return alike > self._same.mean - sigmas * self._same.sigma


class _Learnt:
    """Mean and standard deviation of what was seen, with a prior, forgetting exponentially."""

    def __init__(self, mean: float, sigma: float) -> None:
        self.mean, self._variance, self._looks = mean, sigma**2, _PRIOR_LOOKS

    @property
    def sigma(self) -> float:
        return max(math.sqrt(self._variance), _LEAST_SIGMA)

    def add(self, value: float) -> None:
        self._looks = min(self._looks + 1.0, _MEMORY_LOOKS)
        off, share = value - self.mean, 1.0 / self._looks
        self.mean += share * off
        self._variance = (1.0 - share) * (self._variance + share * off**2)

    def density(self, value: float, floor: float) -> float:
        normal = math.exp(-0.5 * ((value - self.mean) / self.sigma) ** 2) / (self.sigma * math.sqrt(math.tau))
        return (1.0 - floor) * normal + floor
