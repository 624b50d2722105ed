"""The accuracy programme: every method on the same simulated flights, beside the paper's figures and the bound.

Flights are made at sighting level (`flights.py`) for the rows of `rows.py`. Each row is flown many times; a method's
figures are the median and the 95th percentile of its depth error at the first sighting, and for methods with a
covariance how often the 95 % ellipse of the last position holds the truth.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate import ESTIMATORS, Estimator
from mission.estimate.bound import bound
from mission.records import Estimate
from sitl.evaluation.accuracy.flights import SimulatedFlight
from sitl.evaluation.accuracy.rows import ROWS, PatternName, Row, row_flights
from sitl.evaluation.comparators import stone_soup
from sitl.evaluation.comparators.bearing_angle import BearingAngle
from sitl.evaluation.comparators.ground_ray import GroundRay
from sitl.evaluation.comparators.least_squares import LeastSquares

_LEAST_SQUARES = LeastSquares()
_STONE_SOUP: tuple[Estimator, ...] = (stone_soup.StoneSoup("EKF"), stone_soup.StoneSoup("UKF"))
_METHODS: tuple[Estimator, ...] = (
    *(ESTIMATORS[name] for name in ("classical", "stereo", "three-image", "four-image")),
    GroundRay(),
    *_STONE_SOUP,
    BearingAngle(),
    _LEAST_SQUARES,
    ESTIMATORS["constant-velocity"],
    ESTIMATORS["batch"],
)
METHODS: Mapping[str, Estimator] = {method.name: method for method in _METHODS}
"""The methods that are compared, in the order of the table."""
BOUND = "bound"
"""Name of the Cramer-Rao bound among the figures."""
INSIDE_CHI2 = 5.991
"""95th percentile of chi-square with 2 degrees of freedom."""


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


@dataclass(frozen=True, slots=True)
class MethodOutcome:
    """What one method made of one flight."""

    method: str
    error_percent: float | None
    """Depth error at the first sighting, signed; of the bound its 1-sigma. None where nothing was answered."""
    inside: bool | None
    """Whether the 95 % ellipse of the last position holds the truth; None without an ellipse."""


def available_methods() -> tuple[str, ...]:
    """Names of the methods that can run here: all but those of a package that is not installed."""
    left_out = () if stone_soup.installed() else tuple(method.name for method in _STONE_SOUP)
    return tuple(name for name in METHODS if name not in left_out)


def accuracy(
    pattern: PatternName,
    flights: int,
    seed: int,
    *,
    rows: Sequence[Row] = ROWS,
    methods: Sequence[str] = (),
    least_squares_flights: int = 20,
    tell: Callable[[], None] | None = None,
) -> Iterator[Figures]:
    """Fly every row and give each method's figures, and the bound's as a method of its own.

    Args:
        pattern: which pattern is flown.
        flights: how many flights a row.
        seed: of all randomness; every method gets the same flights.
        rows: the cases.
        methods: names out of `METHODS`, all that are available when empty.
        least_squares_flights: SciPy's solver gets no more than this many of a row's flights; it is slow.
        tell: called after each solution.
    """
    names = tuple(methods) or available_methods()
    for number, row in enumerate(rows):
        simulated = row_flights(row, pattern, flights, np.random.default_rng((seed, number)))
        for name in names:
            share = _share(name, flights, least_squares_flights)
            if share > 0:
                yield _figures(row, name, simulated[:share], tell)
        yield figures_of(row, BOUND, [outcome(BOUND, sim) for sim in simulated])


def solutions(methods: Sequence[str], rows: int, flights: int, least_squares_flights: int) -> int:
    """How many solutions `accuracy` will have made: what a progress bar counts."""
    names = tuple(methods) or available_methods()
    return rows * sum(_share(name, flights, least_squares_flights) for name in names)


def write_csv(path: Path, figures: Sequence[Figures]) -> None:
    """The figures as a table, one line for each row and method.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(
            (
                *("motion", "depth_m", "published_percent", "method", "median_percent", "p95_percent"),
                *("answered", "flights", "inside_percent"),
            )
        )
        for f in figures:
            writer.writerow(
                (
                    f.row.motion,
                    f.row.depth_m,
                    "" if f.row.published_percent is None else f.row.published_percent,
                    f.method,
                    f"{f.median_percent:.2f}" if f.answered else "",
                    f"{f.p95_percent:.2f}" if f.answered else "",
                    f.answered,
                    f.flights,
                    "" if f.inside_percent is None else f"{f.inside_percent:.1f}",
                )
            )


def squared_miss(estimate: Estimate, sim: SimulatedFlight) -> float | None:
    """Normalised squared error of the last horizontal position (chi-square, 2 dof); None without a covariance."""
    if estimate.covariance is None:
        return None
    miss = (estimate.position_enu_m - sim.target_m[-1])[:2]
    return float(miss @ np.linalg.solve(estimate.covariance[:2, :2], miss))


def depth_bound_m(sim: SimulatedFlight) -> float:
    """Least 1-sigma of the depth at the first sighting, with the attitudes as flown.

    Raises:
        EstimateRefused: the flight does not determine the target.
    """
    flight = sim.flight
    if len(flight.sightings) < 3:
        raise EstimateRefused("Fewer than three sightings bound nothing")
    return bound(
        np.array([s.t_s for s in flight.sightings]),
        sim.camera_m,
        sim.target_m[0],
        sim.velocity_m_s[0],
        flight.camera,
        flight.noise,
        flight.prior,
        world_from_camera_wxyz=np.array([s.world_from_camera_wxyz for s in flight.sightings]),
    ).depth_sigma_m


def _share(name: str, flights: int, least_squares_flights: int) -> int:
    return min(flights, least_squares_flights) if name == _LEAST_SQUARES.name else flights


def outcome(name: str, sim: SimulatedFlight) -> MethodOutcome:
    """What one method, or the bound, makes of one flight."""
    try:
        if name == BOUND:
            return MethodOutcome(name, 100.0 * depth_bound_m(sim) / sim.depth_m, None)
        estimate = METHODS[name].estimate(sim.flight)
    except EstimateRefused:
        return MethodOutcome(name, None, None)
    squared = squared_miss(estimate, sim)
    return MethodOutcome(
        name, 100.0 * (estimate.depth_m / sim.depth_m - 1.0), None if squared is None else squared < INSIDE_CHI2
    )


def figures_of(row: Row, name: str, outcomes: Sequence[MethodOutcome]) -> Figures:
    """One method's figures of a row from what it made of each flight."""
    errors = [abs(found.error_percent) for found in outcomes if found.error_percent is not None]
    inside = [found.inside for found in outcomes if found.inside is not None]
    if not errors:
        return Figures(row, name, math.nan, math.nan, 0, len(outcomes), None)
    middle, high = float(np.median(errors)), float(np.percentile(errors, 95))
    if name == BOUND:
        # Of a normal error the median of the absolute value is 0.6745 sigma, its 95th percentile 1.96.
        middle, high = 0.6745 * middle, 1.96 * middle
    share = 100.0 * float(np.mean(inside)) if inside else None
    return Figures(row, name, middle, high, len(errors), len(outcomes), share)


def _figures(row: Row, name: str, simulated: Sequence[SimulatedFlight], tell: Callable[[], None] | None) -> Figures:
    outcomes = []
    for sim in simulated:
        outcomes.append(outcome(name, sim))
        if tell is not None:
            tell()
    return figures_of(row, name, outcomes)
