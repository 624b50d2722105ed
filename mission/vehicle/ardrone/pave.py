"""PaVE, Parrot Video Encapsulation: the header before each H.264 picture of the AR.Drone's video on TCP 5555.

Layout as in `video_encapsulation.h` of the AR.Drone SDK 2.0; little-endian, 64 bytes, more in later firmware
(header_size says how many).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

SIGNATURE = b"PaVE"
H264 = 4
"""video_codec of MPEG-4 AVC."""
MAX_PAYLOAD = 1_000_000
"""A larger payload_size is damage: a 720p key frame has some 100 kB."""
_MAX_HEADER = 256
_LAYOUT = struct.Struct("<4sBBHIHHHHIIBBBBIIHBBBB2sI12s")
HEADER_SIZE = _LAYOUT.size


class FrameType(IntEnum):
    """frame_type."""

    UNKNOWN = 0
    IDR = 1
    """Parameter sets and a key frame."""
    I = 2  # noqa: E741  # the field's own name
    P = 3
    HEADERS = 4


@dataclass(frozen=True, slots=True)
class PaveFrame:
    """One picture, or one slice of it."""

    codec: int
    frame_type: int
    number: int
    timestamp_s: float
    """On the drone's clock."""
    width_px: int
    """As it shall be shown; the encoded one may be larger (368 rows for 360)."""
    height_px: int
    slice_index: int
    total_slices: int
    payload: bytes

    @property
    def key(self) -> bool:
        """Whether decoding can begin with it."""
        return self.frame_type == FrameType.IDR


@dataclass(frozen=True, slots=True)
class _Header:
    frame: PaveFrame
    header_size: int
    payload_size: int


class PaveSplitter:
    """Cuts the TCP stream into frames; what is damaged is passed over up to the next header.

    A damaged payload_size could swallow seconds of good video, so a whole header inside of an awaited payload ends that
    payload: sixteen chosen bytes do not turn up in H.264 by chance.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._searched = 0
        self.skipped_bytes = 0
        """Passed over while looking for a header."""
        self.damaged = 0
        """Frames cut short by the next header."""

    def feed(self, data: bytes) -> list[PaveFrame]:
        """Take in the stream's next bytes; the frames that are whole now. Never raises."""
        self._buffer += data
        frames: list[PaveFrame] = []
        while (frame := self._next()) is not None:
            frames.append(frame)
        return frames

    def _next(self) -> PaveFrame | None:
        while True:
            if not self._align():
                return None
            header = _read_header(self._buffer, 0)
            if header is None:
                self._skip(len(SIGNATURE))
                continue
            end = header.header_size + header.payload_size
            early = self._early_header(header.header_size, end)
            if early is not None:
                self.damaged += 1
                self._skip(early)
                continue
            if len(self._buffer) < end:
                return None
            payload = bytes(self._buffer[header.header_size : end])
            self._drop(end)
            head = header.frame
            return PaveFrame(
                head.codec,
                head.frame_type,
                head.number,
                head.timestamp_s,
                head.width_px,
                head.height_px,
                head.slice_index,
                head.total_slices,
                payload,
            )

    def _align(self) -> bool:
        """Whether the buffer begins with a signature and a whole header's worth of bytes."""
        at = self._buffer.find(SIGNATURE)
        if at < 0:
            self._skip(max(0, len(self._buffer) - len(SIGNATURE) + 1))
            return False
        if at:
            self._skip(at)
        return len(self._buffer) >= HEADER_SIZE

    def _early_header(self, begin: int, end: int) -> int | None:
        """Where another whole header begins before the awaited end, looking at each byte once."""
        at = max(begin, self._searched)
        limit = min(end, len(self._buffer))
        while (at := self._buffer.find(SIGNATURE, at, limit)) >= 0:
            if at + HEADER_SIZE > len(self._buffer):
                self._searched = at
                return None
            if _read_header(self._buffer, at) is not None:
                return at
            at += 1
        self._searched = max(begin, limit - len(SIGNATURE) + 1)
        return None

    def _skip(self, count: int) -> None:
        self.skipped_bytes += count
        self._drop(count)

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self._searched = 0


def _read_header(buffer: bytearray, at: int) -> _Header | None:
    """The header there, or None when its fields cannot be."""
    fields = _LAYOUT.unpack_from(buffer, at)
    _, version, codec, header_size, payload_size, encoded_width, encoded_height, width, height = fields[:9]
    number, timestamp_ms, _, _, frame_type = fields[9:14]
    total_slices, slice_index = fields[18], fields[19]
    plausible = (
        1 <= version <= 9
        and codec <= H264
        and HEADER_SIZE <= header_size <= _MAX_HEADER
        and 0 < payload_size <= MAX_PAYLOAD
        and frame_type <= FrameType.HEADERS
        and 0 < width <= encoded_width + 64
        and 0 < height <= encoded_height + 64
        and encoded_width <= 4096
        and encoded_height <= 4096
    )
    if not plausible:
        return None
    frame = PaveFrame(codec, frame_type, number, timestamp_ms * 1e-3, width, height, slice_index, total_slices, b"")
    return _Header(frame, header_size, payload_size)
