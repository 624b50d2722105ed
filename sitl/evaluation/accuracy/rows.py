"""What is flown: the paper's twelve cases and twelve more, the patterns, and the walks of the pooled figures.

The noise of a row is what simulation.md's detector was measured to have at that distance; everything that it does not
say (size, position, attitude) is the sightings format's default.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mission.records import NoiseModel, TargetPrior
from sitl.evaluation.accuracy.flights import (
    PAPER_CAMERA,
    Pattern,
    SimulatedFlight,
    Walk,
    out_and_back,
    paper_pattern,
    s_pattern,
    simulate,
)

PatternName = Literal["out-and-back", "S", "paper"]
PATTERNS: Mapping[PatternName, Pattern] = {
    "out-and-back": out_and_back(),
    "S": s_pattern(),
    "paper": paper_pattern(),
}
_SPEED = 0.6
_OBLIQUE = _SPEED * math.sqrt(0.5)
_BODY_M = 1.75
_CAMERA_UP_M = 1.5
_STANDING_M = 0.5 * _BODY_M - _CAMERA_UP_M
"""The body's centre above the camera when the feet stand on up = 0."""
_EDGE = 0.97
"""Share of half the picture's width beyond which a person is no longer seen whole."""
_HOG_DEPTHS_M = (3.5, 5.0, 8.0, 11.0)
_HOG_SIGMAS_PX = (2.4, 1.8, 1.4, 1.2)
"""Standard deviation of the box's centre, HOG on the full frame at 15 fps, rendered flights past a person."""
CLOSEST_M = 1.5
"""Nobody is flown past a person nearer than this; walks that would come nearer are left out."""


@dataclass(frozen=True, slots=True)
class Row:
    """One case of the table."""

    motion: str
    depth_m: float
    velocity_m_s: tuple[float, float]
    """To the right and ahead; the patterns go to the left first."""
    published_percent: float | None = None
    """The paper's depth error (tables III to V)."""


ROWS: tuple[Row, ...] = (
    *(Row("stationary", z, (0.0, 0.0), e) for z, e in ((2.75, 14.5), (5.5, 9.3), (7.25, 3.6), (9.0, 0.4))),
    *(Row("perpendicular", z, (0.0, _SPEED), e) for z, e in ((4.5, 9.3), (7.6, 12.0), (5.45, 2.2), (6.9, 2.2))),
    # With the flight, as the paper's sign of theta_1 has it; the other way a near person leaves the picture at once.
    *(Row("parallel", z, (-_SPEED, 0.0), e) for z, e in ((2.75, 24.7), (5.5, 12.3), (7.25, 14.2), (9.0, 9.1))),
    *(Row("diagonal, away", z, (_OBLIQUE, _OBLIQUE)) for z in (2.75, 5.5, 7.25, 9.0)),
    *(Row("diagonal, nearer", z, (-_OBLIQUE, -_OBLIQUE)) for z in (5.5, 7.25, 9.0, 12.0)),
    *(Row("stationary", z, (0.0, 0.0)) for z in (12.0, 25.0)),
    *(Row("parallel", z, (-_SPEED, 0.0)) for z in (15.0, 25.0)),
)
WALKS: tuple[tuple[float, float], ...] = (
    (0.0, 0.0),
    (0.6, 0.0),
    (-0.6, 0.0),
    (0.0, 0.6),
    (0.0, -0.3),
    (0.42, 0.42),
    (-0.42, 0.42),
)
"""Velocities (right, ahead) of the pooled figures."""
DEPTHS_M = (2.75, 5.5, 7.25, 9.0, 15.0, 25.0)


def detector_noise(depth_m: float) -> NoiseModel:
    """The format's default noise with the detector's pixel noise at that distance."""
    return replace(NoiseModel(), pixel_sigma_px=float(np.interp(depth_m, _HOG_DEPTHS_M, _HOG_SIGMAS_PX)))


