"""What is believed of a person's height beforehand: alternatives with their probabilities.

A height that somebody states may be wrong, so a stated one is one alternative beside wider ones, and what the picture
says of the height decides between them. An adult's height is 1.71 m with a sigma of 0.09 m over both sexes, shoes
included; children, and people who crouch or sit, are not in it, so they are alternatives of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

from mission.records import TargetPrior

_UNKNOWN_SIGMA: Final = 3.0
"""Of a log height of which nothing is known."""
_LEAST_SIGMA: Final = 1e-3
_STATED: Final = ((1.0, 0.5), (3.0, 0.3))
"""A stated sigma is multiplied by these, with these probabilities ..."""
_MISSTATED_SIGMA, _MISSTATED_SHARE = 0.35, 0.2
"""... or the height is something else altogether."""


@dataclass(frozen=True, slots=True)
class SizePrior:
    """One alternative: a normal distribution of the logarithm of the height (m)."""

    mean: float
    sigma: float
    share: float
    kind: Literal["unknown", "stated", "class", "other"]

    @staticmethod
    def unknown() -> SizePrior:
        """Nothing is known."""
        return SizePrior(0.0, _UNKNOWN_SIGMA, 1.0, "unknown")


ADULT: Final = (
    SizePrior(math.log(1.71), 0.065, 0.72, "class"),
    SizePrior(math.log(1.3), 0.20, 0.20, "other"),
    SizePrior(math.log(1.3), 0.45, 0.08, "other"),
)
"""A detected person: an adult who stands (the sigma holds what a detector's box is off by), a child, anything else."""


def size_priors(prior: TargetPrior) -> tuple[SizePrior, ...]:
    """Alternatives of the height that somebody states; of an unknown one where nobody does."""
    if prior.height_m is None:
        return (SizePrior.unknown(),)
    sigma = max((prior.height_sigma_m or 0.0) / prior.height_m, _LEAST_SIGMA)
    mean = math.log(prior.height_m)
    if sigma >= _MISSTATED_SIGMA:
        return (SizePrior(mean, min(sigma, _UNKNOWN_SIGMA), 1.0, "stated"),)
    return (
        *(SizePrior(mean, factor * sigma, share, "stated") for factor, share in _STATED),
        SizePrior(mean, _MISSTATED_SIGMA, _MISSTATED_SHARE, "other"),
    )
