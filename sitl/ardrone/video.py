"""The live video: H.264 pictures behind PaVE headers on a TCP port, as the configuration asks for them.

A client that reads too slowly gets no backlog: what does not fit its buffer is left out up to the next key frame.
A codec, bitrate, rate or slice count that changes takes effect with the next picture, which is then a key frame.
"""

from __future__ import annotations

import contextlib
import logging
import selectors
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass
from fractions import Fraction

import av
import cv2
import numpy as np
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType, VideoFrame

from mission.errors import VideoError
from mission.records import Image
from sitl.ardrone.pave import HEADER_BYTES, FrameType, Pave, nal_type, nal_units

CLOCK_HZ = 90_000
MOST_WAITING_BYTES = 400_000
"""About a second of video; a slow client loses pictures beyond it."""

_WAKE_S = 0.05
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class VideoFormat:
    """What the configuration says about the live video."""

    height_px: int = 360
    """360 or 720 lines; 16:9."""
    bitrate_kbit_s: int = 1000
    slices: int = 1
    fps: float = 30.0

    @property
    def width_px(self) -> int:
        """640 or 1280."""
        return self.height_px * 16 // 9

    @property
    def encoded_height_px(self) -> int:
        """Lines in the stream, in whole macroblocks: 368 for 360."""
        return -(-self.height_px // 16) * 16


class Encoder:
    """Pictures to PaVE packets."""

    def __init__(self, form: VideoFormat, header_bytes: int = HEADER_BYTES) -> None:
        self.form = form
        self._header_bytes = header_bytes
        self._position = 0
        self._frame_number = 0
        self._codec = _h264(form)

    def reform(self, form: VideoFormat) -> None:
        """Use another format from the next picture on."""
        if form != self.form:
            self.form = form
            self._codec = _h264(form)

    def encode(self, picture: Image, timestamp_s: float, *, key: bool = False) -> tuple[list[bytes], bool]:
        """Encode a picture of any size.

        Args:
            picture: BGR.
            timestamp_s: since the aircraft's start.
            key: make it a key frame.

        Returns:
            The packets, one for each slice, and whether it is a key frame.
        """
        form = self.form
        if picture.shape[:2] != (form.height_px, form.width_px):
            size = (form.width_px, form.height_px)
            picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
        frame = VideoFrame.from_ndarray(np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420), np.uint8), "yuv420p")
        frame.pts, frame.time_base = round(timestamp_s * CLOCK_HZ), Fraction(1, CLOCK_HZ)
        if key:
            frame.pict_type = PictureType.I
        packets = self._codec.encode(frame)
        payload = b"".join(bytes(packet) for packet in packets)
        is_key = any(packet.is_keyframe for packet in packets)
        return self._wrapped(payload, is_key, round(timestamp_s * 1000.0)), is_key

    def _wrapped(self, payload: bytes, is_key: bool, timestamp_ms: int) -> list[bytes]:
        units = nal_units(payload)
        parameters = [unit for unit in units if nal_type(unit) in (7, 8)]
        pictures = [unit for unit in units if nal_type(unit) in (1, 5)]
        sps, pps = (sum(len(unit) for unit in parameters if nal_type(unit) == kind) for kind in (7, 8))
        contents = pictures if self.form.slices > 1 else [b"".join(pictures)]
        contents[0] = b"".join(parameters) + contents[0]
        found = []
        for index, content in enumerate(contents):
            header = Pave(
                payload_bytes=len(content),
                encoded_width_px=self.form.width_px,
                encoded_height_px=self.form.encoded_height_px,
                display_width_px=self.form.width_px,
                display_height_px=self.form.height_px,
                frame_number=self._frame_number,
                timestamp_ms=timestamp_ms,
                frame_type=FrameType.IDR if is_key else FrameType.P,
                stream_position=self._position,
                slices=len(contents),
                slice_index=index,
                sps_bytes=sps if index == 0 else 0,
                pps_bytes=pps if index == 0 else 0,
            )
            found.append(header.pack(self._header_bytes) + content)
            self._position += len(content)
        self._frame_number += 1
        return found


