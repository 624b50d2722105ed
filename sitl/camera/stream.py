"""The video on the wire: H.264 in MPEG-TS over UDP, as a drone's camera sends it.

Presentation times are capture times (90 kHz) since the stream's start. There are no B-frames and no look-ahead; a key
frame comes about once a second. Packets leave when they are encoded, or later by the scenario's extra latency.
"""

from __future__ import annotations

import heapq
import logging
import threading
import time
from fractions import Fraction

import av
import cv2
import numpy as np
from av.container import OutputContainer
from av.packet import Packet
from av.video.frame import PictureType, VideoFrame
from av.video.stream import VideoStream

from mission.errors import VideoError
from mission.records import Image
from sitl.scenario.schema import CameraSettings

CLOCK_HZ = 90_000

_log = logging.getLogger(__name__)


class VideoSender:
    """Encodes pictures and sends them."""

    def __init__(self, url: str, camera: CameraSettings) -> None:
        """Open the stream.

        Args:
            url: any FFmpeg output, such as ``udp://127.0.0.1:5600``; a file's name records.
            camera: picture size, rate, bit rate, latency.

        Raises:
            VideoError: FFmpeg cannot open the output.
        """
        target = f"{url}?pkt_size=1316" if url.startswith("udp://") and "?" not in url else url
        try:
            self._container: OutputContainer = av.open(
                target, mode="w", format="mpegts", options={"flush_packets": "1", "omit_video_pes_length": "0"}
            )
            self._stream = _h264(self._container, camera)
            self._container.start_encoding()
        except (av.FFmpegError, ValueError) as error:
            raise VideoError(f"cannot send video to {url}: {error}", "check the address") from error
        self._delay_s = camera.extra_latency_ms / 1000.0
        self._waiting: list[tuple[float, int, Packet[VideoStream]]] = []
        self._count = 0
        self._change = threading.Condition()
        self._closing = self._complained = False
        self.muted = False
        """While set, packets are thrown away instead of sent (a cut link)."""
        self._thread = threading.Thread(target=self._send_when_due, name="video-sender", daemon=True)
        self._thread.start()

    def send(self, picture: Image, capture_s: float, *, key: bool = False) -> None:
        """Encode a picture taken `capture_s` after the stream's start, and send it after the extra latency."""
        frame = VideoFrame.from_ndarray(np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420), np.uint8), "yuv420p")
        frame.pts = round(capture_s * CLOCK_HZ)
        frame.time_base = Fraction(1, CLOCK_HZ)
        if key:
            frame.pict_type = PictureType.I
        packets = self._stream.encode(frame)
        due_s = time.monotonic() + self._delay_s
        with self._change:
            for packet in packets:
                self._count += 1
                heapq.heappush(self._waiting, (due_s, self._count, packet))
            self._change.notify()

    def close(self) -> None:
        """Send what waits and close the stream."""
        with self._change:
            self._closing = True
            self._change.notify()
        self._thread.join(timeout=self._delay_s + 5.0)
        try:
            self._container.close()
        except av.FFmpegError as error:
            raise VideoError(f"closing the video stream failed: {error}") from error

    def _send_when_due(self) -> None:
        while True:
            with self._change:
                while not self._waiting and not self._closing:
                    self._change.wait()
                if not self._waiting:
                    return
                wait_s = self._waiting[0][0] - time.monotonic()
                if wait_s > 0.0:
                    self._change.wait(wait_s)
                    continue
                packet = heapq.heappop(self._waiting)[2]
            if self.muted:
                continue
            try:
                self._container.mux(packet)
            except (OSError, av.FFmpegError) as error:
                # Nobody listens on the port yet, or no longer: a camera does not mind, and the packet is lost.
                if not self._complained:
                    _log.info("video packets are not delivered: %s", error)
                self._complained = True


def _h264(container: OutputContainer, camera: CameraSettings) -> VideoStream:
    rate = Fraction(camera.fps).limit_denominator(1000)
    bit_rate = camera.bitrate_kbit_s * 1000
    stream = container.add_stream(
        "libx264",
        rate=rate,
        options={
            "preset": "superfast",
            "tune": "zerolatency",
            "g": str(max(1, round(camera.fps))),
            "bf": "0",
            "threads": "1",
            "maxrate": str(bit_rate),
            "bufsize": str(bit_rate // 2),
        },
    )
    stream.width, stream.height, stream.pix_fmt = camera.width_px, camera.height_px, "yuv420p"
    stream.bit_rate = bit_rate
    stream.codec_context.time_base = Fraction(1, CLOCK_HZ)
    stream.time_base = Fraction(1, CLOCK_HZ)
    return stream
