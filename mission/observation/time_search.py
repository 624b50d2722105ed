"""Where in a log a video belongs: the picture's rotation against the log's, over the whole flight, then to 10 ms.

First both rates of turn (three axes, 10 Hz) are correlated at every shift, normalised by what overlaps. Then the curves
around the best shift are matched as `mission.timing.time_offset` does it in flight, in the parts of the video that turn
most.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve
from scipy.spatial.transform import Rotation, Slerp

from mission.camera.camera import Camera
from mission.errors import LogError
from mission.logs.pose_log import Attitudes, PoseLog, usual_gap_s
from mission.observation.rotation_curve import TimedTurn
from mission.records import Matrix, Vector
from mission.timing.time_offset import TimeOffset, TimeOffsetMeter

STEP_S = 0.1
_LEAST_OVERLAP_S = 3.0
_LEAST_LIKENESS = 0.7
"""Of another flight's log the best of many shifts reaches 0.6 by chance."""
_ALIKE = 0.85
"""From which on the coarse shift is believed where the fine one cannot be told."""
_CLEARLY = 6.0
"""By how much more likely (log of the ratio) the best shift must be than any other."""
_INDEPENDENT_HZ = 1.0
"""Numbers a second that say something of their own, in the likelihood of a shift."""
_APART_S = 1.5
_AROUND_S = 0.3
_WINDOW_S = 20.0
_WINDOWS = 3
_SAME_CLOCK_S = 1.0
"""How far the time of a log that counts with the video may be off."""
_LEAST_RATE_RAD_S = math.radians(5.0)


@dataclass(frozen=True, slots=True)
class FoundTime:
    """How much later than the log's clock the video's runs: a frame of time t shows the pose at t - offset_s."""

    offset_s: float
    sigma_s: float
    likeness: float
    """Correlation of both rates of turn at the coarse shift, 0 to 1; NaN where it was not searched."""
    runner_up: float
    """The same at the next best shift."""
    measured: bool
    """Whether the movement told; else it is what the container or the log's own clock says."""
    gain: float
    """Turn seen in the picture over turn reported."""
    how: str
    """In a sentence, for people."""


@dataclass(frozen=True, slots=True, eq=False)
class Rates:
    """Rates of turn on a grid of times `start_s + STEP_S * k`."""

    start_s: float
    rate: Matrix
    """(n, 3) rad/s, camera axes; 0 where it is not known."""
    known: Vector
    """(n,) 1 or 0."""


def picture_rates(turns: Sequence[TimedTurn]) -> Rates:
    """Of the picture, each turn spread evenly over its time."""
    if not turns:
        return Rates(0.0, np.zeros((0, 3)), np.zeros(0))
    start = turns[0].from_s
    edges = np.array([(one.from_s, one.to_s) for one in turns])
    vectors = np.array([one.turn.rotation_vector for one in turns])
    count = math.ceil((edges[-1, 1] - start) / STEP_S) + 1
    rate = vectors / (edges[:, 1] - edges[:, 0])[:, None]
    middle = start + STEP_S * (np.arange(count) + 0.5)
    place = np.clip(np.searchsorted(edges[:, 1], middle), 0, len(edges) - 1)
    inside = (middle >= edges[place, 0] - 1e-6) & (middle <= edges[place, 1] + 1e-6)
    return Rates(start, np.where(inside[:, None], rate[place], 0.0), inside.astype(float))


def log_rates(pointing: Attitudes, camera: Camera) -> Rates:
    """Of the camera as the log tells it."""
    t_s = pointing.t_s
    edges = np.arange(t_s[0], t_s[-1] - 1e-9, STEP_S)
    if len(edges) < 3:
        return Rates(float(t_s[0]), np.zeros((0, 3)), np.zeros(0))
    body = Slerp(t_s, Rotation.from_quat(pointing.world_from_body_wxyz, scalar_first=True))(edges)
    lens = body * camera.mounting.body_from_camera
    rate = (lens[:-1].inv() * lens[1:]).as_rotvec() / STEP_S
    gap = usual_gap_s(t_s)
    after = np.clip(np.searchsorted(t_s, edges[:-1] + 0.5 * STEP_S), 1, len(t_s) - 1)
    known = (t_s[after] - t_s[after - 1]) <= gap
    return Rates(float(edges[0]), np.where(known[:, None], rate, 0.0), known.astype(float))


