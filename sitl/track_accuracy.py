"""How true the tracker's answers are: flights past a person, rendered, compressed, tracked, held to the truth.

``python -m sitl.track_accuracy`` flies the out-and-back pattern past people at several distances and ways of walking
and prints, per flight, the errors of the body's centre and of the log of its height, then their correlation times and
whether the reported standard deviations hold. The mission's estimator uses ratios of heights, so what counts is how the
error of the log height changes within a flight, not its mean.
"""

from __future__ import annotations

import argparse
import io
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import av
import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from mission.detect.nanodet import NanoDet
from mission.records import Box, Frame, Image, Vector
from mission.track import Track, Tracker
from sitl.camera.renderer import CameraPose, Renderer
from sitl.camera.view import PersonView, view_person
from sitl.scenario import Scenario, parse_scenario

FPS = 20.0
_PATTERN_S = 6.0


@dataclass(frozen=True, slots=True)
class Case:
    """One flight."""

    distance_m: float
    walk_deg: float | None
    """From the line of sight: 0 away, 90 to the right, 180 towards; None stands."""
    seed: int
    size_px: tuple[int, int] = (640, 480)
    duration_s: float = _PATTERN_S
    out_m: float = 3.0
    """How far to the side the drone flies."""
    aimed: bool = True
    """Whether the heading is kept on the target."""
    extra: str = ""
    """More of the scenario's TOML: other people, obstacles."""

    @property
    def bearing_deg(self) -> float:
        """Of the person from the drone's start."""
        return float(np.random.default_rng([self.seed, 3]).uniform(-140.0, 140.0))

    def scenario(self) -> Scenario:
        """The scenery and the people."""
        rng = np.random.default_rng(self.seed)
        bearing = self.bearing_deg
        speed = "" if self.walk_deg is None else f"speed_m_s = 0.6\nwalk_from_line_of_sight_deg = {self.walk_deg}\n"
        facing = f"walk_heading_deg = {rng.uniform(-180, 180):.1f}\n" if self.walk_deg is None else ""
        return parse_scenario(
            f"""name = "track"
seed = {self.seed}
[camera]
width_px = {self.size_px[0]}
height_px = {self.size_px[1]}
distortion = {{k1 = -0.08, k2 = 0.01}}
exposure_ms = 8.0
readout_ms = 16.0
noise_grey = 2.5
[light]
brightness = {rng.uniform(0.7, 1.2):.2f}
sun_azimuth_deg = {rng.uniform(-180, 180):.0f}
[[people]]
distance_m = {self.distance_m}
bearing_deg = {bearing:.2f}
height_m = {rng.uniform(1.6, 1.9):.2f}
{speed}{facing}"""
            + self.extra
        )


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One frame of a flight with what is true in it."""

    frame: Frame
    truth: PersonView
    true_height_px: float
    """Focal length times the person's height (that of the standing body) over the depth of its centroid."""
    shift_px: tuple[float, float]
    roll_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class _Flown:
    position_enu_m: Vector
    world_from_camera: Vector
    roll_rad: float

    @property
    def pose(self) -> CameraPose:
        return CameraPose(self.position_enu_m, self.world_from_camera)


class Flight:
    """The drone on its out-and-back path, banking as it must, heading kept on the target to 1.5 degrees."""

    def __init__(self, case: Case, renderer: Renderer) -> None:
        self._case, self._world = case, renderer.world
        self._phase = np.random.default_rng([case.seed, 7]).uniform(0.0, 2.0 * math.pi, 3)
        target = self._world.person_centroid(0, 0.0, 0.0)
        self._left = np.array([-target[1], target[0], 0.0]) / math.hypot(target[0], target[1])

    def at(self, t_s: float) -> _Flown:
        """Where the camera is and how it is turned."""
        rate = 2.0 * math.pi / _PATTERN_S
        a, b, c = self._phase
        out = 0.5 * self._case.out_m * (1.0 - math.cos(rate * t_s))
        position = self._left * (out + 0.03 * math.sin(1.3 * t_s + a)) + [0.0, 0.0, 1.6 + 0.04 * math.sin(t_s + b)]
        acceleration = 0.5 * self._case.out_m * rate**2 * math.cos(rate * t_s)
        roll = -math.atan2(acceleration, 9.81) + math.radians(0.4) * math.sin(2.7 * t_s + c)
        east, north, _ = self._world.person_centroid(0, t_s if self._case.aimed else 0.0, 0.0) - position
        heading = math.atan2(east, north) + math.radians(1.5) * math.sin(1.7 * t_s + c)
        tilt = math.radians(5.0) + math.radians(0.5) * math.sin(2.1 * t_s + a)
        ahead = np.array([math.sin(heading) * math.cos(tilt), math.cos(heading) * math.cos(tilt), -math.sin(tilt)])
        level = np.array([math.cos(heading), -math.sin(heading), 0.0])
        under = np.cross(ahead, level)
        right = level * math.cos(roll) + under * math.sin(roll)
        return _Flown(position, np.stack([right, np.cross(ahead, right), ahead], 1), roll)


