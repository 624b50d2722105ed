"""What varies from one field flight to the next, and flights drawn at random."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from mission.settings import PatternSettings
from sitl.autopilot.estimate_errors import NoiseName
from sitl.autopilot.gimbal_settings import GimbalSettings, Tells
from sitl.scenario.scene import ScenarioWalk

HEIGHTS_M: Final = (10.0, 20.0, 40.0, 60.0)
SLANT_M: Final = (20.0, 120.0)
_STEEPEST_RAD: Final = math.radians(70.0)
_SHARE: Final = 0.15
"""Of the slant distance, the pattern's length."""
_LENGTH_M: Final = (3.0, 15.0)
_SPEED_M_S: Final = 2.0
"""Mean, of a leg."""
WALKS: Final[tuple[ScenarioWalk | None, ...]] = (None, "real-like", "turns")


@dataclass(frozen=True, slots=True)
class FieldCase:
    """One flight. The same case gives the same flight, bit for bit."""

    seed: int
    height_m: float
    """Of the aircraft over the ground."""
    slant_m: float
    """From the aircraft to the person when the pattern begins."""
    walks: ScenarioWalk | None
    """How the person moves; stands when None."""
    noise: NoiseName
    gimbal: GimbalSettings
    offset_s: float
    """How much later than the telemetry the video's clock runs."""
    facing_deg: float
    size_px: tuple[int, int] = (960, 540)
    hfov_deg: float = 50.0

    @property
    def distance_m(self) -> float:
        """Over the ground."""
        return math.sqrt(max(0.0, self.slant_m**2 - self.height_m**2))

    @property
    def pattern(self) -> PatternSettings:
        """Out and back, longer where the person is further."""
        length_m = min(_LENGTH_M[1], max(_LENGTH_M[0], _SHARE * self.slant_m))
        return PatternSettings(length_m=length_m, leg_duration_s=max(3.0, length_m / _SPEED_M_S))


def drawn_field_cases(
    count: int, seed: int, noise: NoiseName, *, first: int = 0, tells: Tells | None = None
) -> Iterator[FieldCase]:
    """Flights over all heights, distances and walks; the k-th is the same whatever the count.

    Args:
        count: how many.
        seed: of the draw.
        noise: how well the autopilot knows its pose.
        first: number of the first one.
        tells: the gimbal's convention; any that says what it means when None.
    """
    for k in range(first, first + count):
        rng = np.random.default_rng([seed, k])
        height_m = HEIGHTS_M[k % len(HEIGHTS_M)]
        least_m = max(SLANT_M[0], height_m / math.sin(_STEEPEST_RAD))
        explicit: tuple[Tells, ...] = ("nose", "north", "nose-delta")
        gimbal = GimbalSettings(
            tells=tells or explicit[int(rng.integers(3))],
            rate_hz=float(rng.choice((10.0, 20.0))),
            age_ms=float(rng.uniform(20.0, 100.0)),
        )
        yield FieldCase(
            seed=int(rng.integers(1, 2**31)),
            height_m=height_m,
            slant_m=float(rng.uniform(least_m, SLANT_M[1])),
            walks=WALKS[(k // len(HEIGHTS_M)) % len(WALKS)],
            noise=noise,
            gimbal=gimbal,
            offset_s=float(rng.uniform(0.0, 0.3)),
            facing_deg=float(rng.uniform(-180.0, 180.0)),
        )