def correlation(picture: Rates, told: Rates) -> tuple[Vector, Vector, Vector]:
    """Offsets (m,), how alike both rates are there, and over how many seconds they overlap.

    An offset is video time less log time, as in `FoundTime`.
    """
    seen, logged = picture.rate, told.rate

    def shifted(one: Matrix, other: Matrix) -> Vector:
        """Sum over i of one[i] other[i + k] for every shift k, over the columns."""
        columns = [fftconvolve(other[:, axis], one[::-1, axis], mode="full") for axis in range(one.shape[1])]
        return np.asarray(np.sum(columns, axis=0))

    common = shifted(picture.known[:, None], told.known[:, None])
    both = shifted(seen, logged)
    power_seen = shifted(np.sum(seen**2, axis=1)[:, None], told.known[:, None])
    power_told = shifted(picture.known[:, None], np.sum(logged**2, axis=1)[:, None])
    whole = np.sqrt(np.maximum(power_seen, 1e-12) * np.maximum(power_told, 1e-12))
    # A quiet part of the log is like nothing: noise must not be normalised up to a likeness.
    floor = len(seen) * STEP_S * (0.02**2)
    alike = both / np.maximum(whole, floor / STEP_S)
    shift = np.arange(len(common)) - (len(seen) - 1)
    offset_s = picture.start_s - (told.start_s + STEP_S * shift)
    return np.asarray(offset_s, dtype=float), np.asarray(alike, dtype=float), np.asarray(common * STEP_S, dtype=float)


def find_time(
    turns: Sequence[TimedTurn], log: PoseLog, camera: Camera, guess_s: float | None, guess_sigma_s: float = 5.0
) -> FoundTime:
    """The offset between a video and a log.

    Args:
        turns: of the picture over the whole video.
        log: of the flight.
        camera: lens and mounting.
        guess_s: the offset that the container's time or the log's own clock suggests.
        guess_sigma_s: how exact that is; shifts that it makes unlikely are not looked at where the log's clock is the
            video's.

    Raises:
        LogError: neither the movement nor the guess tells.
    """
    pointing = log.pointing
    same_clock = log.clock == "video"
    if same_clock:
        guess_s, guess_sigma_s = 0.0, 0.05
    if pointing is None:
        if guess_s is None:
            raise LogError("the log tells no attitude to time the video by", "Give a log with the attitude.")
        return _guessed(guess_s, guess_sigma_s, "the log tells no attitude")
    picture, told = picture_rates(turns), log_rates(pointing, camera)
    if len(picture.known) < 5 or len(told.known) < 5:
        return _or_refused(guess_s, guess_sigma_s, "too little of the background could be followed", math.nan)
    offset_s, alike, overlap_s = correlation(picture, told)
    allowed = overlap_s >= max(_LEAST_OVERLAP_S, 0.5 * float(picture.known.sum()) * STEP_S)
    if same_clock:
        allowed &= np.abs(offset_s) <= _SAME_CLOCK_S
    if not allowed.any():
        return _or_refused(guess_s, guess_sigma_s, "the log does not cover the video", math.nan)
    score = np.where(allowed, alike, -np.inf)
    best = int(np.argmax(score))
    elsewhere = np.where(np.abs(offset_s - offset_s[best]) > _APART_S, score, -np.inf)
    runner_up = max(float(np.max(elsewhere)), 0.0)
    likeness = float(score[best])
    quick = np.linalg.norm(picture.rate, axis=1).max(initial=0.0) >= _LEAST_RATE_RAD_S
    if likeness < _LEAST_LIKENESS or not quick:
        return _or_refused(guess_s, guess_sigma_s, _why(quick=bool(quick), likeness=likeness), likeness)
    seconds = float(overlap_s[best])
    if _more_likely(likeness, runner_up, seconds) < _CLEARLY and not same_clock:
        near = None
        if guess_s is not None:
            near = _nearest_peak(offset_s, score, guess_s, 3.0 * guess_sigma_s, likeness, seconds)
        if near is None:
            raise LogError(
                f"the video fits at two places of the log equally well (correlation {likeness:.2f} and "
                f"{runner_up:.2f})",
                "Say where it begins (--offset), or give a log that ends with the video.",
            )
        best = near
    refined = refine(turns, log, camera, float(offset_s[best]))
    if refined is None and likeness < _ALIKE:
        return _or_refused(guess_s, guess_sigma_s, _why(quick=True, likeness=likeness), likeness)
    if refined is None:
        sigma = STEP_S / 2.0
        return FoundTime(
            float(offset_s[best]), sigma, likeness, runner_up, True, 1.0, "correlation of the turns only, to 0.05 s"
        )
    return FoundTime(
        refined.offset_s,
        refined.sigma_s,
        likeness,
        runner_up,
        True,
        refined.gain,
        f"the picture turns as the log says (correlation {likeness:.2f}, next best {runner_up:.2f})",
    )


