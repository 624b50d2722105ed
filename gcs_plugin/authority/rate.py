"""Limits on how often something may happen: the token bucket."""

from __future__ import annotations


class TokenBucket:
    """Holds up to `burst` tokens and gains `rate_hz` of them a second; each event takes one.

    Args:
        rate_hz: events a second that may go on for ever.
        burst: events that may come at once.
    """

    def __init__(self, rate_hz: float, burst: float) -> None:
        self._rate_hz = rate_hz
        self._burst = burst
        self._tokens = burst
        self._at_s: float | None = None

    def take(self, now_s: float) -> bool:
        """Whether an event may happen now; if so it is counted."""
        if self._at_s is not None:
            self._tokens = min(self._burst, self._tokens + max(0.0, now_s - self._at_s) * self._rate_hz)
        self._at_s = now_s
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True
