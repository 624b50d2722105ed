"""How true the tracker's answers are: rendered flights past a person, tracked as the mission does, held to the truth.

``python -m sitl.evaluation.tracking`` flies the out-and-back pattern past people at several distances and ways of
walking (`sitl.evaluation.rendered`) and prints, per flight, the errors of the line of sight and of the log of the
body's height, then their correlation times and whether the reported standard deviations hold. The mission's estimator
uses ratios of heights, so what counts is how the error of the log height changes within a flight, not its mean.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from mission.camera.model import CameraModel
from mission.detect.auto import AutoDetector
from mission.detect.nanodet import NanoDet
from mission.errors import DetectionError
from mission.records import Vector
from mission.track import Tracker
from sitl.evaluation.rendered import Case, RenderedFlight
from sitl.evaluation.rendered.case import NEAREST_M, nearest_m
from sitl.evaluation.rendered.replay import Replay, replay

DISTANCES_M = (2.75, 5.5, 7.25, 9.0, 12.0, 15.0)
WALKS_DEG: tuple[float | None, ...] = (None, 0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0)
_LAGS = 40


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """What the tracker got wrong in one flight, frame by frame."""

    case: Case
    frames: int
    """Of the pattern."""
    t_s: Vector
    """(n,) of the frames tracked."""
    errors: Vector
    """(n, 3): to the right and down in pixels, and log height; NaN where no height was given."""
    sigmas: Vector
    """(n, 2): reported for pixel and log height."""
    height_px: Vector
    """(n,) true."""
    frame_ms: float
    """Processor time per frame."""


def cases(seed: int, size_px: tuple[int, int], distances_m: Sequence[float] = DISTANCES_M) -> Iterator[Case]:
    """Every distance with every way of walking, but for the walks that end at the drone."""
    for number, (distance, walk) in enumerate((d, w) for d in distances_m for w in WALKS_DEG):
        height_m = float(np.random.default_rng([seed, number]).uniform(1.6, 1.9))
        case = Case(seed + number, distance, walk, size_px=size_px, renderings=2, height_m=height_m)
        if nearest_m(case) >= NEAREST_M:
            yield case


def errors_of(flight: RenderedFlight, followed: Replay) -> Errors:
    """Hold a flight's tracks to the truth, each at the time at which its row was exposed.

    The error of the line of sight is taken level and upright, as angle times focal length: the same point of the body
    is meant however the camera rolls.
    """
    lens = CameraModel(flight.camera.intrinsics)
    focal = flight.camera.intrinsics.fy
    rows = []
    for seen in followed.tracked:
        track = seen.track
        if track.state != "tracking":
            continue
        t_s = flight.camera.row_time_s(seen.capture_s, track.pixel[1])
        camera = flight.true_camera(t_s)
        true = flight.target(t_s) - camera.position_enu_m
        told = camera.world_from_camera @ lens.ray(np.array(track.pixel))
        right = math.remainder(math.atan2(told[0], told[1]) - math.atan2(true[0], true[1]), math.tau)
        up = math.atan2(told[2], math.hypot(*told[:2])) - math.atan2(true[2], math.hypot(*true[:2]))
        height = focal * flight.case.height_m / float(true @ camera.world_from_camera[:, 2])
        log_height = math.nan if track.height_px is None else math.log(track.height_px / height)
        size_sigma = math.nan if track.size_sigma is None else track.size_sigma
        rows.append((t_s, focal * right, -focal * up, log_height, track.pixel_sigma_px, size_sigma, height))
    table = np.array(rows).reshape(-1, 7)
    return Errors(
        flight.case,
        len(followed.tracked),
        table[:, 0],
        table[:, 1:4],
        table[:, 4:6],
        table[:, 6],
        followed.track_ms,
    )


def drift(errors: Errors) -> float:
    """How far the straight line through the errors of the log height rises from the flight's begin to its end."""
    ok = np.isfinite(errors.errors[:, 2])
    if ok.sum() < 0.5 * errors.frames:
        return math.nan
    slope = float(np.polyfit(errors.t_s[ok], errors.errors[ok, 2], 1)[0])
    return slope * float(np.ptp(errors.t_s))


