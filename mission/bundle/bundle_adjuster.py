"""Steadies the camera's poses of one sidestep by the background: points in flight, bundle adjustment after it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from mission.bundle.adjustment import AdjustedBundle, adjust
from mission.bundle.epipolar_gate import keeps_to_epipolar_lines
from mission.bundle.gauge_alignment import Similarity, most_likely_gauge
from mission.bundle.point_tracks import PointTracker
from mission.bundle.pose_covariance import LEAST_STILL, adjusted_noise
from mission.bundle.projection import Cameras, Rows
from mission.bundle.resection import LEAST_POINTS, Resection, resect
from mission.bundle.rotations import rotation_logarithm
from mission.bundle.solution import (
    AdjustedPose,
    AttitudeCurves,
    BundleSolution,
    PointTrails,
    not_adjusted,
)
from mission.bundle.telemetry_prior import ErrorLevels, TelemetryPrior
from mission.camera.camera import Camera
from mission.camera.model import CameraModel
from mission.pose.buffer import Pose
from mission.records import Box, Frame, Matrix, NoiseModel, Vector

_KEY_FRAMES = 30
_KEY_EVERY_S = 0.2
"""Between key frames at least: a point errs the same way in pictures that are nearer. On rendered flights of which only
1.8 s were kept, 30 key frames made headings worse than 10 (0.14 against 0.11 deg rms) and promised more."""
_MOST_POINTS = 1000
_MOST_A_FRAME = 200
"""Points that fix a frame, at most."""
_LEAST_ROWS = 3
"""Key frames in which a point must have been seen."""
_LEAST_FRAMES = 8
_LEAST_SHARE = 0.8
"""Of the key frames that must show enough points."""
_POINT_SIGMA_PX = 0.05
_START_PX = 20.0
"""How far off points may be at first: a heading that wanders by two degrees."""
_EPIPOLAR_PX = 1.0
"""Between a still point and its epipolar line; 0.6 threw out too much (headings became worse), 1.5 does as well."""
_WORST_PX = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    bundle: AdjustedBundle
    similarity: Similarity
    resection: Resection


class BundleAdjuster:
    """One sidestep's background.

    Args:
        camera: lens, mounting and rolling shutter.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._tracker = PointTracker(camera.intrinsics)
        self._lens = CameraModel(camera.intrinsics)
        self._seen: list[tuple[Matrix, Matrix]] = []
        self._people: set[int] = set()

    def add(self, frame: Frame, left_out: Sequence[Box] = (), roll_rad: float = 0.0) -> None:
        """Follow the background into the next frame; 2 to 4 ms at 640 x 480.

        Args:
            frame: BGR picture.
            left_out: boxes around people.
            roll_rad: the camera's roll about its optical axis, to a few degrees.
        """
        before = len(self._tracker.frames)
        self._tracker.add(frame, left_out, roll_rad)
        for taken in self._tracker.frames[before:]:
            pixel = self._tracker.pixels(taken, taken.point)
            self._seen.append((pixel, self._lens.ray(pixel)))

    def leave_out(self, t_s: float, boxes: Sequence[Box]) -> None:
        """Forget the points that were in boxes around people at one frame, in all frames.

        Args:
            t_s: the frame's time as the video tells it.
            boxes: pixels.
        """
        for number, frame in enumerate(self._tracker.frames):
            if frame.t_s != t_s:
                continue
            pixel = self._seen[number][0]
            for box in boxes:
                inside = (pixel > [box.left_px, box.top_px]) & (pixel < [box.right_px, box.bottom_px])
                self._people.update(frame.track[inside.all(axis=1)].tolist())

    def solve(self, pose_at: Callable[[float], Pose | None], offset_s: float, noise: NoiseModel) -> BundleSolution:
        """The steadied poses of all frames.

        Args:
            pose_at: the aircraft's pose at a telemetry time.
            offset_s: how much later than telemetry the video's clock runs.
            noise: what the aircraft states of its pose's errors.
        """
        times = np.array([frame.t_s for frame in self._tracker.frames])
        reports, known = TelemetryPrior.collect(pose_at, self._camera, times - offset_s)
        if len(known) < _LEAST_FRAMES:
            return not_adjusted(noise, "too few frames with telemetry")
        keys = _key_frames(times[known])
        rows, tracks = self._rows(known[keys])
        trails = self._trails(known[keys], tracks)
        if len(rows.frame) == 0:
            return not_adjusted(noise, "no points of the background could be followed", trails)
        shown = np.bincount(rows.frame, minlength=len(keys)) >= LEAST_POINTS
        if shown.mean() < _LEAST_SHARE:
            return not_adjusted(
                noise,
                f"only {100.0 * shown.mean():.0f} % of the pictures show enough texture that can be followed",
                trails,
            )
        keeps = keeps_to_epipolar_lines(rows, times[known[keys]], _EPIPOLAR_PX / self._camera.intrinsics.fx)
        share = float(keeps[rows.point].mean())
        if share < LEAST_STILL:
            return not_adjusted(noise, _moving(share), trails, share)
        try:
            solved = self._solved(reports, keys, known, rows, keeps, tracks, noise)
        except (LinAlgError, np.linalg.LinAlgError):
            return not_adjusted(noise, "the background's points do not determine the camera's path", trails)
        refused = self._refused(solved)
        if refused is not None:
            return not_adjusted(noise, refused, trails, solved.bundle.still_share)
        return self._result(reports, times[known], solved, noise, _told_apart(trails, tracks, solved.bundle.still))

    def _solved(
        self,
        reports: TelemetryPrior,
        keys: NDArray[np.intp],
        known: NDArray[np.intp],
        rows: Rows,
        keeps: NDArray[np.bool_],
        tracks: NDArray[np.intp],
        noise: NoiseModel,
    ) -> _Solved:
        key_reports = reports.only(keys)
        levels = ErrorLevels.stated(noise)
        focal = self._camera.intrinsics.fx
        kept = keeps[rows.point]
        bundle = adjust(
            key_reports.cameras,
            rows.only(kept),
            key_reports.prior(levels),
            _POINT_SIGMA_PX / focal,
            _START_PX / focal,
        )
        bundle = replace(bundle, still_share=float(kept.mean()) * bundle.still_share)
        turn = bundle.cameras.rotation @ np.swapaxes(key_reports.cameras.rotation, 1, 2)
        levels = key_reports.fitted(levels, bundle.cameras, turn)
        similarity = most_likely_gauge(
            bundle.cameras.position_m, key_reports.cameras.position_m, turn, key_reports.prior(levels)
        )
        bundle = bundle.moved(similarity)
        turn = similarity.turn @ turn
        place = bundle.cameras.position_m - key_reports.cameras.position_m
        every, _ = self._rows(known, tracks)
        every = every.only(every.point < len(bundle.still))
        every = every.only(keeps[every.point])
        every = every.only(_longest_seen(every, len(bundle.still), _MOST_A_FRAME))
        return _Solved(bundle, similarity, resect(reports.cameras, bundle, turn, place, every))

    def _rows(self, frames: NDArray[np.intp], tracks: NDArray[np.intp] | None = None) -> tuple[Rows, NDArray[np.intp]]:
        """Where points were seen in some frames, and the tracks that they are numbered by.

        Args:
            frames: which frames.
            tracks: which tracks; those that were seen longest when not given.
        """
        taken = [self._tracker.frames[number] for number in frames]
        frame = np.concatenate([np.full(len(f.track), place) for place, f in enumerate(taken)])
        track = np.concatenate([f.track for f in taken])
        pixel, ray = (np.concatenate(parts) for parts in zip(*(self._seen[number] for number in frames), strict=True))
        if tracks is None:
            seen = np.bincount(track)
            seen[[number for number in self._people if number < len(seen)]] = 0
            good = np.flatnonzero(seen >= _LEAST_ROWS)
            tracks = np.sort(good[np.argsort(-seen[good], kind="stable")][:_MOST_POINTS])
        place = np.full(int(track.max(initial=0)) + 1, -1)
        place[tracks] = np.arange(len(tracks))
        kept = (place[track] >= 0) & np.isfinite(ray).all(axis=1) & (ray[:, 2] > 0.1)
        ray, pixel = ray[kept], pixel[kept]
        delay_s = (pixel[:, 1] / self._camera.intrinsics.height_px - 0.5) * self._camera.readout_s
        return Rows(frame[kept].astype(np.intp), place[track[kept]], ray[:, :2] / ray[:, 2:], delay_s), tracks

    def _refused(self, solved: _Solved) -> str | None:
        """Why the result is not to be believed, or None."""
        bundle = solved.bundle
        if not np.isfinite(solved.resection.cameras.position_m).all():
            return "the background's points do not determine the camera's path"
        if bundle.still_share < LEAST_STILL:
            return _moving(bundle.still_share)
        residual_px = bundle.scale * self._camera.intrinsics.fx
        if residual_px > _WORST_PX:
            return f"the points do not fit together (off by {residual_px:.1f} px)"
        if np.mean(solved.resection.points >= LEAST_POINTS) < _LEAST_SHARE:
            return "too few pictures show enough of a background that stands still"
        return None

    def _trails(self, frames: NDArray[np.intp], tracks: NDArray[np.intp]) -> PointTrails:
        """Where the points of some tracks were in some frames, all of them taken for still."""
        t_s, track, pixel = [], [], []
        for number in frames:
            frame = self._tracker.frames[number]
            kept = np.isin(frame.track, tracks)
            t_s.append(np.full(int(kept.sum()), frame.t_s))
            track.append(frame.track[kept])
            pixel.append(self._seen[number][0][kept])
        numbers = np.concatenate(track).astype(np.intp)
        return PointTrails(np.concatenate(t_s), numbers, np.concatenate(pixel), np.ones(len(numbers), dtype=bool))

    def _result(
        self,
        reports: TelemetryPrior,
        times_s: NDArray[np.float64],
        solved: _Solved,
        noise: NoiseModel,
        trails: PointTrails,
    ) -> BundleSolution:
        cameras, points = solved.resection.cameras, solved.resection.points
        poses = tuple(
            AdjustedPose(
                float(times_s[i]),
                cameras.position_m[i],
                cameras.rotation[i],
                cameras.velocity_m_s[i],
                cameras.turn_rate[i],
                "steadied" if points[i] >= LEAST_POINTS else "attitude",
                int(points[i]),
            )
            for i in range(len(times_s))
        )
        curves = AttitudeCurves(times_s, angles(reports.cameras), angles(cameras), points)
        residual_px = solved.bundle.scale * self._camera.intrinsics.fx
        achieved = adjusted_noise(solved.bundle, solved.similarity, noise)
        # A turn about up that is positive in front of the reported attitude makes it look further to the west.
        told = cameras.rotation @ np.swapaxes(reports.cameras.rotation, 1, 2)
        off_rad = float(np.median(rotation_logarithm(told)[:, 2]))
        sigma_rad = math.sqrt(float(solved.similarity.covariance[3, 3]))
        still = solved.bundle.still_share
        return BundleSolution(poses, achieved, curves, trails, residual_px, still, None, off_rad, sigma_rad)


