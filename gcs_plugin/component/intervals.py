"""SET_MESSAGE_INTERVAL for the messages that the component sends regularly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

LEAST_US: Final = 50_000
"""A station that asks for more than 20 messages a second gets 20."""
MOST_US: Final = 3_600_000_000


@dataclass(slots=True)
class _Stream:
    default_us: int
    interval_us: int
    due_s: float = 0.0


class Intervals:
    """When each message is due.

    Args:
        defaults_us: interval by message id; 0 for messages that are not sent regularly unless asked for.
    """

    def __init__(self, defaults_us: dict[int, int]) -> None:
        self._streams = {message_id: _Stream(us, us) for message_id, us in defaults_us.items()}

    def knows(self, message_id: int) -> bool:
        """Whether this message's interval can be set."""
        return message_id in self._streams

    def asked(self, message_id: int) -> bool:
        """Whether a station asked for another interval than the default."""
        stream = self._streams[message_id]
        return stream.interval_us != stream.default_us

    def set(self, message_id: int, interval_us: float, now_s: float) -> bool:
        """Set an interval as MAV_CMD_SET_MESSAGE_INTERVAL gives it: -1 stops, 0 is the default; too small is enlarged.

        Returns:
            False for a message that is not known, and for intervals without a meaning.
        """
        stream = self._streams.get(message_id)
        if stream is None or not math.isfinite(interval_us) or (interval_us < 0.0 and interval_us != -1.0):
            return False
        if interval_us == -1.0:
            stream.interval_us = 0
        elif interval_us == 0.0:
            stream.interval_us = stream.default_us
        else:
            stream.interval_us = int(min(max(interval_us, LEAST_US), MOST_US))
        # Asking again and again must not make it faster than the interval allows.
        stream.due_s = min(max(stream.due_s, now_s), now_s + stream.interval_us * 1e-6)
        return True

    def interval_us(self, message_id: int) -> int:
        """As MESSAGE_INTERVAL gives it: -1 for a message that is not sent regularly, 0 for one that is not known."""
        stream = self._streams.get(message_id)
        if stream is None:
            return 0
        return min(stream.interval_us, 2**31 - 1) or -1

    def due(self, message_id: int, now_s: float) -> bool:
        """Whether a message is due; if so, it is counted as sent."""
        stream = self._streams[message_id]
        if stream.interval_us == 0 or now_s < stream.due_s:
            return False
        step_s = stream.interval_us * 1e-6
        stream.due_s = stream.due_s + step_s if now_s - stream.due_s < step_s else now_s + step_s
        return True