def refine(turns: Sequence[TimedTurn], log: PoseLog, camera: Camera, about_s: float) -> TimeOffset | None:
    """The offset near a coarse one, from the parts of the video that turn most; None where none tells it."""
    pose_at = log.pose_at()
    found = []
    for first_s, last_s in busiest(turns):
        meter = TimeOffsetMeter(camera, _WINDOW_S + 1.0, (about_s - _AROUND_S, about_s + _AROUND_S))
        for one in turns:
            if first_s <= one.from_s and one.to_s <= last_s:
                meter.add_turn(one.from_s, one.to_s, one.turn)
        measured = meter.measure(pose_at)
        if measured is not None:
            found.append(measured)
    if not found:
        return None
    weight = np.array([one.sigma_s**-2 for one in found])
    offset_s = float(weight @ [one.offset_s for one in found] / weight.sum())
    spread = float(weight @ [(one.offset_s - offset_s) ** 2 for one in found] / weight.sum())
    best = min(found, key=lambda one: one.sigma_s)
    gain = float(weight @ [one.gain for one in found] / weight.sum())
    return TimeOffset(offset_s, math.sqrt(1.0 / weight.sum() + spread), best.turned_rad, gain)


def busiest(turns: Sequence[TimedTurn]) -> list[tuple[float, float]]:
    """Time spans of the video in which the rate of turn changes most, apart from each other."""
    spans = []
    end_s = turns[-1].to_s
    starts = np.arange(turns[0].from_s, max(end_s - _WINDOW_S, turns[0].from_s) + 1e-6, _WINDOW_S / 4.0)
    middle = np.array([0.5 * (one.from_s + one.to_s) for one in turns])
    rate = np.array([one.turn.rotation_vector / (one.to_s - one.from_s) for one in turns])
    for start in starts.tolist():
        inside = (middle >= start) & (middle <= start + _WINDOW_S)
        if np.count_nonzero(inside) > 10:
            changes = float(np.sum(np.var(rate[inside], axis=0)))
            spans.append((changes, start, start + _WINDOW_S))
    chosen: list[tuple[float, float]] = []
    for _, first_s, last_s in sorted(spans, reverse=True):
        if all(last_s <= other[0] or first_s >= other[1] for other in chosen):
            chosen.append((first_s, last_s))
    return chosen[:_WINDOWS]


def _more_likely(one: float, other: float, seconds: float) -> float:
    """Log of the likelihood ratio of two shifts with these correlations over a time: their residuals' variances."""
    left = [max(1.0 - min(max(r, 0.0), 0.999) ** 2, 1e-6) for r in (other, one)]
    return 0.5 * seconds * _INDEPENDENT_HZ * math.log(left[0] / left[1])


def _nearest_peak(
    offset_s: Vector, score: Vector, guess_s: float, within_s: float, likeness: float, seconds: float
) -> int | None:
    """The best shift near the guess, if it is about as good as the best of all."""
    near = np.where(np.abs(offset_s - guess_s) <= within_s, score, -np.inf)
    best = int(np.argmax(near))
    return best if _more_likely(likeness, float(near[best]), seconds) < _CLEARLY else None


def _why(*, quick: bool, likeness: float) -> str:
    if not quick:
        return f"the camera never turned faster than {math.degrees(_LEAST_RATE_RAD_S):.0f} deg/s"
    return f"the picture nowhere turns as the log says (correlation {likeness:.2f})"


def _or_refused(guess_s: float | None, sigma_s: float, why: str, likeness: float) -> FoundTime:
    if guess_s is None or sigma_s > 0.5:
        raise LogError(f"video and log cannot be put together: {why}", "Give the log of this flight, or --offset.")
    return _guessed(guess_s, sigma_s, why, likeness)


def _guessed(offset_s: float, sigma_s: float, why: str, likeness: float = math.nan) -> FoundTime:
    return FoundTime(offset_s, sigma_s, likeness, math.nan, False, 1.0, f"as the files say, not measured: {why}")
