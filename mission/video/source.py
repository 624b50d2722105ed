"""A video as the newest frame, decoded in a thread of its own that reconnects after a break."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal, Protocol

import av.error
import cv2
import numpy as np
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from mission.addresses import shown_address
from mission.errors import VideoError
from mission.records import Frame, Image
from mission.vehicle.ardrone.url import is_ardrone
from mission.video.ardrone import open_ardrone_video
from mission.video.ffmpeg import Input, explain, is_live, missing_file, open_input
from mission.video.recorder import PacketRecorder, Recording
from mission.video.stats import VideoState, VideoStats
from mission.video.timeline import Arrivals, LiveTimeline, RecordedTimeline, Timeline

_log = logging.getLogger(__name__)

_FIRST_DELAY_S = 0.1
_LAST_DELAY_S = 2.0
_SAME_SHAPE = 0.01
"""Relative difference of two pictures' width to height that is rounding."""
_RATE_WINDOW_S = 2.0
_CLOSE_S = 0.3


class VideoSource(Protocol):
    """Frames, newest first."""

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        """The newest frame if its index is above `after_index`, waiting for it if need be.

        Returns:
            None when none came within the time, or when the video has ended or was closed.
        """
        ...

    def stats(self) -> VideoStats:
        """How it is doing."""
        ...

    def close(self) -> None:
        """Stop; returns at once even when the stream hangs. Safe to call twice."""
        ...


Pace = Literal["real-time", "consumed"]


def open_video(
    url: str,
    *,
    latency_s: float = 0.0,
    clock: Callable[[], float] = time.monotonic,
    pace: Pace = "real-time",
    start_s: float | None = None,
    options: Mapping[str, str] | None = None,
    open_timeout_s: float = 10.0,
    stall_s: float = 1.0,
) -> VideoSource:
    """Open a stream or a file and wait for its first frame.

    Args:
        url: anything FFmpeg reads (RTSP, UDP MPEG-TS, HTTP, MP4, ``session.sdp`` for RTP, ``folder/%04d.png``), or
            ``ardrone://HOST`` for that drone's own video.
        latency_s: from the middle of the exposure to the arrival, subtracted from live frames' times.
        clock: the program's clock, seconds.
        pace: files only: by their own times, or the next frame only when the last one was taken.
        start_s: files only: program time of the first frame; now, when not given.
        options: FFmpeg options on top of the low-delay ones, such as ``{"rtsp_transport": "udp"}``, or, for a
            transport stream known to carry one frame per PES packet, ``{"fflags": "noparse+nofillin"}``, which saves
            one frame of delay.
        open_timeout_s: how long to wait for the first frame.
        stall_s: a live stream silent for this long is opened again.

    Raises:
        VideoError: no frame came; the message says why and what to do.
    """
    if is_ardrone(url):
        return open_ardrone_video(url, latency_s=latency_s, clock=clock, open_timeout_s=open_timeout_s, stall_s=stall_s)
    if missing := missing_file(url):
        raise VideoError(f"The video's {missing} does not exist: {shown_address(url)}", "Check the path.")
    source = _StreamVideo(url, latency_s, clock, pace, start_s, options or {}, min(open_timeout_s, 5.0), stall_s)
    if not source.wait_first(open_timeout_s):
        error = source.failure()
        source.close()
        raise error
    return source


class _StreamVideo:
    """The decoder thread and the one-frame queue between it and the consumer."""

    def __init__(
        self,
        url: str,
        latency_s: float,
        clock: Callable[[], float],
        pace: Pace,
        start_s: float | None,
        options: Mapping[str, str],
        open_timeout_s: float,
        stall_s: float,
    ) -> None:
        self._url = url
        self._live = is_live(url)
        self._latency_s = latency_s
        self._clock = clock
        self._wait_taken = pace == "consumed" and not self._live
        self._start_s = start_s
        self._options = options
        self._timeouts = open_timeout_s, stall_s
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._state = VideoState.CONNECTING
        self._newest: Frame | None = None
        self._taken = True
        self._decoded = self._dropped = self._damaged = self._reconnects = 0
        self._busy_s = 0.0
        self._decoded_at: deque[float] = deque(maxlen=256)
        self._last_t_s = -np.inf
        self._failure = explain(url, TimeoutError(), self._live)
        self._error = self._note = self._codec = ""
        self._size: tuple[int, int] | None = None
        self._recorder = PacketRecorder()
        self._thread = threading.Thread(target=self._run, name="video", daemon=True)
        self._thread.start()

    def wait_first(self, timeout_s: float) -> bool:
        """Whether a frame came within the time, before the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._over(), timeout_s)
            return self._newest is not None

    def failure(self) -> VideoError:
        """Why no frame came."""
        if self._damaged and not self._decoded:
            return VideoError(
                f"Data arrives at {shown_address(self._url)}, but no whole picture",
                "Let the camera send a key frame every second, and check the connection for losses.",
            )
        return self._failure

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        with self._changed:
            self._changed.wait_for(lambda: self._fresh(after_index) is not None or self._over(), timeout_s)
            frame = self._fresh(after_index)
            if frame is not None:
                self._taken = True
                self._changed.notify_all()
            return frame

    def stats(self) -> VideoStats:
        with self._changed:
            now = self._clock()
            recent = [at for at in self._decoded_at if now - at <= _RATE_WINDOW_S]
            age = now - self._decoded_at[-1] if self._decoded_at else None
            if self._live and np.isfinite(self._last_t_s):
                # At a break FFmpeg hands out what it had kept back: new to us, but not new.
                age = now - self._last_t_s - self._latency_s
            fps = (len(recent) - 1) / max(now - recent[0], 1e-3) if recent else 0.0
            mean_s = self._busy_s / max(self._decoded, 1)
            return VideoStats(
                self._state,
                fps,
                self._decoded,
                self._dropped,
                self._damaged,
                self._reconnects,
                age,
                mean_s,
                self._error,
                self._note,
                self._codec,
            )

    def close(self) -> None:
        self._closing.set()
        with self._changed:
            self._state = VideoState.CLOSED
            self._changed.notify_all()
        # Inside FFmpeg the thread notices only at the next packet or time-out; nobody needs to wait for that.
        self._thread.join(_CLOSE_S)

    def start_recording(self, path: Path, max_bytes: int) -> None:
        """See `mission.video.recorder.Recordable`; nothing is kept of a file, which is there already."""
        self._recorder.start(path, max_bytes)

    def stop_recording(self) -> Recording | None:
        """See `mission.video.recorder.Recordable`."""
        return self._recorder.stop()

    def _fresh(self, after_index: int) -> Frame | None:
        return self._newest if self._newest is not None and self._newest.index > after_index else None

    def _over(self) -> bool:
        return self._state in (VideoState.ENDED, VideoState.CLOSED)

    def _run(self) -> None:
        delay_s = _FIRST_DELAY_S
        while not self._closing.is_set():
            decoded, ended = self._decoded, False
            try:
                source = open_input(self._url, self._options, *self._timeouts)
                try:
                    self._play(source)
                finally:
                    source.container.close()
                ended = True
                failure = VideoError(
                    f"The video {shown_address(self._url)} was ended by its sender", "Start it again there."
                )
            except (av.error.FFmpegError, OSError, ValueError, VideoError) as error:
                failure = explain(self._url, error, self._live)
            if self._closing.is_set():
                return
            if not self._live:
                over = ended and self._decoded > 0
                self._enter(VideoState.ENDED, failure, "" if over else failure.cause)
                return
            if self._decoded > decoded:
                delay_s = _FIRST_DELAY_S
                _log.warning("%s; trying again", failure.cause)
            self._enter(VideoState.RECONNECTING if self._decoded else VideoState.CONNECTING, failure, failure.cause)
            self._closing.wait(delay_s)
            delay_s = min(2.0 * delay_s, _LAST_DELAY_S)

    def _enter(self, state: VideoState, failure: VideoError, error: str) -> None:
        with self._changed:
            self._failure = failure
            if self._state is not VideoState.CLOSED:
                self._state, self._error = state, error
            self._changed.notify_all()

    def _play(self, source: Input) -> None:
        opened_s = self._clock()
        self._codec = source.stream.codec_context.name if source.stream.codec_context else ""
        timeline: Timeline
        if self._live:
            timeline = LiveTimeline(self._latency_s)
        else:
            timeline = RecordedTimeline(opened_s if self._start_s is None else self._start_s, source.frame_s)
        arrivals = Arrivals()
        first_t_s: float | None = None
        self._recorder.new_stream()
        for packet in source.container.demux(source.stream):
            arrived_s = self._clock()
            if self._live:
                self._recorder.take(packet, source.stream, self._decoded)
            if packet.pts is not None and packet.time_base is not None:
                arrivals.note(float(packet.pts * packet.time_base), arrived_s)
            began_s = time.perf_counter()
            pictures = self._decode(packet)
            self._busy_s += time.perf_counter() - began_s
            for picture in pictures:
                if self._closing.is_set():
                    return
                pts_s = picture.time if source.timed else None
                t_s = timeline.time_of(pts_s, arrivals.of(picture.time, arrived_s))
                first_t_s = t_s if first_t_s is None else first_t_s
                if not self._live and not self._wait_taken:
                    self._closing.wait(max(0.0, opened_s + t_s - first_t_s - self._clock()))
                self._say(timeline.note)
                self._publish(picture, t_s, timeline.settled)

    def _sized(self, image: Image) -> Image:
        """The picture in the size of the first one, which is what the camera's calibration is for.

        Raises:
            VideoError: it has another shape, so that it shows something else.
        """
        height, width = image.shape[:2]
        self._size = self._size or (width, height)
        if self._size == (width, height):
            return image
        change = f"the picture changed from {self._size[0]} x {self._size[1]} to {width} x {height} pixels"
        if abs(width * self._size[1] - height * self._size[0]) > _SAME_SHAPE * width * self._size[1]:
            raise VideoError(change, "Let the camera keep its picture size in flight; start again for another one.")
        self._say(f"{change}: it is scaled back")
        return np.asarray(cv2.resize(image, self._size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)

    def _decode(self, packet: Packet[VideoStream]) -> list[VideoFrame]:
        try:
            pictures = packet.decode()
        except av.error.InvalidDataError:
            # Before the first key frame and after lost packets; the next key frame heals it.
            self._damaged += 1
            return []
        whole = [picture for picture in pictures if not picture.is_corrupt]
        self._damaged += len(pictures) - len(whole)
        return whole

    def _say(self, note: str) -> None:
        if note and note != self._note:
            self._note = note
            _log.warning("%s: %s", shown_address(self._url), note)

    def _publish(self, picture: VideoFrame, t_s: float, settled: bool) -> None:
        began_s = time.perf_counter()
        image = self._sized(np.asarray(picture.to_ndarray(format="bgr24"), dtype=np.uint8))
        self._busy_s += time.perf_counter() - began_s
        with self._changed:
            index = self._decoded
            self._decoded += 1
            self._decoded_at.append(self._clock())
            if not settled or t_s <= self._last_t_s:
                self._dropped += 1
                return
            if self._wait_taken:
                self._changed.wait_for(lambda: self._taken or self._closing.is_set())
            if not self._taken:
                self._dropped += 1
            self._newest, self._taken, self._last_t_s = Frame(image, t_s, index), False, t_s
            if self._state is not VideoState.CLOSED:
                if self._state is VideoState.RECONNECTING:
                    self._reconnects += 1
                    _log.info("The video %s is back", shown_address(self._url))
                self._state, self._error = VideoState.PLAYING, ""
            self._changed.notify_all()