def _told_apart(trails: PointTrails, tracks: NDArray[np.intp], still: NDArray[np.bool_]) -> PointTrails:
    """The trails with what is known of the points by now; tracks that no point came of move."""
    place = np.searchsorted(tracks, trails.track)
    return replace(trails, still=np.append(still, np.zeros(len(tracks) - len(still), dtype=bool))[place])


def _moving(still_share: float) -> str:
    return f"only {100.0 * still_share:.0f} % of the points agree with a background that stands still"


def _key_frames(t_s: Vector) -> NDArray[np.intp]:
    """Which of the frames at these times (k,) the bundle is made of: evenly spread, and not too near to each other."""
    apart = max(_LEAST_FRAMES, int((t_s[-1] - t_s[0]) / _KEY_EVERY_S) + 1)
    number = min(len(t_s), _KEY_FRAMES, apart)
    return np.unique(np.linspace(0, len(t_s) - 1, number).round().astype(np.intp))


def _longest_seen(rows: Rows, points: int, most: int) -> NDArray[np.bool_]:
    """By row, whether it is used: of each frame at most so many, of the first `points` points, those seen longest."""
    number = np.bincount(rows.point)
    order = np.lexsort((-number[rows.point], rows.point >= points, rows.frame))
    begin = np.searchsorted(rows.frame[order], rows.frame[order])
    used = np.zeros(len(order), dtype=bool)
    used[order] = np.arange(len(order)) - begin < most
    return used & (rows.point < points)


def angles(cameras: Cameras) -> Matrix:
    """(k, 3): heading of the optical axis, its elevation, roll about it; radians, the heading without jumps."""
    ahead, right, down = cameras.rotation[:, :, 2], cameras.rotation[:, :, 0], cameras.rotation[:, :, 1]
    heading = np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 1]))
    elevation = np.arcsin(np.clip(ahead[:, 2], -1.0, 1.0))
    return np.stack([heading, elevation, np.arctan2(-right[:, 2], -down[:, 2])], axis=1)
