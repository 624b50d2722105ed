"""Maps a remote clock (autopilot boot time, video presentation time) to the program's monotonic clock."""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass

_BUCKET_S = 1.0
"""Within a bucket only the least delayed message (after drift) is kept: it says most about the clock."""
_STEP_S = 0.25
_STEP_BUCKETS = 3
"""When this many buckets in a row stay this far above the line, the remote clock has stopped or stepped: start anew."""
_MIN_SPAN_S = 4.0
"""A drift fitted over less than this would be network jitter."""


@dataclass(slots=True)
class _Bucket:
    index: int
    remote_s: float
    offset_s: float


class ClockMap:
    """Where a remote clock stands against ours, from messages that arrive with a varying, never negative delay.

    The offset (arrival minus remote time) of a message is the true offset plus its delay. The map is the line
    ``offset = a + b * remote`` that lies below all observed offsets of the last `window_s` and closest to them (the
    edge of their lower convex hull below their mean: Zhang, Liu, Xia, "Clock synchronization algorithms for network
    measurements", INFOCOM 2002), so that queueing delay does not move it and a slow drift does not either. What
    remains is the least delay of the link, which cannot be seen from one side.

    The drift `b` is limited to `max_drift`. Real crystals stay below 1e-4; a software-in-the-loop autopilot on a busy
    machine runs up to 2 % slow.

    Args:
        window_s: how much of the past decides; longer rides out longer congestion, shorter follows a changing drift.
        max_drift: largest rate difference that is believed, seconds per second.
        restart_s: a remote time that steps back by more than this means that the remote clock was restarted.
    """

    def __init__(self, window_s: float = 20.0, max_drift: float = 0.03, restart_s: float = 1.0) -> None:
        self._window_s = window_s
        self._max_drift = max_drift
        self._restart_s = restart_s
        self._buckets: deque[_Bucket] = deque(maxlen=max(2, round(window_s / _BUCKET_S)))
        self._newest_remote_s = 0.0
        self._anchor_s = 0.0
        self._offset_s = 0.0
        self._drift = 0.0

    @property
    def ready(self) -> bool:
        """Whether anything was observed yet; `to_local` needs it."""
        return bool(self._buckets)

    def observe(self, remote_s: float, arrived_s: float) -> None:
        """Take in one message: its remote time and the program time at which it arrived, both seconds."""
        offset = arrived_s - remote_s
        if self._buckets and remote_s < self._newest_remote_s - self._restart_s:
            self._buckets.clear()
        index = int(arrived_s // _BUCKET_S)
        if not self._buckets:
            self._newest_remote_s = remote_s
            self._buckets.append(_Bucket(index, remote_s, offset))
            self._fit()
            return
        self._newest_remote_s = max(self._newest_remote_s, remote_s)
        last = self._buckets[-1]
        if index > last.index:
            self._buckets.append(_Bucket(index, remote_s, offset))
            self._drop_old()
            self._fit()
        elif offset < last.offset_s + self._drift * (remote_s - last.remote_s):
            last.remote_s, last.offset_s = remote_s, offset
            self._fit()

    def to_local(self, remote_s: float) -> float:
        """Program time of a remote time, seconds.

        Raises:
            ValueError: nothing was observed yet.
        """
        if not self._buckets:
            raise ValueError("no message of the remote clock was observed yet")
        return remote_s + self._offset_s + self._drift * (remote_s - self._anchor_s)

    def to_remote(self, local_s: float) -> float:
        """Remote time of a program time, seconds: the inverse of `to_local`.

        Raises:
            ValueError: nothing was observed yet.
        """
        if not self._buckets:
            raise ValueError("no message of the remote clock was observed yet")
        return (local_s - self._offset_s + self._drift * self._anchor_s) / (1.0 + self._drift)

    @property
    def line(self) -> tuple[float, float, float]:
        """Offset, drift, and the remote time at which the offset holds: all that `to_local` and `to_remote` use."""
        return self._offset_s, self._drift, self._anchor_s

    @classmethod
    def on_line(cls, line: tuple[float, float, float]) -> ClockMap:
        """A map with such a line, as it was known at one moment."""
        made = cls()
        made._offset_s, made._drift, made._anchor_s = line
        made._buckets.append(_Bucket(0, line[2], line[0]))
        return made

    def _drop_old(self) -> None:
        newest = self._buckets[-1].index
        while newest - self._buckets[0].index > self._window_s / _BUCKET_S:
            self._buckets.popleft()
        # The newest bucket has just begun: its least delay is not known yet.
        recent = list(self._buckets)[-1 - _STEP_BUCKETS : -1]
        if len(recent) == _STEP_BUCKETS and all(
            b.offset_s - self._offset_s - self._drift * (b.remote_s - self._anchor_s) > _STEP_S for b in recent
        ):
            while self._buckets[0] is not recent[0]:
                self._buckets.popleft()

    def _fit(self) -> None:
        points = [(b.remote_s, b.offset_s) for b in self._buckets]
        if points[-1][0] - points[0][0] < _MIN_SPAN_S:
            self._drift = 0.0
        else:
            self._drift = max(-self._max_drift, min(self._max_drift, _slope_below(points)))
        self._anchor_s = points[-1][0]
        self._offset_s = min(offset - self._drift * (remote - self._anchor_s) for remote, offset in points)


def _slope_below(points: list[tuple[float, float]]) -> float:
    """Slope of the line below all points with the least sum of distances: the hull edge below their mean."""
    hull: list[tuple[float, float]] = []
    for x, y in sorted(points):
        if hull and x == hull[-1][0]:
            continue
        while len(hull) >= 2 and (hull[-1][1] - hull[-2][1]) * (x - hull[-2][0]) >= (y - hull[-2][1]) * (
            hull[-1][0] - hull[-2][0]
        ):
            hull.pop()
        hull.append((x, y))
    if len(hull) < 2:
        return 0.0
    mean = sum(x for x, _ in points) / len(points)
    for (x0, y0), (x1, y1) in itertools.pairwise(hull):
        if x1 >= mean:
            return (y1 - y0) / (x1 - x0)
    (x0, y0), (x1, y1) = hull[-2:]
    return (y1 - y0) / (x1 - x0)
