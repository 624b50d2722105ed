"""`Mailbox`: messages that wait until somebody takes them."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any

Message = Any
"""A pymavlink message: its classes are generated and untyped."""


class Mailbox:
    """The messages of some types as they come; when nobody empties it the oldest go."""

    def __init__(self, size: int) -> None:
        self._messages: deque[Message] = deque(maxlen=size)
        self._arrived = threading.Condition()
        self.lost = 0
        """Messages dropped because the mailbox was full."""

    def put(self, message: Message) -> None:
        """Add a message; never blocks."""
        with self._arrived:
            if len(self._messages) == self._messages.maxlen:
                self.lost += 1
            self._messages.append(message)
            self._arrived.notify()

    def get(self, timeout_s: float) -> Message | None:
        """The oldest message not taken yet, or None after a time without any."""
        with self._arrived:
            self._arrived.wait_for(lambda: bool(self._messages), timeout_s)
            return self._messages.popleft() if self._messages else None
