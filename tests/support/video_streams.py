"""Video made in the test: a picture that carries its own number, as MPEG-TS over UDP or as a file."""

from __future__ import annotations

import socket
import threading
import time
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from mission.records import Image

WIDTH, HEIGHT = 320, 240
_BITS = 16
_TICKS = 90000


def numbered(index: int) -> Image:
    """A textured picture with `index` as black and white blocks in its first rows."""
    image = np.random.default_rng(5).integers(60, 200, (HEIGHT // 16, WIDTH // 16, 3)).astype(np.uint8)
    image = np.roll(image.repeat(16, 0).repeat(16, 1), index * 2, axis=1)
    for bit in range(_BITS):
        image[:24, bit * 20 : (bit + 1) * 20] = 255 if index >> bit & 1 else 0
    return image


def number(image: Image) -> int:
    blocks = [image[6:18, bit * 20 + 5 : bit * 20 + 15].mean() for bit in range(_BITS)]
    return sum(1 << bit for bit, value in enumerate(blocks) if value > 128)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Sender:
    """Sends numbered pictures in real time until stopped."""

    def __init__(self, port: int, fps: float = 20.0, first: int = 0, first_pts_s: float = 0.0, gop: int = 5) -> None:
        self.sent_s: dict[int, float] = {}
        self._port, self._fps, self._first, self._first_pts_s, self._gop = port, fps, first, first_pts_s, gop
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()

    def __enter__(self) -> Sender:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _run(self) -> None:
        url = f"udp://127.0.0.1:{self._port}?pkt_size=1316"
        with av.open(url, "w", format="mpegts", options={"omit_video_pes_length": "0"}) as container:
            stream = container.add_stream("libx264", rate=round(self._fps))
            stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
            stream.codec_context.time_base = Fraction(1, _TICKS)
            stream.options = {"preset": "ultrafast", "tune": "zerolatency", "g": str(self._gop), "crf": "25"}
            began = time.monotonic()
            index = 0
            while not self._stop.wait(max(0.0, began + index / self._fps - time.monotonic())):
                now = time.monotonic()
                frame = av.VideoFrame.from_ndarray(numbered(self._first + index), format="bgr24")
                frame.pts = round((self._first_pts_s + now - began) * _TICKS)
                frame.time_base = Fraction(1, _TICKS)
                self.sent_s[self._first + index] = now
                container.mux(stream.encode(frame))
                index += 1


def write_file(path: Path, frames: int, fps: int = 20) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=fps)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for index in range(frames):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(numbered(index), format="bgr24")))
        container.mux(stream.encode(None))
    return path
