"""The terminal of a program that flies: what cannot be written is lost, and the program goes on."""

from __future__ import annotations

import io
import os
import sys

from rich.console import Console


class LastingOutput(io.TextIOBase):
    """Text to a file descriptor, without a buffer. A full disk, a closed pipe or a terminal that has gone ends nothing.

    Args:
        descriptor: to write to.
        encoding: of the text; what it cannot say becomes a question mark.
    """

    def __init__(self, descriptor: int, encoding: str = "utf-8") -> None:
        super().__init__()
        self._descriptor = descriptor
        self._encoding = encoding
        self.lost = 0
        """Characters that could not be written."""

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
        """Write at once, as far as possible."""
        data = text.encode(self._encoding, "replace")
        try:
            while data:
                data = data[os.write(self._descriptor, data) :]
        except OSError:
            self.lost += len(text)
        return len(text)


def lasting_console() -> Console:
    """The console on standard output whose loss ends no flight and no service."""
    try:
        descriptor = sys.stdout.fileno()
    except (AttributeError, OSError, ValueError):  # there is none, or one in memory that cannot fail
        return Console(highlight=False)
    sys.stdout.flush()
    return Console(highlight=False, file=LastingOutput(descriptor, sys.stdout.encoding or "utf-8"))  # type: ignore[arg-type]