def fly(case: Case, samples: int = 4) -> Iterator[Moment]:
    """The flight's frames as the mission gets them (rendered, H.264, decoded), each with the truth."""
    scenario = case.scenario()
    renderer = Renderer(scenario, samples=samples)
    try:
        flight = Flight(case, renderer)
        times = np.arange(round(case.duration_s * FPS)) / FPS
        images = [renderer.expose(lambda t: flight.at(float(t)).pose, float(t), 0.0) for t in times]
    finally:
        renderer.close()
    camera = renderer.camera
    before: _Flown | None = None
    for i, (t, image) in enumerate(zip(times, compressed(images), strict=True)):
        now = flight.at(float(t))
        truth = view_person(renderer.world, 0, now.pose, camera, float(t), 0.0)
        if truth is None:
            return
        shift = (0.0, 0.0)
        if before is not None:
            # The target as the old attitude saw it, seen by the new attitude.
            ray = before.world_from_camera.T @ (truth.centroid_enu_m - now.position_enu_m)
            new = now.world_from_camera.T @ (truth.centroid_enu_m - now.position_enu_m)
            shift = (
                float(camera.fx * (new[0] / new[2] - ray[0] / ray[2])),
                float(camera.fy * (new[1] / new[2] - ray[1] / ray[2])),
            )
        height = camera.fy * scenario.people[0].height_m / truth.depth_m
        yield Moment(Frame(image, float(t), i), truth, height, shift, now.roll_rad)
        before = now


def compressed(images: Sequence[Image], bit_rate: int = 2_000_000) -> list[Image]:
    """The pictures after H.264 as a drone sends it (ultrafast, zero latency)."""
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mpegts") as output:
        stream = output.add_stream("libx264", rate=int(FPS))
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt, stream.bit_rate = "yuv420p", bit_rate
        stream.options = {"preset": "ultrafast", "tune": "zerolatency"}
        for image in images:
            output.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        output.mux(stream.encode(None))
    buffer.seek(0)
    with av.open(buffer, "r") as source:
        return [np.asarray(frame.to_ndarray(format="bgr24"), np.uint8) for frame in source.decode(video=0)]


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """What the tracker got wrong in one flight."""

    case: Case
    tracks: tuple[Track, ...]
    errors: Vector
    """(n, 3): x, y in pixels and log height, per frame tracked; NaN where no height was given."""
    sigmas: Vector
    """(n, 2): reported for pixel and log height."""
    height_px: Vector
    """(n,) true."""
    t_s: Vector
    """(n,)"""
    frame_ms: float
    """Processor time per frame."""


def follow(case: Case, moments: Sequence[Moment], network: NanoDet) -> Errors:
    """Track a flight, started from a rough box around the target."""
    tracker = Tracker(network)
    first = moments[0]
    tall = first.true_height_px
    x, y = first.truth.pixel
    tracker.start(first.frame, Box(x - 0.2 * tall, y - 0.5 * tall, 0.4 * tall, tall), first.roll_rad)
    begun = time.process_time()
    tracks = [tracker.update(m.frame, m.shift_px, m.roll_rad) for m in moments[1:]]
    frame_ms = 1e3 * (time.process_time() - begun) / len(tracks)
    rows = [
        (
            track.pixel[0] - m.truth.pixel[0],
            track.pixel[1] - m.truth.pixel[1],
            math.nan if track.height_px is None else math.log(track.height_px / m.true_height_px),
            track.pixel_sigma_px,
            math.nan if track.size_sigma is None else track.size_sigma,
            m.true_height_px,
            track.t_s,
        )
        for track, m in zip(tracks, moments[1:], strict=True)
        if track.state == "tracking"
    ]
    table = np.array(rows).reshape(-1, 7)
    return Errors(case, tuple(tracks), table[:, :3], table[:, 3:5], table[:, 5], table[:, 6], frame_ms)


