"""The terminal of a program that flies: what cannot be written is lost or late, and the program goes on."""

from __future__ import annotations

import atexit
import io
import os
import sys
import threading
from collections import deque
from typing import Final

from rich.console import Console

MOST_BYTES: Final = 2**20
"""Text that waits for a terminal that was stopped (Ctrl-S) or a pipe that nobody reads; more is lost."""
LAST_PATIENCE_S: Final = 2.0
"""For what still waits at the end of the program."""


class LastingOutput(io.TextIOBase):
    """Text to a file descriptor, in a thread of its own.

    A full disk, a closed pipe or a terminal that has gone ends nothing, and one that takes no text holds up nothing.

    Args:
        descriptor: to write to.
        encoding: of the text; what it cannot say becomes a question mark.
    """

    def __init__(self, descriptor: int, encoding: str = "utf-8") -> None:
        super().__init__()
        self._descriptor = descriptor
        self._encoding = encoding
        self._waiting: deque[bytes] = deque()
        self._size = 0
        self._changed = threading.Condition()
        self._writer: threading.Thread | None = None
        self.lost = 0
        """Bytes that were not written."""

    @property
    def encoding(self) -> str:  # type: ignore[override]  # a property here, an attribute in the type stubs
        """Of the text."""
        return self._encoding

    def fileno(self) -> int:
        """The file descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return os.isatty(self._descriptor)

    def writable(self) -> bool:
        """It is."""
        return True

    def write(self, text: str) -> int:
        """Leave a text to be written; never waits."""
        data = text.encode(self._encoding, "replace")
        with self._changed:
            if self._size + len(data) > MOST_BYTES:
                self.lost += len(data)
                return len(text)
            self._waiting.append(data)
            self._size += len(data)
            self._changed.notify_all()
            if self._writer is None:
                self._writer = threading.Thread(target=self._run, name="terminal", daemon=True)
                self._writer.start()
        return len(text)

    def drain(self, timeout_s: float) -> bool:
        """Wait until nothing waits any more; whether that was so in time."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._waiting, timeout_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._waiting))
                data = self._waiting[0]
            unwritten = self._write(data)
            with self._changed:
                self._waiting.popleft()
                self._size -= len(data)
                self.lost += unwritten
                self._changed.notify_all()

    def _write(self, data: bytes) -> int:
        """Bytes that could not be written."""
        try:
            while data:
                data = data[os.write(self._descriptor, data) :]
        except OSError:
            return len(data)
        return 0


def lasting_console() -> Console:
    """The console on standard output whose loss ends no flight and no service."""
    try:
        descriptor = sys.stdout.fileno()
    except (AttributeError, OSError, ValueError):  # there is none, or one in memory that cannot fail
        return Console(highlight=False)
    sys.stdout.flush()
    output = LastingOutput(descriptor, sys.stdout.encoding or "utf-8")
    atexit.register(output.drain, LAST_PATIENCE_S)
    return Console(highlight=False, file=output)  # type: ignore[arg-type]  # writes what rich writes