class VideoServer:
    """The video port: sends every picture to every client, key frame first.

    Args:
        host: address to listen on.
        port: 0 takes a free one.
        form: of the pictures, until `reform`.
        header_bytes: length of the PaVE header.
        delay_s: from the end of encoding until a picture is sent.

    Raises:
        VideoError: the port is taken.
    """

    def __init__(
        self, host: str, port: int, form: VideoFormat, header_bytes: int = HEADER_BYTES, *, delay_s: float = 0.0
    ) -> None:
        try:
            self._server = socket.create_server((host, port))
        except OSError as error:
            raise VideoError(f"the video port {host}:{port} cannot be opened: {error}", "use another") from error
        self._server.setblocking(False)
        self._encoder = Encoder(form, header_bytes)
        self._delay_s = delay_s
        self._clients: list[_Client] = []
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self.frames = 0
        self.muted = False
        """While set, pictures are thrown away instead of sent (a cut link)."""
        self._thread = threading.Thread(target=self._serve, name="pave-sender", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._server.getsockname()[1])

    @property
    def clients(self) -> int:
        """How many are connected."""
        with self._lock:
            return len(self._clients)

    def reform(self, form: VideoFormat) -> None:
        """Use another format from the next picture on."""
        self._encoder.reform(form)

    def send(self, picture: Image, timestamp_s: float) -> None:
        """Encode a picture and send it to whoever is there."""
        with self._lock:
            key = any(client.asks_for_key for client in self._clients)
            idle = not self._clients
        self.frames += 1
        if idle:
            return
        packets, is_key = self._encoder.encode(picture, timestamp_s, key=key)
        if self.muted:
            return
        with self._lock:
            for client in self._clients:
                client.offer(packets, is_key, time.monotonic() + self._delay_s)

    def close(self) -> None:
        """Drop all clients and free the port."""
        self._closing.set()
        self._thread.join(2.0)
        self._server.close()

    def _serve(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._server, selectors.EVENT_READ)
            while not self._closing.is_set():
                # Clients whose socket takes more are found by trying: there are one or two.
                if selector.select(0.005 if self._clients else _WAKE_S):
                    self._accept()
                with self._lock:
                    self._clients = [client for client in self._clients if client.flush()]
            for client in self._clients:
                client.close()

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            connection, peer = self._server.accept()
            _log.info("video client %s", peer)
            with self._lock:
                self._clients.append(_Client(connection))


class _Client:
    """A connection and what waits to go out on it."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._size = 0
        self.wants_key = True
        """It has no picture that the next P frame could build on."""

    @property
    def asks_for_key(self) -> bool:
        """Whether a key frame would help it now; one that is stuck must not burden the others."""
        return self.wants_key and self._size < MOST_WAITING_BYTES // 4

    def offer(self, packets: list[bytes], is_key: bool, due_s: float) -> None:
        """Queue a picture, unless it needs one that was left out, or the queue is full."""
        size = sum(len(packet) for packet in packets)
        if (self.wants_key and not is_key) or self._size + size > MOST_WAITING_BYTES:
            self.wants_key = True
            return
        self.wants_key = False
        self._waiting.extend((due_s, packet) for packet in packets)
        self._size += size

    def flush(self) -> bool:
        """Send what the socket takes; False when the client is gone."""
        try:
            while self._waiting and self._waiting[0][0] <= time.monotonic():
                due_s, packet = self._waiting[0]
                sent = self._connection.send(packet)
                self._size -= sent
                if sent < len(packet):
                    self._waiting[0] = (due_s, packet[sent:])
                    return True
                self._waiting.popleft()
        except BlockingIOError:
            return True
        except OSError as error:
            _log.info("video client gone: %s", error)
            self.close()
            return False
        return True

    def close(self) -> None:
        """Hang up."""
        self._connection.close()


def _h264(form: VideoFormat) -> VideoCodecContext:
    codec = av.CodecContext.create("libx264", "w")
    if not isinstance(codec, VideoCodecContext):
        raise VideoError("this FFmpeg has no H.264 encoder", "install PyAV from its wheels")
    codec.width, codec.height, codec.pix_fmt = form.width_px, form.height_px, "yuv420p"
    codec.time_base = Fraction(1, CLOCK_HZ)
    codec.framerate = Fraction(form.fps).limit_denominator(1000)
    rate = form.bitrate_kbit_s * 1000
    codec.bit_rate = rate
    # The baseline profile, without B-frames: the aircraft's encoder knows no other.
    codec.options = {
        "preset": "superfast",
        "tune": "zerolatency",
        "profile": "baseline",
        "g": str(max(1, round(form.fps))),
        "sc_threshold": "0",
        "slices": str(form.slices),
        "threads": "1",
        "maxrate": str(rate),
        "bufsize": str(rate // 2),
    }
    return codec
