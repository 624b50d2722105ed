"""Presentation times of a video, mapped to the program's clock."""

from __future__ import annotations

from collections import OrderedDict
from typing import Protocol

from mission.clock import ClockMap
from mission.video.frame_counter import FrameCounter

_WRAP_S = 2.0**33 / 90000.0
"""MPEG-TS counts 33 bits of 90 kHz: it starts anew after 26.5 hours (ISO 13818-1, 2.4.3.7)."""
_JUMP_S = 1.0
"""Presentation time that runs ahead of, or back from, the arrivals by more than this was set anew by the sender."""
_MAX_DRIFT = 0.005
_SETTLED_FRAMES = 4
_SETTLED_S = 0.005
_SETTLE_S = 1.0
_COUNTED_DRIFT = 0.02
"""Stamps whose clock runs this much faster or slower than ours count frames at a rate that the camera does not deliver:
no clock is so bad."""
_DOUBT_SPAN_S, _DOUBT_DRIFT = 1.5, 0.06
"""After this long such a drift is more than jitter of the arrivals; it is known well after some seconds more."""
_KNOWN_SPAN_S = 5.0
_STANDING_FRAMES = 5
"""Stamps that have not moved for so many frames from the start are none."""


class Timeline(Protocol):
    """Gives each frame its time."""

    @property
    def settled(self) -> bool:
        """Whether the times can be relied on yet."""
        ...

    @property
    def note(self) -> str:
        """What is wrong with the stream's times; empty where nothing is."""
        ...

    def time_of(self, pts_s: float | None, arrived_s: float) -> float:
        """Program time of the frame presented at `pts_s` whose packet arrived at the program time `arrived_s`."""
        ...


