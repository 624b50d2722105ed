"""The figures that the default method is held to, pooled over many flights with the sightings format's default noise.

The target's figures (how good is good enough) stand beside what is measured; none of them enters the measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate import ESTIMATORS
from mission.records import Vector
from sitl.evaluation.accuracy.flights import SimulatedFlight
from sitl.evaluation.accuracy.programme import INSIDE_CHI2, depth_bound_m, squared_miss
from sitl.evaluation.accuracy.rows import PatternName, drawn_flights, walking_flights

MOVING: tuple[PatternName, ...] = ("out-and-back", "S")
RANDOM_WALK_PSD = 0.005
"""White-noise acceleration of the manoeuvring target, m2/s3."""
WRONG_SHARE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Pooled:
    """What the default method made of many flights."""

    flights: int
    error: Vector
    """(k,), relative depth error at the first sighting, signed, of each answered flight."""
    standardised: Vector
    """(j,), depth error over the Cramer-Rao bound's sigma, where the bound was asked for."""
    squared: Vector
    """(k,), normalised squared error of the last horizontal position."""
    poor: int
    """How many estimates said that the geometry is poor."""

    @property
    def refused(self) -> int:
        """How many flights had no answer."""
        return self.flights - len(self.error)

    @property
    def median_percent(self) -> float:
        """Median depth error."""
        return 100.0 * float(np.median(np.abs(self.error)))

    @property
    def p95_percent(self) -> float:
        """95th percentile of the depth error."""
        return 100.0 * float(np.percentile(np.abs(self.error), 95))

    @property
    def over_bound(self) -> float:
        """Root mean square depth error over the Cramer-Rao bound."""
        return float(np.sqrt(np.mean(np.square(self.standardised))))

    @property
    def inside_percent(self) -> float:
        """How often the 95 % ellipse of the last position holds the truth."""
        return 100.0 * float(np.mean(self.squared < INSIDE_CHI2))

    @property
    def nees(self) -> float:
        """Mean normalised estimation error squared, 2 degrees of freedom."""
        return float(np.mean(self.squared))


@dataclass(frozen=True, slots=True)
class Held:
    """One figure, and what it is held to."""

    what: str
    measured: str
    wanted: str
    reached: bool


def pool(
    simulated: Iterable[SimulatedFlight], *, with_bound: bool = False, tell: Callable[[], None] | None = None
) -> Pooled:
    """Answer every flight with `batch`.

    Args:
        simulated: the flights.
        with_bound: whether each one's Cramer-Rao bound is evaluated too.
        tell: called after each flight.
    """
    error: list[float] = []
    standardised: list[float] = []
    squared: list[float] = []
    flights = poor = 0
    for sim in simulated:
        flights += 1
        if tell is not None:
            tell()
        try:
            estimate = ESTIMATORS["batch"].estimate(sim.flight)
        except EstimateRefused:
            continue
        error.append(estimate.depth_m / sim.depth_m - 1.0)
        miss = squared_miss(estimate, sim)
        squared.append(np.nan if miss is None else miss)
        poor += any("poor" in note for note in estimate.notes)
        if with_bound:
            standardised.append((estimate.depth_m - sim.depth_m) / depth_bound_m(sim))
    return Pooled(flights, np.array(error), np.array(standardised), np.array(squared), poor)


def summary(flights: int, seed: int, tell: Callable[[], None] | None = None) -> Pooled:
    """Out-and-back and S patterns, seven walks, 2.75 to 25 m."""
    return pool(walking_flights(MOVING, flights, seed), with_bound=True, tell=tell)


SUITE_RUNS = 5
"""How many times `suite` flies its number of flights."""


def suite(flights: int, seed: int, tell: Callable[[], None] | None = None) -> Iterator[Held]:
    """Fly everything that the default method is held to.

    Args:
        flights: for each of the five runs.
        seed: of all randomness.
        tell: called after each flight.
    """
    walks = summary(flights, seed, tell)
    pattern = "out-and-back and S, walks in 7 directions, 2.75 to 25 m: "
    yield _at_most(pattern + "median depth error, %", walks.median_percent, 2.1)
    yield _at_most(pattern + "95th percentile, %", walks.p95_percent, 6.2)
    yield _at_most(pattern + "rms error over the bound", walks.over_bound, 1.15, digits=3)
    yield _at_most(pattern + "refused", walks.refused, 0)
    drawn = pool(drawn_flights(MOVING, flights, seed), tell=tell)
    yield _within("velocities from the prior: 95 % ellipse right, %", drawn.inside_percent, 92.0, 97.0)
    yield _within("velocities from the prior: mean normalised error squared", drawn.nees, 1.8, 2.4)
    wandering = pool(walking_flights(MOVING, flights, seed, acceleration_psd_m2_s3=RANDOM_WALK_PSD), tell=tell)
    told = f"velocity a random walk of {RANDOM_WALK_PSD} m2/s3, told: "
    yield _at_most(told + "median depth error, %", wandering.median_percent, 5.2)
    yield _within(told + "95 % ellipse right, %", wandering.inside_percent, 91.0, 97.0)
    wrong = pool(walking_flights(MOVING, flights, seed, wrong_share=WRONG_SHARE), tell=tell)
    yield _at_most("10 % wrong sightings: median over the clean one", wrong.median_percent / walks.median_percent, 1.3)
    yield _at_most("10 % wrong sightings: refused", wrong.refused, 0)
    paper = pool(walking_flights(("paper",), flights, seed), with_bound=True, tell=tell)
    yield _at_most("the paper's one-way pattern: rms error over the bound", paper.over_bound, 1.05, digits=3)
    answered = len(paper.error)
    yield Held(
        "the paper's one-way pattern: calls itself poor, or refuses",
        f"{100.0 * (paper.poor + paper.refused) / paper.flights:.0f} % "
        f"(median {paper.median_percent:.1f} %, {answered} of {paper.flights} answered; "
        f"of the out-and-back and S flights {100.0 * walks.poor / walks.flights:.0f} % call themselves poor)",
        "at least 95 %",
        paper.poor + paper.refused >= 0.95 * paper.flights,
    )


def _at_most(what: str, value: float, limit: float, digits: int = 2) -> Held:
    return Held(what, f"{value:.{digits}f}", f"at most {limit:g}", value <= limit)


def _within(what: str, value: float, low: float, high: float) -> Held:
    return Held(what, f"{value:.2f}", f"{low:g} to {high:g}", low <= value <= high)
