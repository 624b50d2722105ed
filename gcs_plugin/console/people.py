"""Finds people in the newest picture while nothing flies, so that they can be tapped."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gcs_plugin.console.pictures import Pictures
from mission.detect import Detector

PERIOD_S: Final = 0.5
RESTS: Final = 4.0
"""Rests at least this many times as long as it looked: a slow machine has other things to do."""
Fractions = tuple[float, float, float, float]
"""Left, top, right, bottom of a box, as fractions of the picture."""


@dataclass(frozen=True, slots=True)
class People:
    """Who was seen in one picture."""

    picture: int
    boxes: tuple[Fractions, ...] = ()


class Lookout:
    """Looks twice a second, in a thread and with a detector of its own, and only while somebody looks at the page.

    Args:
        pictures: the video.
        detector: makes the detector at the first look.
        idle: whether nothing flies: the flight needs the processor for itself.
    """

    def __init__(self, pictures: Pictures, detector: Callable[[], Detector], idle: Callable[[], bool]) -> None:
        self._pictures = pictures
        self._make = detector
        self._idle = idle
        self._ended = threading.Event()
        self.people = People(0)
        self._thread = threading.Thread(target=self._run, name="console-lookout", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Look no more. Safe to call twice."""
        self._ended.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        detector: Detector | None = None
        rest_s = PERIOD_S
        while not self._ended.wait(rest_s):
            newest = self._pictures.newest_frame
            if not self._pictures.wanted or not self._idle() or newest is None or newest[0] == self.people.picture:
                continue
            detector = detector or self._make()
            number, frame = newest
            began_s = time.monotonic()
            height, width = frame.image.shape[:2]
            boxes = tuple(
                (box.left_px / width, box.top_px / height, box.right_px / width, box.bottom_px / height)
                for box in (found.box for found in detector.detect(frame.image))
            )
            self.people = People(number, boxes)
            rest_s = max(PERIOD_S, RESTS * (time.monotonic() - began_s))
