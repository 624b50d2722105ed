"""The AR.Drone's video over a real socket: pictures, times, what is dropped when behind, damage, and a break."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction

import av
import numpy as np
import pytest
from av.video.codeccontext import VideoCodecContext

from mission.errors import VideoError
from mission.vehicle.ardrone.pave import FrameType, PaveFrame
from mission.video import VideoSource, VideoState, open_video
from mission.video.ardrone import BEHIND, MOST_WAITING, Arrived, FrameQueue

WIDTH, HEIGHT, GROUP, FRAMES = 320, 180, 10, 60
STEP_MS = 33


def _pave(number: int, payload: bytes, key: bool) -> bytes:
    """A header as `video_encapsulation.h` lays it out, written field by field."""
    parts = (
        (b"PaVE", bytes([3, 4]), (64).to_bytes(2, "little"), len(payload).to_bytes(4, "little")),
        tuple(size.to_bytes(2, "little") for size in (WIDTH, 192, WIDTH, HEIGHT)),
        (number.to_bytes(4, "little"), (number * STEP_MS).to_bytes(4, "little"), bytes([1, 0, 1 if key else 3, 0])),
        (bytes(8), (1).to_bytes(2, "little"), bytes([1, 0, 0, 0]), bytes(2), bytes(4), bytes(12)),
    )
    return b"".join(part for line in parts for part in line) + payload


def _level(number: int) -> int:
    return 20 + 3 * number


@pytest.fixture(scope="module")
def stream() -> list[bytes]:
    """60 frames, each of one grey level that tells its number; a key frame at every tenth."""
    encoder = av.CodecContext.create("libx264", "w")
    assert isinstance(encoder, VideoCodecContext)
    encoder.width, encoder.height, encoder.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    encoder.framerate = Fraction(30)
    encoder.gop_size = GROUP
    encoder.options = {"preset": "ultrafast", "tune": "zerolatency", "profile": "baseline"}
    found: list[bytes] = []
    for number in range(FRAMES):
        picture = av.VideoFrame.from_ndarray(np.full((HEIGHT, WIDTH, 3), _level(number), np.uint8), format="bgr24")
        picture.pts = number
        found += [_pave(number, bytes(p), p.is_keyframe) for p in encoder.encode(picture)]
    assert len(found) == FRAMES
    return found


@dataclass
class Sender:
    """A drone's video port; each connection is handed to `serve`."""

    serve: Callable[[socket.socket, int], None]
    connections: int = 0
    listener: socket.socket = field(default_factory=lambda: socket.create_server(("127.0.0.1", 0)))

    def __post_init__(self) -> None:
        self.stopping = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    @property
    def url(self) -> str:
        return f"ardrone://127.0.0.1?video={self.listener.getsockname()[1]}"

    def paced(self, connection: socket.socket, pieces: list[bytes], every_s: float = STEP_MS / 1000.0) -> None:
        """Send one piece after the other."""
        for piece in pieces:
            if self.stopping.wait(every_s):
                return
            connection.sendall(piece)

    def stop(self) -> None:
        self.stopping.set()
        self.listener.close()
        self.thread.join(2.0)

    def _run(self) -> None:
        self.listener.settimeout(0.1)
        while not self.stopping.is_set():
            try:
                connection, _ = self.listener.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            self.connections += 1
            with connection:
                try:
                    self.serve(connection, self.connections)
                except OSError:
                    continue


@pytest.fixture
def play() -> Iterator[Callable[..., tuple[Sender, VideoSource]]]:
    opened: list[tuple[Sender, VideoSource | None]] = []

    def start(
        serve: Callable[[Sender, socket.socket, int], None], query: str = "", stall_s: float = 0.5
    ) -> tuple[Sender, VideoSource]:
        sender = Sender(lambda connection, number: serve(sender, connection, number))
        opened.append((sender, None))
        source = open_video(sender.url + query, open_timeout_s=5.0, stall_s=stall_s)
        opened[-1] = (sender, source)
        return sender, source

    yield start
    for sender, source in opened:
        if source is not None:
            source.close()
        sender.stop()


def _number(image: np.ndarray) -> int:
    return round((float(image.mean()) - _level(0)) / 3.0)


def test_pictures_come_with_the_drones_times(
    play: Callable[..., tuple[Sender, VideoSource]], stream: list[bytes]
) -> None:
    _, source = play(lambda sender, connection, _: sender.paced(connection, stream))
    seen: list[tuple[int, float]] = []
    index = -1
    while len(seen) < 20:
        frame = source.latest(index, 1.0)
        assert frame is not None
        assert frame.image.shape == (HEIGHT, WIDTH, 3)
        index = frame.index
        seen.append((_number(frame.image), frame.t_s))
    numbers = np.array([n for n, _ in seen])
    assert (np.diff(numbers) > 0).all()
    spacing = np.diff([t for _, t in seen]) / np.diff(numbers)
    assert np.median(spacing) == pytest.approx(STEP_MS / 1000.0, abs=0.002)
    assert abs(seen[-1][1] - time.monotonic()) < 0.5
    assert source.stats().state is VideoState.PLAYING