class LiveTimeline:
    """A live stream: the offset of the sender's clock is learnt from the least delayed frames (`ClockMap`).

    Stamps are checked against the arrivals. Some cameras count frames at their nominal rate and deliver another: then
    the rate is learnt with the offset. Stamps that step back go on where they were.

    What is left is the delay that every frame has (exposure, encoder, network, demuxer); it is `latency_s`, measured
    by `sidestep calibrate latency`, and subtracted here.

    Args:
        latency_s: from the middle of the exposure to the arrival of the least delayed frames.
    """

    def __init__(self, latency_s: float = 0.0) -> None:
        self._latency_s = latency_s
        self._first: tuple[float, float] | None = None
        self._last: tuple[float, float] | None = None
        self._since: tuple[float, float] | None = None
        self._start_anew()
        self._wrapped_s = 0.0
        self._interval_s = 0.0
        self._standing = 0
        self._untimed_s = 0.0
        self._untimed_since_s: float | None = None

    @property
    def settled(self) -> bool:
        """Whether no better offset turned up for some frames (or too long): a stream begins with what had piled up."""
        if self._untimed_since_s is not None:
            return self._untimed_s - self._untimed_since_s > _SETTLE_S
        if self._last is None or self._since is None or self._doubtful():
            return False
        return self._steady >= _SETTLED_FRAMES or self._last[1] - self._since[0] > _SETTLE_S

    def time_of(self, pts_s: float | None, arrived_s: float) -> float:
        """Program time of a frame; a stream without presentation times counts from each frame's arrival."""
        if pts_s is None or self._standing > _STANDING_FRAMES:
            # RTP has no time before the second packet, and then it is not needed; raw H.264 never has one.
            self._untimed_s = arrived_s
            self._untimed_since_s = arrived_s if self._untimed_since_s is None else self._untimed_since_s
            return arrived_s - self._latency_s
        self._untimed_since_s = None
        remote_s = pts_s + self._wrapped_s
        if self._last is not None:
            last_remote_s, last_arrived_s = self._last
            step_s = remote_s - last_remote_s
            if abs(step_s + _WRAP_S) < _JUMP_S:
                self._wrapped_s += _WRAP_S
                remote_s += _WRAP_S
            elif step_s < -_JUMP_S or step_s > arrived_s - last_arrived_s + _JUMP_S:
                self._start_anew()
            elif step_s <= 0.0 and self._interval_s == 0.0:
                self._standing += 1
            elif step_s <= 0.0:  # frames come in the order of their presentation: the sender has set its clock back
                self._wrapped_s += self._interval_s - step_s
                remote_s += self._interval_s - step_s
                self._setbacks += 1
            else:
                self._interval_s = step_s if self._interval_s == 0.0 else 0.9 * self._interval_s + 0.1 * step_s
        self._last = remote_s, arrived_s
        self._first = self._first or self._last
        self._clock.observe(remote_s, arrived_s)
        self._counter.observe(remote_s, arrived_s)
        t_s = (self._counter if self._counts() else self._clock).to_local(remote_s)
        self._settle(t_s - remote_s, arrived_s)
        return t_s - self._latency_s

    @property
    def note(self) -> str:
        """What is wrong with the stamps; empty where nothing is."""
        if self._counted and self._counter.rate is not None:
            return f"the video's stamps run at {self._counter.rate:.2f} of real time: frames are timed by their arrival"
        if self._standing > _STANDING_FRAMES:
            return "the video's stamps stand still: frames are timed by their arrival"
        if self._setbacks:
            return f"the video's stamps were set back {self._setbacks} times: frames are timed by their order"
        return ""

    def _start_anew(self) -> None:
        self._clock, self._counter = ClockMap(max_drift=_MAX_DRIFT), FrameCounter()
        self._first = self._since = None
        self._steady = self._setbacks = 0
        self._counted = False

    def _counts(self) -> bool:
        """Whether the stamps count frames rather than time."""
        rate = self._counter.rate
        if rate is not None:
            self._counted = self._counted or abs(rate - 1.0) > _COUNTED_DRIFT
        return self._counted and rate is not None

    def _doubtful(self) -> bool:
        """Whether the stamps seem to run at another rate, which is not known well enough yet."""
        if self._first is None or self._last is None or self._counted:
            return False
        span_s = self._last[1] - self._first[1]
        if not _DOUBT_SPAN_S < span_s <= _KNOWN_SPAN_S:
            return False
        return abs((self._last[0] - self._first[0]) / span_s - 1.0) > _DOUBT_DRIFT

    def _settle(self, offset_s: float, arrived_s: float) -> None:
        if self._since is None:
            self._since, self._steady = (arrived_s, offset_s), 0
        elif offset_s < self._since[1] - _SETTLED_S:
            self._since, self._steady = (self._since[0], offset_s), 0
        else:
            self._steady += 1


class RecordedTimeline:
    """A file: its first frame is at `start_s`, the others follow by their presentation times.

    Args:
        start_s: program time of the first frame.
        frame_s: what a frame lasts where the file does not say, or says nonsense.
    """

    def __init__(self, start_s: float, frame_s: float) -> None:
        self._next_s = start_s
        self._frame_s = frame_s
        self._offset_s: float | None = None

    @property
    def settled(self) -> bool:
        """A file's times are what they are."""
        return True

    @property
    def note(self) -> str:
        """Nothing."""
        return ""

    def time_of(self, pts_s: float | None, arrived_s: float) -> float:
        """Program time of a frame; the arrival does not matter."""
        del arrived_s
        t_s = self._next_s
        if pts_s is not None:
            if self._offset_s is not None and abs(pts_s + self._offset_s - self._next_s) < _JUMP_S:
                t_s = pts_s + self._offset_s
            self._offset_s = t_s - pts_s
        self._next_s = t_s + self._frame_s
        return t_s


class Arrivals:
    """When the last packets arrived: with B-frames a frame comes out later than its packet came in."""

    _KEPT = 64

    def __init__(self) -> None:
        self._arrived: OrderedDict[float, float] = OrderedDict()

    def note(self, pts_s: float, arrived_s: float) -> None:
        """Take in a packet."""
        self._arrived[pts_s] = arrived_s
        while len(self._arrived) > self._KEPT:
            self._arrived.popitem(last=False)

    def of(self, pts_s: float | None, otherwise_s: float) -> float:
        """When the packet of this frame arrived."""
        return otherwise_s if pts_s is None else self._arrived.get(pts_s, otherwise_s)
