"""Lens, sensor, encoder and sender in a thread of their own, beside the rendering of the next picture.

Rendering, remapping and encoding all leave the interpreter, so two threads use two cores, and a picture's time is
bounded by the longer of the two halves instead of by their sum.
"""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

from mission.records import Image
from sitl.camera.renderer import Renderer


class PictureSender(Protocol):
    """Where the pictures go."""

    muted: bool
    """While set, nothing is sent (a cut link)."""

    def send(self, picture: Image, capture_s: float) -> None:
        """Encode and send a picture taken `capture_s` after the camera's start."""
        ...

    def close(self) -> None:
        """Close the stream."""
        ...


class ExposurePipeline:
    """Makes pictures of what was drawn and sends them, in the order in which they were handed in.

    Args:
        renderer: its `develop` is used.
        sender: closed with the darkroom.
    """

    def __init__(self, renderer: Renderer, sender: PictureSender) -> None:
        self._renderer, self._sender = renderer, sender
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="darkroom")
        self._working: Future[None] | None = None
        self._last: Image | None = None
        self._sent = 0
        self._delays_s = 0.0

    @property
    def delay_s(self) -> float:
        """Mean time from capture to the end of encoding."""
        return self._delays_s / max(1, self._sent)

    def hand(self, light: Image | None, capture_s: float, start_s: float) -> None:
        """Develop and send a picture; waits until the one before is done, so that no more than one is late.

        Args:
            light: from `Renderer.draw`; None sends the last picture again (one must have been sent).
            capture_s: when it was taken, monotonic seconds.
            start_s: when the stream began.

        Raises:
            Exception: whatever went wrong with the picture before.
        """
        self._wait()
        self._working = self._thread.submit(self._send, light, capture_s, start_s)

    def mute(self, muted: bool) -> None:
        """Send nothing while set."""
        self._sender.muted = muted

    def close(self) -> None:
        """Finish the picture at hand and close the stream."""
        self._thread.shutdown(wait=True)
        self._sender.close()

    def _wait(self) -> None:
        if self._working is not None:
            self._working.result()

    def _send(self, light: Image | None, capture_s: float, start_s: float) -> None:
        if light is not None:
            self._last = self._renderer.develop(light, capture_s)
        assert self._last is not None
        self._sender.send(self._last, capture_s - start_s)
        self._sent += 1
        self._delays_s += time.monotonic() - capture_s