def row_flights(row: Row, pattern: PatternName, count: int, rng: np.random.Generator) -> list[SimulatedFlight]:
    """Flights of one row, headings at random; the pattern's images end where the target leaves the picture."""
    noise = detector_noise(row.depth_m)
    walk = Walk(row.depth_m, (*row.velocity_m_s, 0.0), above_camera_m=_STANDING_M, height_m=_BODY_M)
    return [
        in_view(simulate(PATTERNS[pattern], walk, rng, noise=noise, start_enu_m=(0.0, 0.0, _CAMERA_UP_M)))
        for _ in range(count)
    ]


def walking_flights(
    patterns: tuple[PatternName, ...],
    count: int,
    seed: int,
    *,
    wrong_share: float = 0.0,
    acceleration_psd_m2_s3: float = 0.0,
) -> Iterator[SimulatedFlight]:
    """Flights over all patterns, `WALKS` and `DEPTHS_M` in turn, with the format's default noise.

    Args:
        patterns: which are flown.
        count: how many flights.
        seed: with the same one the flights differ in nothing but what the other arguments say.
        wrong_share: share of sightings that are somebody else.
        acceleration_psd_m2_s3: of the target's velocity, told in the prior.
    """
    cases = [
        (PATTERNS[name], Walk(depth, (*velocity, 0.0), above_camera_m=_STANDING_M, height_m=_BODY_M))
        for velocity in WALKS
        for depth in DEPTHS_M
        for name in patterns
    ]
    cases = [case for case in cases if _closest_m(*case) > CLOSEST_M]
    # In a fixed shuffle, so that a short run is a fair sample of all cases.
    order = np.random.default_rng(len(cases)).permutation(len(cases))
    prior = TargetPrior(acceleration_psd_m2_s3=acceleration_psd_m2_s3)
    rng = np.random.default_rng(seed)
    for number in range(count):
        pattern, walk = cases[order[number % len(cases)]]
        sim = simulate(pattern, walk, rng, prior=prior, wrong_share=wrong_share)
        yield sim if pattern.heading_on_target else in_view(sim)


def drawn_flights(patterns: tuple[PatternName, ...], count: int, seed: int) -> Iterator[SimulatedFlight]:
    """Flights whose velocities are drawn from the prior, `DEPTHS_M` and patterns in turn.

    A draw that would take the target to within `CLOSEST_M` of the camera is drawn again.
    """
    rng, prior = np.random.default_rng(seed), TargetPrior()
    sigma = (prior.speed_sigma_m_s, prior.speed_sigma_m_s, prior.vertical_speed_sigma_m_s)
    for number in range(count):
        pattern = PATTERNS[patterns[number % len(patterns)]]
        depth = DEPTHS_M[(number // len(patterns)) % len(DEPTHS_M)]
        while True:
            right, ahead, up = (float(v) for v in rng.normal(0.0, sigma))
            walk = Walk(depth, (right, ahead, up), above_camera_m=_STANDING_M, height_m=_BODY_M)
            if _closest_m(pattern, walk) > CLOSEST_M:
                break
        yield simulate(pattern, walk, rng)


def in_view(sim: SimulatedFlight) -> SimulatedFlight:
    """The flight up to the last sighting before the target leaves the picture."""
    camera = PAPER_CAMERA
    off = [abs(s.pixel[0] - camera.cx) for s in sim.flight.sightings]
    count = next((i for i, x in enumerate(off) if x > _EDGE * camera.cx), len(off))
    return SimulatedFlight(
        replace(sim.flight, sightings=sim.flight.sightings[:count]),
        sim.target_m[:count],
        sim.velocity_m_s[:count],
        sim.camera_m[:count],
        sim.wrong[:count],
    )


def _closest_m(pattern: Pattern, walk: Walk) -> float:
    """The smallest horizontal distance of camera and target."""
    right, ahead, _ = walk.velocity_m_s
    across = walk.lateral_m + right * pattern.t_s + pattern.left_ahead_up_m[:, 0]
    along = walk.depth_m + ahead * pattern.t_s - pattern.left_ahead_up_m[:, 1]
    return float(np.hypot(across, along).min())
