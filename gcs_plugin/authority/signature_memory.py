"""The timestamps of signed messages, kept over a restart: what was sent before it is a replay after it as well.

https://mavlink.io/en/guide/message_signing.html asks for it: without it every frame of the last minute could be sent a
second time to a program that has just started.
"""

from __future__ import annotations

import json
import logging
import os
from pathlib import Path
from typing import Final

_LOG = logging.getLogger(__name__)

Stream = tuple[int, int, int]
"""Link id, system id, component id: each counts its timestamps for itself."""

TIMESTAMPS: Final = 2**48
"""They have six bytes on the wire."""
SELDOM_S: Final = 5.0
"""Between two times that timestamps of messages that are no orders are written."""


class SignatureMemory:
    """A small file. It outlives the program at once, and a power cut after some seconds (it is not forced to the disk).

    Args:
        path: made when it is not there; its folder is there. One that cannot be read is replaced.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._written_s: float | None = None
        self._failed = False
        self.streams: dict[Stream, int] = {}
        """Newest timestamps, 10 us since 2015, as they were written last."""
        self.lost = ""
        """Why the file could not be read, in the operator's words; empty when it was, or is not there."""
        try:
            self.streams = _parsed(path.read_text("ascii"))
        except FileNotFoundError:
            return
        except (OSError, ValueError, RecursionError) as error:
            self.lost = f"{path}, so that what was signed before now is refused: {str(error)[:120]}"

    def keep(self, streams: dict[Stream, int], now_s: float, *, order: bool) -> None:
        """Write the newest timestamps: at once for an order, else when the last time is long enough ago."""
        if not order and self._written_s is not None and abs(now_s - self._written_s) < SELDOM_S:
            return
        self._written_s = now_s
        draft = self._path.with_name(f".{self._path.name}.{os.getpid()}.new")
        try:
            draft.write_text(json.dumps({"/".join(map(str, s)): t for s, t in streams.items()}), "ascii")
            draft.replace(self._path)
            self._failed = False
        except OSError as error:
            if not self._failed:
                _LOG.warning("%s cannot be written: %s", self._path, error)
            self._failed = True


def _parsed(text: str) -> dict[Stream, int]:
    """The content of the file.

    Raises:
        ValueError: it is none.
    """
    content = json.loads(text)
    if not isinstance(content, dict):
        raise ValueError("it is not a table of timestamps")
    found = {}
    for name, stamp in content.items():
        numbers = [int(part) for part in str(name).split("/")]
        if len(numbers) != 3 or not all(0 <= n <= 255 for n in numbers):
            raise ValueError(f"{name} is no sender")
        if not isinstance(stamp, int) or not 0 <= stamp < TIMESTAMPS:
            raise ValueError(f"{name} has no timestamp")
        found[numbers[0], numbers[1], numbers[2]] = stamp
    return found
