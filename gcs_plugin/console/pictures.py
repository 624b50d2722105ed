"""The video for pages: the newest picture only, as JPEG, each with its number, its time and the target's box in it.

In flight a picture comes from the flight's own loop, with the box that was found in that very picture; else it is taken
from the source. Encoding is done in a thread of its own, and only while somebody looks.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from mission.records import Frame
from mission.track import Track
from mission.video import VideoSource

_QUALITY: Final = 78
_FRESH_S: Final = 0.6
"""After this time without a picture of the flight's loop they are taken from the source again."""
_KEPT: Final = 128
_WAIT_S: Final = 0.25
_LARGEST_PX: Final = 1280
_LEAST_PERIOD_S: Final = 0.03


@dataclass(frozen=True, slots=True)
class Picture:
    """One frame for pages."""

    id: int
    t_s: float
    """Program time of its exposure."""
    jpeg: bytes
    box: tuple[float, float, float, float] | None
    """Left, top, right, bottom, as fractions of the picture."""
    state: str
    """Of the track; empty where nothing is followed."""


@dataclass(frozen=True, slots=True)
class _Offer:
    frame: Frame
    track: Track | None
    at_s: float


class Pictures:
    """Pictures for all pages. Any thread may call it.

    Args:
        clock: the program's clock, seconds.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._changed = threading.Condition()
        self._source: VideoSource | None = None
        self._offer: _Offer | None = None
        self._viewers = 0
        self._ended = False
        self._newest: Picture | None = None
        self._image: tuple[int, Frame] | None = None
        self._times: dict[int, float] = {}
        self._listeners: set[Callable[[], None]] = set()
        self._thread = threading.Thread(target=self._run, name="console-video", daemon=True)
        self._thread.start()

    @property
    def wanted(self) -> bool:
        """Whether somebody looks."""
        return self._viewers > 0

    @property
    def newest(self) -> Picture | None:
        """The newest picture."""
        return self._newest

    @property
    def newest_frame(self) -> tuple[int, Frame] | None:
        """The newest frame as it came from the camera, with its number as a picture."""
        return self._image

    def time_of(self, number: int) -> float | None:
        """When a picture was exposed; None of one that is not remembered."""
        with self._changed:
            return self._times.get(number)

    def watch(self, news: Callable[[], None]) -> None:
        """Somebody looks; is told of each new picture, in another thread, and must not wait."""
        with self._changed:
            self._viewers += 1
            self._listeners.add(news)
            self._changed.notify_all()

    def leave(self, news: Callable[[], None]) -> None:
        """Somebody looks no more."""
        with self._changed:
            self._viewers -= 1
            self._listeners.discard(news)

    def play(self, source: VideoSource | None) -> None:
        """The video that is open now; None when it was closed."""
        with self._changed:
            self._source = source
            self._changed.notify_all()

    def offer(self, frame: Frame, track: Track | None) -> None:
        """A picture of the flight's loop, with the target in it. Returns at once."""
        if self._viewers:
            with self._changed:
                self._offer = _Offer(frame, track, self._clock())
                self._changed.notify_all()

    def close(self) -> None:
        """No more pictures. Safe to call twice."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        self._thread.join(2.0)

    def _run(self) -> None:
        last, of, said_s = -1, None, 0.0
        while not self._ended:
            with self._changed:
                if not self._viewers or (self._source is None and self._offer is None):
                    self._changed.wait(_WAIT_S)
                    continue
                source, offer = self._source, self._offer
                if offer is not None and self._clock() - offer.at_s > _FRESH_S:
                    self._offer = offer = None
                if offer is not None and offer.frame.t_s <= said_s:
                    self._changed.wait(_WAIT_S)
                    continue
            if offer is not None:
                said_s = offer.frame.t_s
                self._publish(offer.frame, offer.track)
                continue
            if source is None:
                continue
            if source is not of:
                last, of = -1, source
            frame = source.latest(last, _WAIT_S)
            if frame is None:
                self._rest(source)
                continue
            last = frame.index
            if frame.t_s >= said_s + _LEAST_PERIOD_S or frame.t_s < said_s - 1.0:
                said_s = frame.t_s
                self._publish(frame, None)

    def _rest(self, source: VideoSource) -> None:
        """A source that has ended answers at once."""
        with self._changed:
            if self._source is source:
                self._changed.wait(0.05)

    def _publish(self, frame: Frame, track: Track | None) -> None:
        height, width = frame.image.shape[:2]
        scale = min(1.0, _LARGEST_PX / max(width, height))
        image = frame.image
        if scale < 1.0:
            size = (round(width * scale), round(height * scale))
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
        box = None
        if track is not None:
            area = track.box
            box = (area.left_px / width, area.top_px / height, area.right_px / width, area.bottom_px / height)
        with self._changed:
            number = 1 + (self._newest.id if self._newest is not None else 0)
            self._newest = Picture(number, frame.t_s, jpeg, box, "" if track is None else track.state)
            self._image = number, frame
            self._times[number] = frame.t_s
            while len(self._times) > _KEPT:
                del self._times[next(iter(self._times))]
            listeners = list(self._listeners)
        for news in listeners:
            news()
