"""The baseline table: how far the aircraft has travelled at each image of the paper's pattern (Kim & Yow 2015, III-D).

The aircraft flies the pattern along a wall with markers, several times. Each picture says where it was; the travel at
the pattern's image times, averaged over the runs, is the table (the paper's Table II), and its spread says how far one
flight may be trusted to repeat it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.calibration.wall import WallSight
from mission.errors import CalibrationError
from mission.records import Vector

LEAST_RUNS = 3
"""Fewer say nothing about the spread."""
IMAGES = 11
INTERVAL_S = 0.5
HOVER_S = 1.0
"""Before a run the aircraft keeps its place for this long."""
MOST_BETWEEN_S = 0.35
"""Between two pictures farther apart than this, nothing is interpolated."""
LEAST_PICTURES = 8
LEAST_TRAVEL_M = 1.0
DELAYS_S = (-0.1, 0.8)
"""Of the video, that are looked for."""
DELAY_STEP_S = 0.005
LARGEST_CLIMB = 0.5
"""A run that leaves the wall's direction by more than this share of its travel was not flown along the wall."""


@dataclass(frozen=True, slots=True, eq=False)
class WallRun:
    """One flight of the pattern along the wall."""

    started_s: float
    """When the pattern began: the time of image 0."""
    times_s: Vector
    """(n,) of the pictures in which the wall was recognised, rising."""
    sights: tuple[WallSight, ...]
    """(n)."""


@dataclass(frozen=True, slots=True, eq=False)
class BaselineTable:
    """Travel at each image."""

    step_m: Vector
    """(images,) mean travel since the previous image, as the paper prints it; the first is 0."""
    step_sigma_m: Vector
    """(images,) its spread from run to run (standard deviation)."""
    travel_m: Vector
    """(images,) mean travel since image 0."""
    travel_sigma_m: Vector
    """(images,) its spread; not the root sum of squares of the steps', which are correlated within a run."""
    runs: Vector
    """(images,) how many runs reached this image."""

    def __len__(self) -> int:
        """Number of images."""
        return len(self.step_m)


def travel_of(run: WallRun, images: int = IMAGES, interval_s: float = INTERVAL_S) -> Vector:
    """Travel along the wall since image 0 at each image's time, (images,) m; NaN where the wall was not seen.

    Args:
        run: one flight.
        images: how many.
        interval_s: between them.

    Raises:
        CalibrationError: the wall was not seen at the start, or the flight was not along it.
    """
    times = np.asarray(run.times_s, dtype=np.float64)
    if len(times) != len(run.sights) or len(times) < 2 or not (np.diff(times) > 0.0).all():
        raise CalibrationError(
            "The wall was recognised in fewer than two pictures of a run", "Fly nearer, or use larger markers."
        )
    places = np.array([sight.position_m for sight in run.sights])
    wanted: Vector = run.started_s + interval_s * np.arange(images, dtype=np.float64)
    at = np.column_stack([_interpolated(times, places[:, axis], wanted) for axis in range(3)])
    hover = np.flatnonzero((times <= wanted[0]) & (times > wanted[0] - HOVER_S))
    if not np.isfinite(at[0]).all() and len(hover):
        at[0] = places[hover[-1]]  # pictures come late, but it stood still
    if not np.isfinite(at[0]).all():
        raise CalibrationError(
            "The wall was not recognised when a run began", "Begin where at least two markers are in view."
        )
    moved = at - at[0]
    seen = moved[np.isfinite(moved).all(axis=1)]
    along, across = seen[-1, 0], math.hypot(seen[-1, 1], seen[-1, 2])
    if len(seen) > 1 and across > LARGEST_CLIMB * abs(along) and across > 0.3:
        raise CalibrationError(
            f"A run went {across:.1f} m away from the wall's direction and {abs(along):.1f} m along it",
            "Turn the aircraft until it looks straight at the wall, and fly again.",
        )
    travel: Vector = np.abs(moved[:, 0])
    return travel


