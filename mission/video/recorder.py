"""Keeps a stream's video as it is received: packets into a transport stream, not decoded and encoded again.

A transport stream is whole at every moment, so that a program that is killed loses the last packets only. Until a
recording begins, the packets since the last key frame are kept in memory, so that it can begin at once.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Protocol, cast

import av
from av.packet import Packet
from av.video.stream import VideoStream

from mission.video.background_writer import BackgroundWriter

MOST_WAITING_BYTES = 8_000_000
"""Since the last key frame; with more, a recording begins at the next one."""
_SPS = frozenset({7, 33})
"""NAL unit types of parameter sets: H.264's, HEVC's."""


class Recordable(Protocol):
    """A video source whose stream can be kept."""

    def start_recording(self, path: Path, max_bytes: int) -> None:
        """Keep what comes from the last key frame on."""
        ...

    def stop_recording(self) -> Recording | None:
        """End; what was kept, None where nothing was."""
        ...


class Recording:
    """What was kept.

    Args:
        path: of the transport stream.
        first_index: number of the frame that its first picture is.
    """

    def __init__(self, path: Path, first_index: int) -> None:
        self.path = path
        self.first_index = first_index
        self.bytes = 0
        self.why = ""
        """Why it ended before it was stopped; empty where it did not."""


class PacketRecorder:
    """Called by the decoder's thread with each packet; the files are written in another."""

    def __init__(self, writer: Callable[[str], BackgroundWriter] = BackgroundWriter) -> None:
        self._make_writer = writer
        self._waiting: list[Packet[VideoStream]] = []
        self._waiting_bytes = 0
        self._key_index: int | None = None
        self._wanted: tuple[Path, int] | None = None
        self._recording: Recording | None = None
        self._most = 0
        self._writer: BackgroundWriter | None = None
        self._output: _Output | None = None

    def new_stream(self) -> None:
        """The stream was opened anew: what is kept ends here, what waits is of no use."""
        self._waiting, self._waiting_bytes, self._key_index = [], 0, None
        if self._recording is not None and not self._recording.why:
            self._recording.why = "the stream was interrupted"

    def take(self, packet: Packet[VideoStream], stream: VideoStream, decoded: int) -> None:
        """A packet that is about to be decoded.

        Args:
            packet: as demuxed; it is copied.
            stream: that it is of.
            decoded: number of pictures that came before it.
        """
        if packet.size == 0:
            return
        if packet.is_keyframe:
            self._waiting, self._waiting_bytes, self._key_index = [], 0, decoded
        if self._recording is None and self._key_index is not None:
            self._waiting.append(_copied(packet, stream))
            self._waiting_bytes += packet.size
            if self._waiting_bytes > MOST_WAITING_BYTES:
                self._waiting, self._waiting_bytes, self._key_index = [], 0, None
        wanted = self._wanted
        if wanted is not None and self._recording is None and self._key_index is not None:
            self._begin(*wanted, stream)
        elif self._recording is not None:
            self._keep(_copied(packet, stream))

    def start(self, path: Path, max_bytes: int) -> None:
        """Record from the last key frame on; from any thread."""
        self._recording, self._output = None, None
        self._wanted = path, max_bytes

    def stop(self) -> Recording | None:
        """End; from any thread. Waits until the file is whole, some seconds at most."""
        self._wanted = None
        recording, output, writer = self._recording, self._output, self._writer
        self._recording = self._output = self._writer = None
        if recording is None or output is None or writer is None:
            return None
        writer.close(output.close)
        recording.why = recording.why or writer.failed
        return recording

    def _begin(self, path: Path, max_bytes: int, stream: VideoStream) -> None:
        assert self._key_index is not None
        self._wanted = None
        self._most = max_bytes
        recording = Recording(path, self._key_index)
        self._writer = self._make_writer("the video")
        self._recording = recording
        try:
            self._output = _Output(path, stream)
        except (OSError, ValueError) as error:
            recording.why = f"it cannot be kept ({error})"
            return
        waiting, self._waiting, self._waiting_bytes = self._waiting, [], 0
        for packet in waiting:
            self._keep(packet)

    def _keep(self, packet: Packet[VideoStream]) -> None:
        recording, writer, output = self._recording, self._writer, self._output
        if recording is None or writer is None or output is None or recording.why:
            return
        if recording.bytes + packet.size > self._most:
            recording.why = f"it reached {self._most / 1e6:.0f} MB"
            return
        recording.bytes += packet.size
        writer.put(lambda: output.mux(packet))


class _Output:
    """The file; written and closed by the writer's thread."""

    def __init__(self, path: Path, stream: VideoStream) -> None:
        self._container = av.open(str(path), "w", format="mpegts", options={"flush_packets": "1"})
        self._out = self._container.add_stream_from_template(stream)

    def mux(self, packet: Packet[VideoStream]) -> None:
        packet.stream = self._out
        self._container.mux(packet)

    def close(self) -> None:
        self._container.close()


def _copied(packet: Packet[VideoStream], stream: VideoStream) -> Packet[VideoStream]:
    """Of its own memory: muxing changes a packet, and decoding needs it as it was.

    A stream that tells its parameter sets beside the pictures (RTSP) gets them before each key frame.
    """
    content = bytes(packet)
    context = stream.codec_context
    extra = None if context is None else context.extradata
    if packet.is_keyframe and extra and extra.startswith(b"\x00\x00") and not _has_parameters(content):
        content = extra + content
    copy = cast("Packet[VideoStream]", Packet(content))
    copy.pts, copy.dts = packet.pts, packet.dts if packet.dts is not None else packet.pts
    copy.time_base = packet.time_base or Fraction(1, 90000)
    copy.is_keyframe = packet.is_keyframe
    return copy


def _has_parameters(content: bytes) -> bool:
    at = content.find(b"\x00\x00\x01")
    while 0 <= at < len(content) - 4:
        first = content[at + 3]
        if first & 0x1F in _SPS or first >> 1 & 0x3F in _SPS:
            return True
        at = content.find(b"\x00\x00\x01", at + 3)
        if at > 4096:
            return False
    return False
