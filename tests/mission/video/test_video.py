import logging
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from mission.errors import VideoError
from mission.records import Frame
from mission.video import VideoSource, VideoState, open_video
from mission.video.ffmpeg import is_live
from tests.support.video_streams import Sender, free_port, number, numbered, write_file


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_file(tmp_path_factory.mktemp("video") / "flight.mp4", 40)


def taken(video: VideoSource, count: int, timeout_s: float = 5.0) -> Iterator[Frame]:
    index = -1
    for _ in range(count):
        frame = video.latest(index, timeout_s)
        assert frame is not None, video.stats()
        index = frame.index
        yield frame


def until(video: VideoSource, state: VideoState, timeout_s: float = 10.0) -> None:
    end = time.monotonic() + timeout_s
    while video.stats().state is not state:
        assert time.monotonic() < end, video.stats()
        time.sleep(0.02)


def test_a_live_stream_shows_the_pictures_sent_at_the_times_they_were_taken() -> None:
    port = free_port()
    with Sender(port) as sender:
        video = open_video(f"udp://127.0.0.1:{port}")
        try:
            frames = [(number(frame.image), frame.t_s) for frame in taken(video, 40)]
        finally:
            video.close()
    assert [count for count, _ in frames] == sorted({count for count, _ in frames})
    delays = np.array([t_s - sender.sent_s[count] for count, t_s in frames])[10:]
    # A constant delay (encoder, demuxer: it is what `latency_s` is for), the same for all frames within milliseconds.
    assert 0.0 < np.median(delays) < 0.3
    assert np.ptp(delays) < 0.02
    assert np.std(delays) < 0.005


def test_a_consumer_that_lags_gets_the_newest_frame_and_the_rest_is_counted(recording: Path) -> None:
    port = free_port()
    with Sender(port) as sender:
        video = open_video(f"udp://127.0.0.1:{port}")
        try:
            first = video.latest(-1, 5.0)
            assert first is not None
            time.sleep(0.6)
            late = video.latest(first.index, 1.0)
            assert late is not None
            stats = video.stats()
            newest = max(sender.sent_s)
        finally:
            video.close()
    assert late.index - first.index >= 4
    assert stats.dropped >= late.index - first.index - 1
    assert newest - number(late.image) <= 8
    assert stats.state is VideoState.PLAYING
    assert stats.fps > 5.0
    assert 0.0 < stats.decode_s < 0.05


def test_a_stream_that_stops_is_noticed_and_one_that_comes_back_is_taken_up() -> None:
    port = free_port()
    sender = Sender(port)
    video = open_video(f"udp://127.0.0.1:{port}", stall_s=0.5)
    try:
        before = list(taken(video, 5))
        sender.stop()
        index = before[-1].index
        while (frame := video.latest(index, 0.4)) is not None:
            index = frame.index
        until(video, VideoState.RECONNECTING)
        kept_back = video.latest(index, 0.0)
        index = index if kept_back is None else kept_back.index
        stopped = video.stats()
        assert stopped.last_frame_age_s is not None
        assert stopped.last_frame_age_s > 0.4
        assert "No video arrives" in stopped.error
        # Another run of the encoder: its clock starts somewhere else.
        sender = Sender(port, first=1000, first_pts_s=5000.0)
        frame = video.latest(index, 8.0)
        assert frame is not None
        assert number(frame.image) >= 1000
        assert abs(frame.t_s - time.monotonic()) < 0.5
        assert (video.stats().reconnects, video.stats().error) == (1, "")
    finally:
        sender.stop()
        video.close()