def baseline_table(travels: Sequence[Vector]) -> BaselineTable:
    """Average and spread over the runs.

    Args:
        travels: of each run (`travel_of`), all of the same length.

    Raises:
        CalibrationError: too few runs, or an image that too few of them reached.
    """
    if len(travels) < LEAST_RUNS:
        raise CalibrationError(
            f"{len(travels)} runs cannot tell how well the flight repeats itself", f"Fly {LEAST_RUNS} at least."
        )
    rows = np.array(travels, dtype=np.float64)
    counts = np.isfinite(rows).sum(axis=0)
    reached = int(np.argmin(counts >= LEAST_RUNS)) if (counts < LEAST_RUNS).any() else rows.shape[1]
    if reached < 2:
        raise CalibrationError(
            "The wall was lost at the first image of most runs", "Use more markers, nearer together."
        )
    rows = rows[:, :reached]
    steps = np.diff(rows, axis=1, prepend=rows[:, :1])
    return BaselineTable(
        step_m=np.nanmean(steps, axis=0),
        step_sigma_m=np.nanstd(steps, axis=0, ddof=1),
        travel_m=np.nanmean(rows, axis=0),
        travel_sigma_m=np.nanstd(rows, axis=0, ddof=1),
        runs=counts[:reached],
    )


def reckoning_scale(true_m: Sequence[Vector], reckoned_m: Sequence[Vector]) -> tuple[float, float]:
    """True over reckoned travel by least squares, and its spread from run to run: the scale of the aircraft's velocity.

    Args:
        true_m: travel of each run on the wall.
        reckoned_m: what the aircraft's own poses said, at the same images.

    Raises:
        CalibrationError: too few runs, or none that moved.
    """
    scales = []
    for true, reckoned in zip(true_m, reckoned_m, strict=True):
        both = np.isfinite(true) & np.isfinite(reckoned)
        power = float(reckoned[both] @ reckoned[both])
        if power > 0.01:
            scales.append(float(true[both] @ reckoned[both]) / power)
    if len(scales) < LEAST_RUNS:
        raise CalibrationError("Too few runs moved along the wall", f"Fly {LEAST_RUNS} at least.")
    return float(np.mean(scales)), float(np.std(scales, ddof=1))


def video_delay(times_s: Vector, along_m: Vector, reckoned_s: Vector, reckoned_m: Vector) -> float:
    """How much later than the aircraft's poses the pictures are stamped, seconds.

    Wall and aircraft describe the same travel, each with its own zero and scale: the delay is where they agree best
    (least squares). Speed must have changed on the way, as it does where a run begins and ends at rest.

    Args:
        times_s: (n,) of the pictures.
        along_m: (n,) the camera's place along the wall, in either direction.
        reckoned_s: (m,) rising times of the poses.
        reckoned_m: (m,) travel according to them; NaN where none is known.

    Raises:
        CalibrationError: too few of either, or nothing moved.
    """
    known = np.isfinite(reckoned_m)
    if np.count_nonzero(known) < LEAST_PICTURES or len(times_s) < LEAST_PICTURES:
        raise CalibrationError(
            "The wall was recognised in too few pictures of a run to tell the video's delay",
            "Fly nearer, or use larger markers.",
        )
    times, travel = reckoned_s[known], reckoned_m[known]
    if float(np.ptp(travel)) < LEAST_TRAVEL_M:
        raise CalibrationError("The aircraft did not move along the wall", "Fly again with room to the side.")
    tried = np.arange(DELAYS_S[0], DELAYS_S[1], DELAY_STEP_S)
    misses = []
    for delay_s in tried:
        there = np.interp(times_s - delay_s, times, travel)
        columns = np.column_stack((there, np.ones_like(there)))
        solved = np.linalg.lstsq(columns, along_m, rcond=None)[0]
        misses.append(float(np.sum((along_m - columns @ solved) ** 2)))
    return float(tried[int(np.argmin(misses))])


def _interpolated(times_s: Vector, values: Vector, wanted_s: Vector) -> Vector:
    """Linear between neighbours that are near enough; the first and last reach out by a tenth of a second."""
    found = np.interp(wanted_s, times_s, values)
    after = np.clip(np.searchsorted(times_s, wanted_s), 1, len(times_s) - 1)
    gap = times_s[after] - times_s[after - 1]
    outside = (wanted_s < times_s[0] - 0.1) | (wanted_s > times_s[-1] + 0.1)
    found[outside | (gap > MOST_BETWEEN_S)] = np.nan
    return found
