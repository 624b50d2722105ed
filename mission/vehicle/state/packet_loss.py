"""How much of what the autopilot sends is lost on the way, from the gaps in its packets' sequence numbers."""

from __future__ import annotations

import math
import threading
from collections import deque

from pymavlink.dialects.v20 import all as mavlink

_WINDOW_S = 4.0
_BUCKET_S = 0.25
_ENOUGH = 100
"""Fewer packets than this in the window say nothing."""
_LATE = 128
"""A step back in the sequence, modulo 256: the packet was overtaken, not lost."""


def overtaken(sequence: int, newest: int) -> bool:
    """Whether a packet was sent before the newest one that has come, by MAVLink's one-byte sequence numbers."""
    return (sequence - newest) % 256 >= _LATE


class PacketLoss:
    """MAVLink's one-byte sequence number, counted over the last four seconds. Safe to use from two threads.

    A router that filters messages on the way looks like loss, too.

    Args:
        component: of the sender whose packets are counted; its system is given with each packet.
    """

    def __init__(self, component: int = mavlink.MAV_COMP_ID_AUTOPILOT1) -> None:
        self._component = component
        self._last: int | None = None
        self.missing_s = -math.inf
        """When a packet was last found missing."""
        self._buckets: deque[tuple[float, int, int]] = deque()
        self._lock = threading.Lock()

    def observe(self, frame: bytes, system: int, now_s: float) -> None:
        """Take in a whole MAVLink 1 or 2 frame; those of other senders are passed over."""
        at = 4 if frame[0] == mavlink.PROTOCOL_MARKER_V2 else 2
        sequence, source, component = frame[at : at + 3]
        if component != self._component or source != system:
            return
        step = 1 if self._last is None else (sequence - self._last) % 256
        if step == 0:
            return
        late = self._last is not None and overtaken(sequence, self._last)
        if step > 1:
            self.missing_s = now_s
        if not late:
            self._last = sequence
        with self._lock:
            self._count(now_s, 0 if late else step)

    def fraction(self, now_s: float) -> float | None:
        """Lost packets of all that were sent, 0 to 1; None when too few came to tell."""
        with self._lock:
            while self._buckets and now_s - self._buckets[0][0] > _WINDOW_S:
                self._buckets.popleft()
            sent = sum(bucket[1] for bucket in self._buckets)
            came = sum(bucket[2] for bucket in self._buckets)
        return None if came < _ENOUGH else max(0.0, 1.0 - came / max(sent, 1))

    def _count(self, now_s: float, sent: int) -> None:
        if self._buckets and now_s - self._buckets[-1][0] < _BUCKET_S:
            began, before, came = self._buckets[-1]
            self._buckets[-1] = (began, before + sent, came + 1)
        else:
            self._buckets.append((now_s, sent, 1))
            if len(self._buckets) > 2 * _WINDOW_S / _BUCKET_S:
                self._buckets.popleft()