DISTANCES_M = (2.75, 5.5, 7.25, 9.0, 12.0, 15.0)
WALKS_DEG: tuple[float | None, ...] = (None, 0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0)


def cases(seed: int, size_px: tuple[int, int], distances_m: Sequence[float] = DISTANCES_M) -> list[Case]:
    """Every distance with every way of walking, but for the walks that end at the drone."""
    grid = [(distance, walk) for distance in distances_m for walk in WALKS_DEG]
    return [
        Case(distance, walk, seed + i, size_px)
        for i, (distance, walk) in enumerate(grid)
        if distance > 3.0 or walk is None or abs((walk + 180.0) % 360.0 - 180.0) < 120.0
    ]


def drift(errors: Errors) -> float:
    """How far the straight line through the errors of the log height rises from the flight's begin to its end."""
    ok = np.isfinite(errors.errors[:, 2])
    if ok.sum() < 0.5 * len(errors.tracks):
        return math.nan
    slope = float(np.polyfit(errors.t_s[ok], errors.errors[ok, 2], 1)[0])
    return slope * errors.case.duration_s


def consistency(results: Sequence[Errors]) -> Vector:
    """(3,) mean squared error over reported sigma of x, y and log height, each flight's mean taken away; 1 is ideal."""
    ratios = [(r.errors - np.nanmean(r.errors, axis=0)) / r.sigmas[:, [0, 0, 1]] for r in results]
    return np.asarray(np.nanmean(np.concatenate(ratios) ** 2, axis=0))


def correlation_s(results: Sequence[Errors]) -> Vector:
    """(3,) lag at which the mean autocorrelation of the errors of x, y and log height falls below 1/e, seconds."""
    lags = 40
    total = np.zeros((lags, 3))
    for r in results:
        if len(r.errors) < 2 * lags:
            continue
        e = np.nan_to_num((r.errors - np.nanmean(r.errors, axis=0)) / [r.height_px.mean(), r.height_px.mean(), 1.0])
        total += [(e[: len(e) - k] * e[k:]).mean(axis=0) for k in range(lags)]
    return np.asarray(np.argmax(total < total[0] / math.e, axis=0) / FPS)


def report(results: Sequence[Errors]) -> Table:
    """One row per flight."""
    table = Table("m", "walk", "tracked", "x px", "y px", "log height", "drift", "ms/frame", title="bias and std")
    for r in results:
        mean, std = np.nanmean(r.errors, axis=0), np.nanstd(r.errors, axis=0)
        table.add_row(
            f"{r.case.distance_m:g}",
            "stands" if r.case.walk_deg is None else f"{r.case.walk_deg:.0f}",
            f"{100 * len(r.errors) / len(r.tracks):.0f} %",
            f"{mean[0]:+.2f} {std[0]:.2f}",
            f"{mean[1]:+.2f} {std[1]:.2f}",
            f"{mean[2]:+.3f} {std[2]:.3f}",
            f"{drift(r):+.3f}",
            f"{r.frame_ms:.1f}",
        )
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly, track, and show the errors."""
    parser = argparse.ArgumentParser(prog="python -m sitl.track_accuracy", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seed", type=int, default=1, help="scenery, clothes, light and noise")
    parser.add_argument("--distances", type=float, nargs="*", default=list(DISTANCES_M), metavar="M")
    parser.add_argument("--size", choices=("640x480", "1280x720"), default="640x480")
    parser.add_argument("--no-roll", action="store_true", help="do not tell the tracker how the camera rolls")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    network, results = NanoDet(), []
    width, height = (int(v) for v in options.size.split("x"))
    console = Console()
    for case in cases(options.seed, (width, height), options.distances):
        moments = list(fly(case, samples=2))
        if options.no_roll:
            moments = [replace(m, roll_rad=0.0) for m in moments]
        results.append(follow(case, moments, network))
    console.print(report(results))
    x, y, size = consistency(results)
    console.print(f"squared error over reported variance: x {x:.2f}, y {y:.2f}, log height {size:.2f} (1 is ideal)")
    x, y, size = correlation_s(results)
    console.print(f"correlation time: x {x:.2f} s, y {y:.2f} s, log height {size:.2f} s")
    drifts = np.array([abs(drift(r)) for r in results])
    console.print(f"drift of log height: median {np.nanmedian(drifts):.3f}, 90 % {np.nanquantile(drifts, 0.9):.3f}")


if __name__ == "__main__":
    main()
