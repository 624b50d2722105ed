"""The figures of many rendered flights: a table for people, and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.table import Table
from scipy.stats import chi2

from mission.records import Vector
from sitl.evaluation.rendered.result_row import Poses, ResultRow
from sitl.simulation.score import ELLIPSE_95

LOOKS: dict[Poses, tuple[str, str]] = {"reported": ("#d55e00", "o"), "steadied": ("#0072b2", "s")}
"""Colour-blind safe (Okabe & Ito)."""
_RESAMPLED = 400


@dataclass(frozen=True, slots=True)
class Summary:
    """What many flights have in common, for one way to the poses."""

    poses: Poses
    flights: int
    answered: int
    median_percent: float
    median_spread: float
    """Standard error of the median, by resampling the flights."""
    p95_percent: float
    worst_percent: float
    inside_percent: float
    nees: float
    nees_spread: float
    """Standard error of the mean."""
    heading_deg: float
    """Rms over all flights."""
    tilt_deg: float
    offset_ms: float
    """Rms."""
    track_ms: float
    steady_ms: float


def summarise(outcomes: Sequence[ResultRow], poses: Poses) -> Summary | None:
    """The figures of one way; None where nothing was flown that way."""
    flown = [o for o in outcomes if o.poses == poses]
    answered = [o for o in flown if o.answered]
    if not flown or not answered:
        return None
    depth = 100.0 * np.abs([o.depth_error for o in answered])
    nees = np.array([o.nees for o in answered])
    rng = np.random.default_rng(0)
    medians = np.median(depth[rng.integers(0, len(depth), (_RESAMPLED, len(depth)))], axis=1)
    return Summary(
        poses=poses,
        flights=len(flown),
        answered=len(answered),
        median_percent=float(np.median(depth)),
        median_spread=float(medians.std()),
        p95_percent=float(np.percentile(depth, 95)),
        worst_percent=float(depth.max()),
        inside_percent=100.0 * float(np.mean(nees <= ELLIPSE_95)),
        nees=float(nees.mean()),
        nees_spread=float(nees.std() / np.sqrt(len(nees))),
        heading_deg=_rms([o.heading_error_deg for o in answered]),
        tilt_deg=_rms([o.tilt_error_deg for o in answered]),
        offset_ms=_rms([o.offset_error_ms for o in answered]),
        track_ms=_mean([o.track_ms for o in answered]),
        steady_ms=_mean([o.steady_ms for o in answered]),
    )


def table(summaries: Sequence[Summary], title: str) -> Table:
    """One column for each way to the poses."""
    shown = Table("", *(s.poses for s in summaries), title=title)
    rows: list[tuple[str, list[str]]] = [
        ("flights, answered", [f"{s.flights}, {s.answered}" for s in summaries]),
        ("depth error: median, %", [f"{s.median_percent:.1f} +- {s.median_spread:.1f}" for s in summaries]),
        ("95th percentile, %", [f"{s.p95_percent:.1f}" for s in summaries]),
        ("worst, %", [f"{s.worst_percent:.1f}" for s in summaries]),
        ("95 % ellipses right, %", [f"{s.inside_percent:.0f}" for s in summaries]),
        ("normalised error squared (2 is right)", [f"{s.nees:.2f} +- {s.nees_spread:.2f}" for s in summaries]),
        ("heading, rms from the first frame, deg", [f"{s.heading_deg:.2f}" for s in summaries]),
        ("tilt, per axis, deg", [f"{s.tilt_deg:.2f}" for s in summaries]),
        ("time offset, rms error, ms", [f"{s.offset_ms:.1f}" for s in summaries]),
        ("tracking, ms a frame", [f"{s.track_ms:.1f}" for s in summaries]),
        ("steadying, ms a frame", [f"{s.steady_ms:.1f}" for s in summaries]),
    ]
    for name, cells in rows:
        shown.add_row(name, *(cell.replace("nan", "-") for cell in cells))
    return shown


def write_figure(path: Path, outcomes: Sequence[ResultRow], title: str) -> None:
    """Depth errors over distance, and the normalised errors against the distribution that they should have.

    Raises:
        OSError: the file cannot be written.
        ValueError: no flight was answered.
    """
    if not any(o.answered for o in outcomes):
        raise ValueError("no answered flight to draw")
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12)
    left, right = figure.subplots(1, 2)
    for poses, (colour, marker) in LOOKS.items():
        flown = [o for o in outcomes if o.poses == poses and o.answered]
        if not flown:
            continue
        depth = 100.0 * np.abs([o.depth_error for o in flown])
        far = [o.distance_m for o in flown]
        inside = np.array([o.nees <= ELLIPSE_95 for o in flown])
        for held, face in ((True, colour), (False, "white")):
            chosen = inside == held
            left.scatter(
                np.array(far)[chosen],
                np.maximum(depth[chosen], 0.1),
                marker=marker,
                s=26,
                facecolor=face,
                edgecolor=colour,
                label=f"{poses} poses, median {np.median(depth):.1f} %" if held else None,
            )
        nees = np.sort([o.nees for o in flown])
        right.step(nees, (np.arange(len(nees)) + 1.0) / len(nees), where="post", color=colour, label=f"{poses} poses")
    left.set_yscale("log")
    left.set_yticks([0.1, 0.3, 1, 3, 10, 30, 100], labels=["0.1", "0.3", "1", "3", "10", "30", "100"])
    left.set_xlabel("distance when the pattern begins, m")
    left.set_ylabel("depth error, % (hollow: outside its 95 % ellipse)")
    grid: Vector = np.linspace(0.0, 14.0, 200)
    right.plot(grid, chi2.cdf(grid, 2), color="black", linewidth=1.2, label="as it should be (chi-square, 2)")
    right.axvline(ELLIPSE_95, color="#999999", linewidth=1.0, linestyle="--")
    right.set_xlim(0.0, 14.0)
    right.set_ylim(0.0, 1.01)
    right.set_xlabel("normalised error squared of the last position")
    right.set_ylabel("share of flights below")
    for axes in (left, right):
        axes.grid(color="#dddddd", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.legend(fontsize=9, loc="lower right" if axes is right else "upper left")
    figure.savefig(path, dpi=130)


def _rms(values: Sequence[float]) -> float:
    known = np.array(values)[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def _mean(values: Sequence[float]) -> float:
    known = np.array(values)[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
