"""Ctrl-C and the end of the program while an aircraft may be flying."""

from __future__ import annotations

import signal
import threading
from types import FrameType


class Abort:
    """Ctrl-C: before the flight it ends the program, during the flight it ends the flight and lets it clean up."""

    def __init__(self) -> None:
        self._asked = threading.Event()
        self.in_flight = False

    def install(self) -> None:
        """Take over SIGINT and SIGTERM, and SIGHUP (the terminal was closed) unless it is ignored, as under nohup."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        hangup = getattr(signal, "SIGHUP", None)  # Windows has none
        if hangup is not None and signal.getsignal(hangup) is not signal.SIG_IGN:
            signal.signal(hangup, self._on_signal)

    def asked(self) -> bool:
        """Whether the operator wants an end."""
        return self._asked.is_set()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._asked.set()
        if not self.in_flight:
            raise KeyboardInterrupt