def consistency(results: Sequence[Errors]) -> Vector:
    """(3,) mean squared error over reported sigma of x, y and log height, each flight's mean taken away; 1 is ideal."""
    ratios = [_centred(r) / r.sigmas[:, [0, 0, 1]] for r in results]
    return np.asarray(np.nanmean(np.concatenate(ratios) ** 2, axis=0))


def correlation_s(results: Sequence[Errors]) -> Vector:
    """(3,) lag at which the mean autocorrelation of the errors of x, y and log height falls below 1/e, seconds."""
    total, frame_s = np.zeros((_LAGS, 3)), 0.05
    for r in results:
        if len(r.errors) < 2 * _LAGS:
            continue
        e = np.nan_to_num(_centred(r) / [r.height_px.mean(), r.height_px.mean(), 1.0])
        total += [(e[: len(e) - k] * e[k:]).mean(axis=0) for k in range(_LAGS)]
        frame_s = float(np.median(np.diff(r.t_s)))
    return np.asarray(np.argmax(total < total[0] / math.e, axis=0) * frame_s)


def _centred(errors: Errors) -> Vector:
    heights = errors.errors[:, 2]
    mean = np.append(errors.errors[:, :2].mean(axis=0), np.nanmean(heights) if np.isfinite(heights).any() else 0.0)
    return np.asarray(errors.errors - mean)


def report(results: Sequence[Errors]) -> Table:
    """One row per flight."""
    table = Table("m", "walk", "tracked", "x px", "y px", "log height", "drift", "ms/frame", title="bias and std")
    for r in results:
        mean, std = r.errors.mean(axis=0), _centred(r).std(axis=0)
        heights = r.errors[:, 2][np.isfinite(r.errors[:, 2])]
        table.add_row(
            f"{r.case.distance_m:g}",
            "stands" if r.case.walk_deg is None else f"{r.case.walk_deg:.0f}",
            f"{100 * len(r.errors) / r.frames:.0f} %",
            f"{mean[0]:+.2f} {std[0]:.2f}",
            f"{mean[1]:+.2f} {std[1]:.2f}",
            f"{heights.mean():+.3f} {heights.std():.3f}" if len(heights) else "-",
            f"{drift(r):+.3f}",
            f"{r.frame_ms:.1f}",
        )
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly, track, and show the errors."""
    parser = argparse.ArgumentParser(
        prog="python -m sitl.evaluation.tracking", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--seed", type=int, default=1, help="scenery, clothes, light and noise")
    parser.add_argument("--distances", type=float, nargs="*", default=list(DISTANCES_M), metavar="M")
    parser.add_argument("--size", choices=("640x480", "1280x720"), default="640x480")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    network, detector, results = NanoDet(), AutoDetector(), []
    width, height = (int(v) for v in options.size.split("x"))
    console = Console()
    for case in cases(options.seed, (width, height), options.distances):
        flight = RenderedFlight(case)
        try:
            errors = errors_of(flight, replay(flight, detector, Tracker(network)))
        except DetectionError as error:
            console.print(f"{case.name}: {error}")
            continue
        if len(errors.t_s) > 1:
            results.append(errors)
        else:
            console.print(f"{case.name}: lost at once")
    if not results:
        console.print("no flight was tracked")
        return
    console.print(report(results))
    x, y, size = consistency(results)
    console.print(f"squared error over reported variance: x {x:.2f}, y {y:.2f}, log height {size:.2f} (1 is ideal)")
    x, y, size = correlation_s(results)
    console.print(f"correlation time: x {x:.2f} s, y {y:.2f} s, log height {size:.2f} s")
    drifts = np.array([abs(drift(r)) for r in results])
    console.print(f"drift of log height: median {np.nanmedian(drifts):.3f}, 90 % {np.nanquantile(drifts, 0.9):.3f}")


if __name__ == "__main__":
    main()