def test_garbage_on_the_port_is_survived_and_named() -> None:
    port = free_port()
    stop = threading.Event()

    def shout() -> None:
        rng = np.random.default_rng(0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not stop.wait(0.002):
                out.sendto(rng.bytes(1316), ("127.0.0.1", port))

    noise = threading.Thread(target=shout)
    noise.start()
    try:
        with pytest.raises(VideoError) as caught:
            open_video(f"udp://127.0.0.1:{port}", open_timeout_s=2.0)
        assert str(port) in caught.value.cause
        assert caught.value.remedy
    finally:
        stop.set()
        noise.join()


def test_garbage_in_the_middle_of_a_stream_does_not_end_it() -> None:
    port = free_port()
    with Sender(port), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        video = open_video(f"udp://127.0.0.1:{port}")
        try:
            index = max(frame.index for frame in taken(video, 5))
            rng = np.random.default_rng(0)
            for _ in range(50):
                out.sendto(rng.bytes(1316), ("127.0.0.1", port))
            later = [frame for frame in taken(video, 30) if frame.index > index]
            assert len(later) >= 20
            assert all(np.isfinite(frame.t_s) for frame in later)
            assert np.all(np.diff([frame.t_s for frame in later]) > 0.0)
        finally:
            video.close()


def test_nothing_on_the_port_is_an_error_that_helps() -> None:
    with pytest.raises(VideoError, match="No video arrives") as caught:
        open_video(f"udp://127.0.0.1:{free_port()}", open_timeout_s=0.5)
    assert "sends to this address" in caught.value.remedy


def test_closing_does_not_wait_for_a_stream_that_hangs() -> None:
    port = free_port()
    sender = Sender(port)
    video = open_video(f"udp://127.0.0.1:{port}", stall_s=5.0)
    sender.stop()
    began = time.monotonic()
    video.close()
    video.close()
    assert time.monotonic() - began < 2.0
    assert video.stats().state is VideoState.CLOSED
    assert video.latest(10**6, 5.0) is None


def test_a_waiting_consumer_is_released_by_close(recording: Path) -> None:
    video = open_video(str(recording), pace="consumed")
    got: list[Frame | None] = []
    waiting = threading.Thread(target=lambda: got.append(video.latest(10**6, 30.0)))
    waiting.start()
    video.close()
    waiting.join(5.0)
    assert got == [None]


def test_a_file_as_fast_as_consumed_loses_no_frame(recording: Path) -> None:
    video = open_video(str(recording), pace="consumed", start_s=100.0)
    try:
        frames = list(taken(video, 40))
        assert [number(frame.image) for frame in frames] == list(range(40))
        np.testing.assert_allclose([frame.t_s for frame in frames], 100.0 + np.arange(40) / 20.0, atol=1e-3)
        assert video.latest(frames[-1].index, 2.0) is None
        stats = video.stats()
        assert (stats.state, stats.dropped, stats.decoded, stats.error) == (VideoState.ENDED, 0, 40, "")
    finally:
        video.close()


def test_a_file_in_real_time_takes_its_time_and_drops_what_nobody_takes(recording: Path) -> None:
    began = time.monotonic()
    video = open_video(str(recording))
    try:
        until(video, VideoState.ENDED)
        assert 1.8 < time.monotonic() - began < 8.0
        last = video.latest(-1, 0.0)
        assert last is not None
        assert number(last.image) == 39
        assert video.stats().dropped == 39
    finally:
        video.close()


def test_a_folder_of_pictures_is_a_video(tmp_path: Path) -> None:
    for index in range(6):
        cv2.imwrite(str(tmp_path / f"{index:04d}.png"), numbered(index))
    video = open_video(str(tmp_path / "%04d.png"), pace="consumed", start_s=0.0, options={"framerate": "10"})
    try:
        frames = list(taken(video, 6))
    finally:
        video.close()
    assert [number(frame.image) for frame in frames] == list(range(6))
    np.testing.assert_allclose([frame.t_s for frame in frames], np.arange(6) / 10.0, atol=1e-6)
    np.testing.assert_array_equal(frames[3].image, numbered(3))


def test_a_truncated_file_plays_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = write_file(tmp_path / "whole.ts", 60)
    data = whole.read_bytes()
    (tmp_path / "part.ts").write_bytes(data[: len(data) // 2])
    video = open_video(str(tmp_path / "part.ts"), pace="consumed")
    count, index = 0, -1
    while (frame := video.latest(index, 2.0)) is not None:
        count, index = count + 1, frame.index
    video.close()
    assert 5 < count < 60


@pytest.mark.parametrize(
    ("url", "cause"),
    [
        ("nowhere/none.mp4", "does not exist"),
        ("nowhere/%04d.png", "folder does not exist"),
        ("strange://127.0.0.1/x", "does not know how to read"),
    ],
)
def test_what_cannot_be_opened_is_explained(url: str, cause: str) -> None:
    with pytest.raises(VideoError, match=cause):
        open_video(url, open_timeout_s=1.0)


def test_a_file_that_is_no_video_is_explained(tmp_path: Path) -> None:
    (tmp_path / "notes.mp4").write_text("not a video" * 100)
    with pytest.raises(VideoError, match="is not a video"):
        open_video(str(tmp_path / "notes.mp4"))


def test_a_refused_connection_is_explained_without_the_password(caplog: pytest.LogCaptureFixture) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    caplog.set_level(logging.DEBUG)
    with pytest.raises(VideoError, match="Nothing listens") as caught:
        open_video(f"rtsp://pilot:secret@127.0.0.1:{port}/live", open_timeout_s=1.0)
    assert "secret" not in str(caught.value) + caplog.text
    assert f"rtsp://***@127.0.0.1:{port}/live" in str(caught.value)


def test_urls_are_told_apart() -> None:
    assert is_live("rtsp://camera/1")
    assert is_live("session.sdp")
    assert not is_live("file:///flight.mp4")
    assert not is_live("flight.mp4")


def pictures(folder: Path, *sizes: tuple[int, int]) -> str:
    for count, (width, height) in enumerate(sizes, 1):
        image = cv2.resize(numbered(count), (width, height))
        assert cv2.imwrite(str(folder / f"{count:04d}.png"), image)
    return str(folder / "%04d.png")


def test_a_picture_of_another_size_is_scaled_back_and_told(tmp_path: Path) -> None:
    video = open_video(pictures(tmp_path, (320, 240), (320, 240), (160, 120), (160, 120)), pace="consumed")
    try:
        frames = list(taken(video, 4))
        assert {frame.image.shape for frame in frames} == {(240, 320, 3)}
        assert "changed from 320 x 240 to 160 x 120 pixels: it is scaled back" in video.stats().note
    finally:
        video.close()


def test_a_picture_of_another_shape_ends_the_video(tmp_path: Path) -> None:
    video = open_video(pictures(tmp_path, (320, 240), (320, 240), (320, 180), (320, 180)), pace="consumed")
    try:
        list(taken(video, 2))
        until(video, VideoState.ENDED)
        assert "changed from 320 x 240 to 320 x 180" in video.stats().error
    finally:
        video.close()
