"""How well somebody was followed through a video: with annotations, and what shows without any."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission.records import Box, Vector
from mission.track import Track
from sitl.real_video.annotations import Annotations, Walker, apart

_ON = 0.3
"""Distance from a person's middle, in their heights, at which a box is on them."""
_LIKE_SIZE = 0.7
_SPEED = 1.4
"""Body heights per second that nobody is faster than in a walk (2.4 m/s)."""
_STEP = 0.25
"""And body heights that the middle of a box may be astray."""
_GROWTH = 0.25
"""Change of the logarithm of the height from one frame to the next that no person makes."""
_WINDOW = 9
"""Frames over which a walk is a parabola."""


@dataclass(frozen=True, slots=True)
class Followed:
    """Frames of one person's walk, by what was shown in them."""

    name: str
    known: int
    """In which it is known where the person is."""
    right: int
    wrong: int
    """Shown as tracking on somebody else, in all frames."""
    nowhere: int
    """Shown as tracking where nobody is."""
    coasting: int
    lost: int
    switches: int
    """How often somebody else began to be shown."""


@dataclass(frozen=True, slots=True)
class Steadiness:
    """What a track says of itself, without any annotations."""

    frames: int
    held: float
    """Share of the frames in which the target was shown as tracking."""
    fragments: int
    """How often it went out of sight."""
    jumps: int
    """Steps in place or size that no person makes."""
    scatter: float
    """Sideways, over what is stated, about parabolas of 1.3 s; NaN where it was never followed for so long."""
    size_scatter: float
    """The same of the logarithm of the height."""


def followed(walker: Walker, tracks: Sequence[Track], known: Annotations) -> Followed:
    """Hold tracks to the annotations."""
    counts = dict.fromkeys(("known", "right", "wrong", "nowhere", "coasting", "lost"), 0)
    switches, before = 0, ""
    for track in tracks:
        own = walker.boxes.get(track.frame_index)
        verdict = _verdict(track, own, known.others(walker, track.frame_index))
        counts["known"] += own is not None
        if verdict == "wrong" or (own is not None and verdict != ""):
            counts[verdict] += 1
        switches += verdict == "wrong" and before != "wrong"
        before = verdict if verdict in ("right", "wrong") else before
    return Followed(walker.name, **counts, switches=switches)


def _verdict(track: Track, own: Box | None, others: Sequence[Box]) -> str:
    if track.state != "tracking":
        return str(track.state)
    near = [b for b in others if apart(track.box, b) < _ON and _like_size(track.box, b)]
    on = own is not None and (apart(track.box, own) < _ON or track.box.overlap(own) > 0.5)
    if on and own is not None and near:
        on = apart(track.box, own) < min(apart(track.box, b) for b in near) + 0.05
    if on:
        return "right"
    if near:
        return "wrong"
    return "nowhere" if own is not None else ""


def _like_size(one: Box, other: Box) -> bool:
    return abs(math.log(one.height_px / other.height_px)) < _LIKE_SIZE


def steadiness(tracks: Sequence[Track]) -> Steadiness:
    """What tracks of successive frames say of themselves."""
    fragments = jumps = 0
    last: Track | None = None
    runs: list[list[Track]] = [[]]
    for track in tracks:
        if track.state != "tracking":
            fragments += bool(runs[-1])
            if runs[-1]:
                runs.append([])
            continue
        if last is not None and _jumped(last, track):
            jumps += 1
        runs[-1].append(track)
        last = track
    places, sizes = [], []
    for run in runs:
        times = np.array([t.t_s for t in run])
        sigmas = np.array([t.pixel_sigma_px for t in run])
        places += _scatter(times, np.array([t.pixel[0] for t in run]), sigmas)
        heights = np.array([math.nan if t.height_px is None else math.log(t.height_px) for t in run])
        size_sigmas = np.array([math.nan if t.size_sigma is None else t.size_sigma for t in run])
        sizes += _scatter(times, heights, size_sigmas)
    held = sum(t.state == "tracking" for t in tracks) / max(1, len(tracks))
    return Steadiness(len(tracks), held, fragments, jumps, _rms(places), _rms(sizes))


def _jumped(last: Track, now: Track) -> bool:
    passed_s = now.t_s - last.t_s
    grown = abs(math.log(now.box.height_px / last.box.height_px))
    return apart(now.box, last.box) > _STEP + _SPEED * passed_s or grown > _GROWTH * max(1.0, passed_s)


def _scatter(times: Vector, values: Vector, sigmas: Vector) -> list[float]:
    """Mean squares about parabolas through windows that overlap by half."""
    answer = []
    for first in range(0, len(times) - _WINDOW + 1, _WINDOW // 2):
        part = slice(first, first + _WINDOW)
        powers = np.vander(times[part] - times[part].mean(), 3)
        if np.isfinite(values[part]).all():
            left = values[part] - powers @ np.linalg.lstsq(powers, values[part], rcond=None)[0]
            left = left / sigmas[part]
            answer.append(float(left @ left) / (_WINDOW - 3))
    return answer


def _rms(squares: Sequence[float]) -> float:
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan
