"""A recorded video, picture by picture at the speed of the machine, each with its time in the video."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import av
import av.error
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from mission.errors import VideoError
from mission.records import Frame, Image

_LEAST_FRAME_S = 1e-4
"""Pictures whose time is not later than the one before it are left out."""


@dataclass(frozen=True, slots=True)
class VideoFacts:
    """What a video's file tells of it."""

    width_px: int
    height_px: int
    duration_s: float
    """As the file says; 0 where it does not."""
    rate_hz: float
    created_utc_s: float | None
    """When it was begun, seconds since 1970, by the camera's own clock; some write local time."""
    codec: str


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A decoded picture that is converted only when it is wanted."""

    t_s: float
    """Since the video's first picture."""
    index: int
    """Rises from picture to picture."""
    decoded: VideoFrame

    def frame(self) -> Frame:
        """In colour, as detectors and trackers want it."""
        return Frame(np.asarray(self.decoded.to_ndarray(format="bgr24"), dtype=np.uint8), self.t_s, self.index)

    def grey(self, width_px: int, height_px: int) -> Image:
        """(height, width), scaled with area averaging."""
        small = self.decoded.reformat(width=width_px, height=height_px, format="gray", interpolation="AREA")
        return np.asarray(small.to_ndarray(), dtype=np.uint8)


class FileVideo:
    """A video file; each call of `pictures` reads it anew.

    Args:
        path: of the file.

    Raises:
        VideoError: there is no video in it that can be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damaged = 0
        """Packets that no picture came of, in the last reading."""
        with self._opened() as container:
            stream = _stream(container, path)
            start, base = stream.start_time, stream.time_base
            self._first_s = 0.0 if start is None or base is None else float(start * base)
            self.facts = _facts(container, stream)

    def pictures(self, from_s: float = 0.0, to_s: float = float("inf")) -> Iterator[Picture]:
        """The pictures between two times, in order; decoding starts at the key frame before the first one.

        Raises:
            VideoError: the file cannot be read on from here; what came before was good.
        """
        self.damaged = 0
        last_s, index = -np.inf, 0
        try:
            with self._opened() as container:
                stream = _stream(container, self.path)
                stream.thread_type = "NONE"
                base = stream.time_base
                if from_s > 0.0 and base is not None:
                    container.seek(max(0, int((from_s + self._first_s) / base)), stream=stream, backward=True)
                for packet in container.demux(stream):
                    for decoded in self._decode(packet):
                        t_s = (
                            last_s + 1.0 / self.facts.rate_hz if decoded.time is None else decoded.time - self._first_s
                        )
                        if t_s < last_s + _LEAST_FRAME_S or decoded.is_corrupt:
                            continue
                        last_s, index = t_s, index + 1
                        if t_s > to_s:
                            return
                        if t_s >= from_s - _LEAST_FRAME_S:
                            yield Picture(t_s, index, decoded)
        except av.error.FFmpegError as error:
            if last_s < 0.0:
                raise self._unreadable(error) from error
            self.damaged += 1  # a file that ends in the middle

    def _decode(self, packet: av.Packet) -> list[VideoFrame]:  # type: ignore[type-arg]  # generic in the stubs only
        try:
            return [frame for frame in packet.decode() if isinstance(frame, VideoFrame)]
        except av.error.InvalidDataError:
            self.damaged += 1
            return []

    def _opened(self) -> InputContainer:
        try:
            return av.open(str(self.path))
        except (av.error.FFmpegError, OSError, ValueError) as error:
            raise self._unreadable(error) from error

    def _unreadable(self, error: Exception) -> VideoError:
        why = getattr(error, "strerror", None) or str(error)
        return VideoError(f"The video {self.path.name} cannot be read ({why})", "Copy it from the card again.")


def _stream(container: InputContainer, path: Path) -> VideoStream:
    if not container.streams.video:
        raise VideoError(f"There is no video in {path.name}", "Name the file with the pictures.")
    return container.streams.video[0]


def _facts(container: InputContainer, stream: VideoStream) -> VideoFacts:
    base = stream.time_base
    if stream.duration is not None and base is not None:
        duration_s = float(stream.duration * base)
    else:
        duration_s = 0.0 if container.duration is None else container.duration / av.time_base
    rate = stream.average_rate or stream.guessed_rate
    created = container.metadata.get("creation_time") or stream.metadata.get("creation_time")
    return VideoFacts(
        stream.width, stream.height, duration_s, float(rate) if rate else 25.0, _utc(created), stream.codec.name
    )


def _utc(text: str | None) -> float | None:
    if not text:
        return None
    try:
        when = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError:
        return None
    seconds = (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
    return seconds if seconds > 9e8 else None  # 1904 and 1970 stand for a clock that was not set
