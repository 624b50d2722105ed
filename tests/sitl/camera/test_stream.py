"""The video stream: H.264 that comes back as it was, with capture times as presentation times."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from mission.errors import VideoError
from sitl.camera.stream import VideoSender
from sitl.camera.textures import noise
from sitl.scenario.schema import parse_scenario

CAMERA = parse_scenario('name = "a"\n[camera]\nwidth_px = 320\nheight_px = 240\nfps = 20.0').camera


def scene(k: int) -> np.ndarray:
    """A textured picture with a disc that moves 4 px a frame."""
    field = 110.0 + 25.0 * noise(np.random.default_rng(0), 512, 1.2)[:240, :320]
    picture = np.repeat(np.clip(field, 0.0, 255.0).astype(np.uint8)[:, :, None], 3, 2).copy()
    cv2.circle(picture, (40 + 4 * k, 120), 15, (255, 255, 255), -1)
    return picture


def test_pictures_come_back_with_their_capture_times(tmp_path: Path) -> None:
    path = tmp_path / "video.ts"
    times = [0.0, 0.05, 0.10, 0.20, 0.25, 0.30, 0.45]
    sender = VideoSender(str(path), CAMERA)
    for k, t in enumerate(times):
        sender.send(scene(k), t)
    sender.close()
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = list(container.decode(stream))
    assert [frame.time for frame in frames] == pytest.approx(times)
    assert not any(frame.pict_type == av.video.frame.PictureType.B for frame in frames)
    for k, frame in enumerate(frames):
        error = frame.to_ndarray(format="bgr24").astype(float) - scene(k)
        assert float(np.sqrt((error**2).mean())) < 8.0


def test_a_key_frame_comes_every_second(tmp_path: Path) -> None:
    path = tmp_path / "video.ts"
    sender = VideoSender(str(path), CAMERA)
    for k in range(45):
        sender.send(scene(k), k / 20.0)
    sender.close()
    with av.open(str(path)) as container:
        keys = [k for k, frame in enumerate(container.decode(video=0)) if frame.key_frame]
    assert keys == [0, 20, 40]


def test_the_bit_rate_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "video.ts"
    camera = CAMERA.model_copy(update={"bitrate_kbit_s": 600})
    sender = VideoSender(str(path), camera)
    for k in range(60):
        sender.send(scene(k % 10) + np.random.default_rng(k).integers(0, 20, (240, 320, 3), np.uint8), k / 20.0)
    sender.close()
    assert path.stat().st_size * 8 / 3.0 < 1.3 * 600_000


def test_a_muted_sender_sends_nothing(tmp_path: Path) -> None:
    path = tmp_path / "video.ts"
    sender = VideoSender(str(path), CAMERA)
    sender.muted = True
    for k in range(20):
        sender.send(scene(k), k / 20.0)
    sender.close()
    assert path.stat().st_size < 1500


def test_an_impossible_address_is_refused() -> None:
    with pytest.raises(VideoError, match="cannot send video"):
        VideoSender("/no/such/folder/video.ts", CAMERA)
