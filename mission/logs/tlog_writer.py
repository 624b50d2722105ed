"""Keeps telemetry as it is received, as the logs of ground stations: UNIX microseconds, then the frame."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

from mission.video.background_writer import BackgroundWriter

_BATCH_BYTES = 16_384


class TlogWriter:
    """Takes frames in the link's thread; the file is written in another.

    Args:
        path: of the log.
        max_bytes: nothing is kept beyond.
        utc_of: UNIX seconds of a program time.
        writer: makes the thread.
    """

    def __init__(
        self,
        path: Path,
        max_bytes: int,
        utc_of: Callable[[float], float],
        writer: Callable[[str], BackgroundWriter] = BackgroundWriter,
    ) -> None:
        self._path, self._left, self._utc_of = path, max_bytes, utc_of
        self._batch = bytearray()
        self._writer = writer("the telemetry")

    def take(self, frame: bytes, arrived_s: float) -> None:
        """A frame that was received; returns at once."""
        if self._left < len(frame) + 8:
            return
        self._left -= len(frame) + 8
        self._batch += struct.pack(">Q", round(self._utc_of(arrived_s) * 1e6)) + frame
        if len(self._batch) >= _BATCH_BYTES:
            self._flush()

    def close(self) -> None:
        """Write what is left; waits some seconds at most."""
        self._flush()
        self._writer.close()

    def _flush(self) -> None:
        batch, self._batch = bytes(self._batch), bytearray()
        self._writer.put(lambda: self._append(batch))

    def _append(self, batch: bytes) -> None:
        with self._path.open("ab") as file:
            file.write(batch)
