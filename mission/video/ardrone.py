"""The AR.Drone's own video: PaVE frames of H.264 over TCP 5555, decoded newest first.

A thread reads the socket, so that the drone never has to wait for us; another decodes. When the decoder falls behind it
goes on at the newest key frame: pictures in between depend on ones that were not decoded.
"""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import av.error
import numpy as np
from av.codec.context import CodecContext, Flags
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame

from mission.errors import VideoError
from mission.records import Frame, Image
from mission.vehicle.ardrone.pave import H264, FrameType, PaveFrame, PaveSplitter
from mission.vehicle.ardrone.url import ardrone_address
from mission.video.stats import VideoState, VideoStats
from mission.video.timeline import LiveTimeline

_log = logging.getLogger(__name__)

BEHIND = 4
"""Frames waiting for the decoder beyond which it looks for a newer key frame."""
MOST_WAITING = 120
"""Without any key frame among so many, they are thrown away: the next key frame heals it."""
_FIRST_DELAY_S = 0.1
_LAST_DELAY_S = 1.0
_RATE_WINDOW_S = 2.0
_CLOSE_S = 1.0


@dataclass(frozen=True, slots=True)
class Arrived:
    """A frame and the program time at which its last byte came."""

    frame: PaveFrame
    arrived_s: float
    connection: int = 1
    """1, 2, ... for each time that we connected."""


class FrameQueue:
    """Frames between the reading and the decoding thread; never more than `MOST_WAITING`."""

    def __init__(self) -> None:
        self._waiting: deque[Arrived] = deque()
        self._changed = threading.Condition()
        self._broken = True
        self.dropped = 0
        """Frames that were never decoded."""

    def put(self, arrived: Arrived) -> None:
        """Add the newest frame; what it makes useless is dropped."""
        with self._changed:
            if arrived.frame.key and len(self._waiting) >= BEHIND:
                self._drop_all()
            elif len(self._waiting) >= MOST_WAITING:
                self._drop_all()
                self._broken = True
            if self._broken and not arrived.frame.key:
                self.dropped += 1
                return
            self._broken = False
            self._waiting.append(arrived)
            self._changed.notify()

    def take(self, timeout_s: float) -> Arrived | None:
        """The next frame to decode; None when none came within the time."""
        with self._changed:
            self._changed.wait_for(lambda: bool(self._waiting), timeout_s)
            return self._waiting.popleft() if self._waiting else None

    def wait_for_key(self) -> None:
        """After damage: nothing more before the next key frame."""
        with self._changed:
            while self._waiting and not self._waiting[0].frame.key:
                self._waiting.popleft()
                self.dropped += 1
            self._broken = not self._waiting

    def _drop_all(self) -> None:
        self.dropped += len(self._waiting)
        self._waiting.clear()


def open_ardrone_video(
    url: str,
    *,
    latency_s: float = 0.0,
    clock: Callable[[], float] = time.monotonic,
    open_timeout_s: float = 10.0,
    stall_s: float = 1.0,
) -> ArdroneVideo:
    """Connect and wait for the first picture.

    Args:
        url: ``ardrone://HOST?...``, see `mission.vehicle.ardrone.url`; ``size=`` scales the pictures.
        latency_s: from the middle of the exposure to the arrival, subtracted from the frames' times.
        clock: the program's clock, seconds.
        open_timeout_s: how long to wait for the first picture.
        stall_s: after this silence the connection is made anew.

    Raises:
        SettingsError: the address is none.
        VideoError: no picture came; the message says why and what to do.
    """
    address = ardrone_address(url)
    source = ArdroneVideo((address.host, address.video_port), address.size_px, latency_s, clock, stall_s)
    if source.latest(-1, open_timeout_s) is None:
        error = source.stats().error or "no whole picture came"
        source.close()
        raise VideoError(
            f"No video from the AR.Drone at {address.host}:{address.video_port}: {error}",
            "Check that the drone is on, and that no other program takes its video.",
        )
    return source


