"""`sidestep accuracy --suite --walks ...`: is the ellipse true for people as they walk? Many flights, all cores."""

from __future__ import annotations

import csv
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from mission.errors import EstimateRefused
from sitl.evaluation.accuracy.programme import INSIDE_CHI2, METHODS, squared_miss
from sitl.evaluation.people.flights import PeopleSetting, people_flight

_NICENESS = 10
_CHUNK = 5
_NUMBER = re.compile(r"-?\d+(\.\d+)?")


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a method made of one flight."""

    number: int
    name: str
    """Geometry, and what the person did."""
    depth_m: float
    refused: str | None
    """Why there is no answer."""
    error: float | None
    """Relative depth error at the first sighting, signed."""
    squared: float | None
    """Normalised squared error of the last horizontal position."""
    sigma_m: float | None
    """Larger semi-axis of the 1-sigma ellipse there."""
    model: str


def judge(setting: PeopleSetting, seed: int, number: int, method: str = "batch") -> Verdict:
    """Fly and estimate one."""
    sim = people_flight(setting, seed, number)
    try:
        estimate = METHODS[method].estimate(sim.flight)
    except EstimateRefused as error:
        return Verdict(number, sim.flight.id, sim.depth_m, str(error), None, None, None, "")
    sigma = None if estimate.covariance is None else np.sqrt(np.linalg.eigvalsh(estimate.covariance[:2, :2])[-1])
    return Verdict(
        number,
        sim.flight.id,
        sim.depth_m,
        None,
        estimate.depth_m / sim.depth_m - 1.0,
        squared_miss(estimate, sim),
        None if sigma is None else float(sigma),
        estimate.model,
    )


def judged(
    setting: PeopleSetting,
    flights: int,
    seed: int,
    *,
    processes: int = 0,
    first: int = 0,
    method: str = "batch",
    tell: Callable[[], None] | None = None,
) -> Iterator[Verdict]:
    """All flights in turn; what a flight is depends on its number and the seed only.

    Args:
        setting: what is flown.
        flights: how many.
        seed: of the campaign.
        processes: how many at once; 0 is one a core, 1 is this one.
        first: number of the first flight.
        method: the estimator, out of `METHODS`.
        tell: called after each flight.
    """
    numbers = range(first, first + flights)
    if processes == 1:
        for number in numbers:
            yield judge(setting, seed, number, method)
            if tell is not None:
                tell()
        return
    with ProcessPoolExecutor(processes or os.cpu_count(), get_context("spawn"), os.nice, (_NICENESS,)) as pool:
        flown = zip(*((setting, seed, k, method) for k in numbers), strict=True)
        for verdict in pool.map(judge, *flown, chunksize=_CHUNK):
            yield verdict
            if tell is not None:
                tell()


def people_table(verdicts: Sequence[Verdict], title: str) -> Table:
    """The figures of a campaign: all flights, then each geometry and each kind of walk that was met often."""
    table = Table(title=title, box=SIMPLE_HEAD)
    for name in ("flights", "flown", "refused %", "95 % right %", "NEES mean", "NEES median", "depth: median %"):
        table.add_column(name, justify="left" if name == "flights" else "right")
    for name in ("p95 %", "bias %", "median sigma m"):
        table.add_column(name, justify="right")
    table.add_row("all", *_cells(verdicts))
    groups: dict[str, list[Verdict]] = {}
    for verdict in verdicts:
        for name in verdict.name.split(", "):
            groups.setdefault(name, []).append(verdict)
    for name, group in groups.items():
        if 20 <= len(group) < len(verdicts):
            table.add_row(name, *_cells(group))
    return table


def refusals(verdicts: Sequence[Verdict]) -> list[str]:
    """Why there was no answer, and how often; the numbers within a reason are left out."""
    reasons = Counter(_NUMBER.sub("#", v.refused) for v in verdicts if v.refused is not None)
    return [f"{count} refused: {reason}" for reason, count in reasons.most_common()]


def write_verdicts(path: Path, verdicts: Sequence[Verdict]) -> None:
    """One line for each flight.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(("number", "flight", "depth_m", "error", "squared", "sigma_m", "model", "refused"))
        for v in verdicts:
            writer.writerow((v.number, v.name, v.depth_m, v.error, v.squared, v.sigma_m, v.model, v.refused or ""))


def _cells(verdicts: Sequence[Verdict]) -> list[str]:
    errors = np.array([v.error for v in verdicts if v.error is not None])
    squared = np.array([v.squared for v in verdicts if v.squared is not None])
    sigmas = [v.sigma_m for v in verdicts if v.sigma_m is not None]
    refused = 100.0 * sum(v.refused is not None for v in verdicts) / len(verdicts)
    if not len(errors) or not len(squared):
        return [str(len(verdicts)), f"{refused:.1f}", *["-"] * 7]
    size = 100.0 * np.abs(errors)
    return [
        str(len(verdicts)),
        f"{refused:.1f}",
        f"{100.0 * np.mean(squared < INSIDE_CHI2):.1f}",
        f"{np.mean(squared):.2f}",
        f"{np.median(squared):.2f}",
        f"{np.median(size):.2f}",
        f"{np.percentile(size, 95):.1f}",
        f"{100.0 * np.median(errors):+.2f}",
        f"{np.median(sigmas):.2f}",
    ]
