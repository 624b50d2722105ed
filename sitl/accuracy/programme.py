"""The accuracy programme: every method on the same simulated flights, beside the paper's figures and the bound.

Flights are made at sighting level (`flights.py`) with the documented noise: the paper's twelve rows, and twelve more in
diagonal directions and beyond 11 m. Each row is flown many times; a method's figure is the median depth error.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate import ESTIMATORS
from mission.estimate.bound import bound
from mission.records import FlightSightings, Vector
from sitl.accuracy.flights import Pattern, SimulatedFlight, Walk, out_and_back, paper_pattern, s_pattern, simulate

PatternName = Literal["out-and-back", "S", "paper"]
PATTERNS: Mapping[PatternName, Pattern] = {
    "out-and-back": out_and_back(),
    "S": s_pattern(),
    "paper": paper_pattern(),
}
_SPEED = 0.6
_EDGE = 0.6
"""Tangent of the angle off the axis at which the target leaves the picture."""


@dataclass(frozen=True, slots=True)
class Row:
    """One case of the table."""

    motion: str
    depth_m: float
    velocity_m_s: tuple[float, float]
    """To the right and ahead."""
    published_percent: float | None = None
    """The paper's depth error (tables III to V)."""


ROWS: tuple[Row, ...] = (
    *(Row("stationary", z, (0.0, 0.0), e) for z, e in ((2.75, 14.5), (5.5, 9.3), (7.25, 3.6), (9.0, 0.4))),
    *(Row("perpendicular", z, (0.0, _SPEED), e) for z, e in ((4.5, 9.3), (7.6, 12.0), (5.45, 2.2), (6.9, 2.2))),
    *(Row("parallel", z, (_SPEED, 0.0), e) for z, e in ((2.75, 24.7), (5.5, 12.3), (7.25, 14.2), (9.0, 9.1))),
    *(Row("diagonal, away", z, (0.42, 0.42)) for z in (2.75, 5.5, 7.25, 9.0)),
    *(Row("diagonal, nearer", z, (-0.25, -0.25)) for z in (5.5, 7.25, 9.0, 12.0)),
    *(Row("stationary", z, (0.0, 0.0)) for z in (12.0, 25.0)),
    *(Row("parallel", z, (_SPEED, 0.0)) for z in (15.0, 25.0)),
)


@dataclass(frozen=True, slots=True)
class Figures:
    """What one method made of one row."""

    row: Row
    method: str
    median_percent: float
    """Median depth error at the first sighting; NaN where nothing was answered."""
    p95_percent: float
    answered: int
    flights: int
    inside_percent: float | None
    """Share of final positions inside of their 95 % ellipse, for methods with a covariance."""


def accuracy(
    pattern: PatternName, flights: int, seed: int, *, rows: Sequence[Row] = ROWS, methods: Sequence[str] = ()
) -> Iterator[Figures]:
    """Fly every row and give each method's figures, and the bound's as a method of its own.

    Args:
        pattern: which pattern is flown.
        flights: how many flights a row.
        seed: of all randomness; every method gets the same flights.
        rows: the cases.
        methods: names out of `ESTIMATORS`, all of them when empty.
    """
    names = tuple(methods) or tuple(ESTIMATORS)
    for number, row in enumerate(rows):
        rng = np.random.default_rng((seed, number))
        simulated = [_flown(row, pattern, rng) for _ in range(flights)]
        for name in names:
            yield _figures(row, name, simulated)
        sigma = [_bound_percent(sim) for sim in simulated]
        # Of a normal error the median of the absolute value is 0.6745 sigma, its 95th percentile 1.96.
        middle = float(np.median(sigma))
        yield Figures(row, "bound", 0.6745 * middle, 1.96 * middle, flights, flights, None)


def write_csv(path: Path, figures: Sequence[Figures]) -> None:
    """The figures as a table, one line for each row and method.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(
            ("motion", "depth_m", "method", "median_percent", "p95_percent", "answered", "flights", "inside_percent")
        )
        for f in figures:
            inside = "" if f.inside_percent is None else f"{f.inside_percent:.1f}"
            writer.writerow(
                (
                    f.row.motion,
                    f.row.depth_m,
                    f.method,
                    f"{f.median_percent:.2f}",
                    f"{f.p95_percent:.2f}",
                    f.answered,
                    f.flights,
                    inside,
                )
            )


def _flown(row: Row, name: PatternName, rng: np.random.Generator) -> SimulatedFlight:
    right, ahead = row.velocity_m_s
    sim = simulate(PATTERNS[name], Walk(row.depth_m, (right, ahead, 0.0)), rng)
    if PATTERNS[name].heading_on_target:
        return sim
    # With a fixed heading the target leaves the picture, and the pattern's last images are without it.
    off = [abs(s.pixel[0] - 320.0) / 516.5 for s in sim.flight.sightings]
    seen = next((i for i, tangent in enumerate(off) if tangent > _EDGE), len(off))
    return _cut(sim, max(seen, 4))


def _cut(sim: SimulatedFlight, count: int) -> SimulatedFlight:
    flight = sim.flight
    shorter = FlightSightings(
        flight.id, flight.origin, flight.camera, flight.sightings[:count], flight.noise, flight.prior
    )
    return SimulatedFlight(
        shorter, sim.target_m[:count], sim.velocity_m_s[:count], sim.camera_m[:count], sim.wrong[:count]
    )


def _figures(row: Row, name: str, simulated: Sequence[SimulatedFlight]) -> Figures:
    errors, inside, ellipses = [], 0, 0
    for sim in simulated:
        try:
            estimate = ESTIMATORS[name].estimate(sim.flight)
        except EstimateRefused:
            continue
        errors.append(100.0 * abs(estimate.depth_m / sim.depth_m - 1.0))
        if estimate.covariance is not None:
            miss: Vector = (estimate.position_enu_m - sim.target_m[-1])[:2]
            ellipses += 1
            inside += bool(miss @ np.linalg.solve(estimate.covariance[:2, :2], miss) < 5.991)
    if not errors:
        return Figures(row, name, math.nan, math.nan, 0, len(simulated), None)
    return Figures(
        row,
        name,
        float(np.median(errors)),
        float(np.percentile(errors, 95)),
        len(errors),
        len(simulated),
        100.0 * inside / ellipses if ellipses else None,
    )


def _bound_percent(sim: SimulatedFlight) -> float:
    flight = sim.flight
    best = bound(
        np.array([s.t_s for s in flight.sightings]),
        sim.camera_m,
        sim.target_m[0],
        sim.velocity_m_s[0],
        flight.camera,
        flight.noise,
        flight.prior,
        world_from_camera_wxyz=np.array([s.world_from_camera_wxyz for s in flight.sightings]),
    )
    return 100.0 * best.relative_depth_sigma