class ArdroneVideo:
    """`mission.video.VideoSource` of one AR.Drone; it connects again after a break, for as long as it is open."""

    def __init__(
        self,
        endpoint: tuple[str, int],
        size_px: tuple[int, int] | None,
        latency_s: float,
        clock: Callable[[], float],
        stall_s: float,
    ) -> None:
        self._endpoint = endpoint
        self._size_px = size_px
        self._clock = clock
        self._stall_s = stall_s
        self._queue = FrameQueue()
        self._timeline = LiveTimeline(latency_s)
        self._latency_s = latency_s
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._state = VideoState.CONNECTING
        self._error = ""
        self._newest: Frame | None = None
        self._taken = True
        self._decoded = self._replaced = self._damaged = self._reconnects = 0
        self._busy_s = 0.0
        self._decoded_at: deque[float] = deque(maxlen=256)
        self._last_t_s = -np.inf
        self._connection = self._shown_connection = 0
        self._threads = [
            threading.Thread(target=self._read, name="video-in", daemon=True),
            threading.Thread(target=self._decode, name="video", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        """The newest frame if its index is above `after_index`, waiting for it if need be."""
        with self._changed:
            self._changed.wait_for(lambda: self._fresh(after_index) is not None or self._closing.is_set(), timeout_s)
            frame = self._fresh(after_index)
            if frame is not None:
                self._taken = True
            return frame

    def stats(self) -> VideoStats:
        """How it is doing."""
        with self._changed:
            now = self._clock()
            recent = [at for at in self._decoded_at if now - at <= _RATE_WINDOW_S]
            age = now - self._last_t_s - self._latency_s if np.isfinite(self._last_t_s) else None
            return VideoStats(
                self._state,
                (len(recent) - 1) / max(now - recent[0], 1e-3) if recent else 0.0,
                self._decoded,
                self._replaced + self._queue.dropped,
                self._damaged,
                self._reconnects,
                age,
                self._busy_s / max(self._decoded, 1),
                self._error,
            )

    def close(self) -> None:
        """Stop. Safe to call twice."""
        self._closing.set()
        with self._changed:
            self._state = VideoState.CLOSED
            self._changed.notify_all()
        for thread in self._threads:
            thread.join(_CLOSE_S)

    def _fresh(self, after_index: int) -> Frame | None:
        return self._newest if self._newest is not None and self._newest.index > after_index else None

    def _enter(self, state: VideoState, error: str) -> None:
        with self._changed:
            if self._state is not VideoState.CLOSED:
                self._state, self._error = state, error

    def _read(self) -> None:
        delay_s = _FIRST_DELAY_S
        while not self._closing.is_set():
            try:
                with socket.create_connection(self._endpoint, self._stall_s) as sock:
                    sock.settimeout(self._stall_s)
                    if self._receive(sock):
                        delay_s = _FIRST_DELAY_S
                error = "the drone ended the connection"
            except TimeoutError:
                error = f"silent for {self._stall_s:.0f} s"
            except OSError as failure:
                error = str(failure)
            if self._closing.is_set():
                return
            self._enter(VideoState.RECONNECTING if self._decoded else VideoState.CONNECTING, error)
            self._closing.wait(delay_s)
            delay_s = min(2.0 * delay_s, _LAST_DELAY_S)

    def _receive(self, sock: socket.socket) -> bool:
        """Read until the connection ends; whether any frame came.

        Raises:
            OSError: it broke, or fell silent.
        """
        splitter = PaveSplitter()
        some = False
        damaged = 0
        self._connection += 1
        self._queue.wait_for_key()
        while not self._closing.is_set():
            data = sock.recv(262144)
            if not data:
                return some
            arrived = self._clock()
            for frame in splitter.feed(data):
                if frame.codec == H264 and frame.frame_type != FrameType.HEADERS:
                    self._queue.put(Arrived(frame, arrived, self._connection))
                some = True
            if splitter.damaged + splitter.skipped_bytes != damaged:
                damaged = splitter.damaged + splitter.skipped_bytes
                with self._changed:
                    self._damaged += 1
        return some

    def _decode(self) -> None:
        decoder, connection = _decoder(), 0
        while not self._closing.is_set():
            arrived = self._queue.take(0.1)
            if arrived is None:
                continue
            if arrived.connection != connection:
                decoder, connection = _decoder(), arrived.connection
            began_s = time.perf_counter()
            try:
                pictures = [p for p in decoder.decode(Packet(arrived.frame.payload)) if not p.is_corrupt]
            except av.error.FFmpegError:
                pictures = []
            if not pictures:
                with self._changed:
                    self._damaged += 1
                self._queue.wait_for_key()
                continue
            image = self._image(pictures[-1])
            self._busy_s += time.perf_counter() - began_s
            self._publish(image, arrived)

    def _image(self, picture: VideoFrame) -> Image:
        # Scaled in the conversion to BGR: a quarter of the time of doing one after the other.
        width, height = self._size_px or (picture.width, picture.height)
        bgr = picture.to_ndarray(format="bgr24", width=width, height=height, interpolation="AREA")
        return np.asarray(bgr, dtype=np.uint8)

    def _publish(self, image: Image, arrived: Arrived) -> None:
        with self._changed:
            t_s = self._timeline.time_of(arrived.frame.timestamp_s, arrived.arrived_s)
            index = self._decoded
            self._decoded += 1
            self._decoded_at.append(self._clock())
            if not self._timeline.settled or t_s <= self._last_t_s:
                self._replaced += 1
                return
            if not self._taken:
                self._replaced += 1
            self._newest, self._taken, self._last_t_s = Frame(image, t_s, index), False, t_s
            if arrived.connection != self._shown_connection:
                if self._shown_connection:
                    self._reconnects += 1
                    _log.info("the AR.Drone's video is back")
                self._shown_connection = arrived.connection
            if self._state is not VideoState.CLOSED and arrived.connection == self._connection:
                self._state, self._error = VideoState.PLAYING, ""
            self._changed.notify_all()


def _decoder() -> VideoCodecContext:
    context = CodecContext.create("h264", "r")
    if not isinstance(context, VideoCodecContext):
        raise VideoError("FFmpeg has no H.264 decoder", "Install PyAV's own wheel.")
    context.thread_type = "SLICE"
    context.flags |= Flags.low_delay
    return context