def test_pictures_are_scaled_as_asked(play: Callable[..., tuple[Sender, VideoSource]], stream: list[bytes]) -> None:
    _, source = play(lambda sender, connection, _: sender.paced(connection, stream), "&size=160x120")
    frame = source.latest(-1, 1.0)
    assert frame is not None
    assert frame.image.shape == (120, 160, 3)


def test_a_damaged_frame_is_not_shown_and_the_next_key_frame_heals(
    play: Callable[..., tuple[Sender, VideoSource]], stream: list[bytes]
) -> None:
    broken = list(stream)
    broken[12] = stream[12][:40] + stream[12][70:]  # the header's end and the picture's begin are missing
    broken[33] = b"rubbish" * 20
    _, source = play(lambda sender, connection, _: sender.paced(connection, broken))
    numbers: list[int] = []
    index = -1
    while not numbers or numbers[-1] < 50:
        frame = source.latest(index, 1.0)
        assert frame is not None, numbers
        index = frame.index
        numbers.append(_number(frame.image))
        assert abs(float(frame.image.mean()) - _level(numbers[-1])) < 1.5, "a whole picture of one level"
    assert {20, 40} & set(numbers)
    assert source.stats().damaged > 0


def test_it_connects_again_and_goes_on(play: Callable[..., tuple[Sender, VideoSource]], stream: list[bytes]) -> None:
    def serve(sender: Sender, connection: socket.socket, number: int) -> None:
        sender.paced(connection, stream[:15] if number == 1 else stream)

    sender, source = play(serve)
    until = time.monotonic() + 5.0
    while source.stats().reconnects == 0:
        assert time.monotonic() < until
        source.latest(10**9, 0.02)
    assert sender.connections == 2
    assert source.latest(-1, 1.0) is not None


def test_a_silent_drone_is_connected_anew(play: Callable[..., tuple[Sender, VideoSource]], stream: list[bytes]) -> None:
    def serve(sender: Sender, connection: socket.socket, number: int) -> None:
        sender.paced(connection, stream[:15] if number == 1 else stream)
        if number == 1:
            sender.stopping.wait(0.6)

    sender, source = play(serve, stall_s=0.3)
    until = time.monotonic() + 5.0
    while source.stats().reconnects == 0:
        assert time.monotonic() < until
        source.latest(10**9, 0.02)
    assert sender.connections >= 2


def test_nobody_there_is_said_with_a_remedy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(VideoError, match="No video from the AR") as caught:
        open_video(f"ardrone://127.0.0.1?video={port}", open_timeout_s=0.4)
    assert caught.value.remedy


def _arrived(number: int, key: bool) -> Arrived:
    kind = FrameType.IDR if key else FrameType.P
    return Arrived(PaveFrame(4, kind, number, number * 0.033, WIDTH, HEIGHT, 0, 1, b"x"), number * 0.033)


def _drain(queue: FrameQueue) -> list[int]:
    found = []
    while (arrived := queue.take(0.0)) is not None:
        found.append(arrived.frame.number)
    return found


def test_behind_it_goes_on_at_the_newest_key_frame() -> None:
    queue = FrameQueue()
    for number in range(26):
        queue.put(_arrived(number, number % GROUP == 0))
    assert _drain(queue) == [20, 21, 22, 23, 24, 25]
    assert queue.dropped == 20


def test_not_behind_nothing_is_dropped() -> None:
    queue = FrameQueue()
    shown: list[int] = []
    for number in range(26):
        queue.put(_arrived(number, number % GROUP == 0))
        if number % BEHIND == BEHIND - 1:
            shown += _drain(queue)
    assert shown + _drain(queue) == list(range(26))


def test_the_queue_is_bounded_without_any_key_frame() -> None:
    queue = FrameQueue()
    queue.put(_arrived(0, True))
    for number in range(1, 10 * MOST_WAITING):
        queue.put(_arrived(number, False))
    assert len(_drain(queue)) <= MOST_WAITING
    queue.put(_arrived(9999, True))
    assert _drain(queue) == [9999]


def test_nothing_before_the_first_key_frame() -> None:
    queue = FrameQueue()
    for number in range(5, 14):
        queue.put(_arrived(number, number % GROUP == 0))
    assert _drain(queue) == [10, 11, 12, 13]
