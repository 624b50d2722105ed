"""A stream's packets are kept as they came, from the last key frame on, and nobody waits for the disk."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest

from mission.observation.file_video import FileVideo
from mission.records import Image
from mission.video.background_writer import BackgroundWriter
from mission.video.recorder import PacketRecorder, Recording
from sitl.recorded.video_file import write_video


def pictures() -> Iterator[Image]:
    rng = np.random.default_rng(0)
    background = rng.integers(0, 255, (48, 64, 3), dtype=np.uint8)
    for k in range(60):
        yield np.roll(background, k, axis=1)


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "a.mp4"
    write_video(path, pictures(), 20.0)
    return path


def recorded(film: Path, out: Path, start_at: int, max_bytes: int = 10_000_000) -> Recording | None:
    recorder = PacketRecorder()
    with av.open(str(film)) as container:
        stream = container.streams.video[0]
        recorder.new_stream()
        for number, packet in enumerate(container.demux(stream)):
            if number == start_at:
                recorder.start(out, max_bytes)
            recorder.take(packet, stream, number)
            packet.decode()  # as a source does, after it was taken
        return recorder.stop()


def content(path: Path) -> list[bytes]:
    return [picture.frame().image.tobytes() for picture in FileVideo(path).pictures()]


@pytest.mark.parametrize("start_at", [0, 7, 33])
def test_the_same_pictures_from_the_key_frame_before(start_at: int, film: Path, tmp_path: Path) -> None:
    kept = recorded(film, tmp_path / "a.ts", start_at)
    assert kept is not None
    assert kept.why == ""
    with av.open(str(film)) as container:
        keys = [n for n, packet in enumerate(container.demux(container.streams.video[0])) if packet.is_keyframe]
    assert kept.first_index == max(key for key in keys if key <= start_at)
    assert content(tmp_path / "a.ts") == content(film)[kept.first_index :]


def test_bounded(film: Path, tmp_path: Path) -> None:
    kept = recorded(film, tmp_path / "a.ts", 0, max_bytes=10_000)
    assert kept is not None
    assert "reached" in kept.why
    assert kept.bytes <= 10_000
    assert 2 <= len(content(tmp_path / "a.ts")) < 60


def test_a_folder_that_cannot_be_written(film: Path, tmp_path: Path) -> None:
    kept = recorded(film, tmp_path / "none" / "a.ts", 0)
    assert kept is None or kept.why


def test_nothing_without_a_start(film: Path) -> None:
    recorder = PacketRecorder()
    assert recorder.stop() is None


def test_the_writer_gives_up_for_good() -> None:
    done: list[int] = []

    def full() -> None:
        raise OSError(28, "No space left on device")

    writer = BackgroundWriter("test")
    writer.put(lambda: done.append(1))
    writer.put(full)
    writer.put(lambda: done.append(2))
    writer.close()
    assert writer.failed == "No space left on device"
    assert done[0] == 1
    writer.put(lambda: done.append(3))
    assert 3 not in done
