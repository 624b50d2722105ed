"""The video and the camera that a flight looks through."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_plugin.cli.locate import on_square_pixels
from gcs_plugin.locate_session import open_camera
from mission.camera.camera import Camera
from mission.camera.file import write_camera
from mission.camera.mounting import Mounting
from mission.procedure.result import TargetChoice
from mission.records import Box, CameraIntrinsics
from mission.settings import MissionSettings
from mission.video.square import SquareVideo

LENS = CameraIntrinsics(64, 48, 50.0, 50.0, 32.0, 24.0)


@pytest.fixture
def settings(tmp_path: Path) -> MissionSettings:
    """A video of three pictures of 64 x 48 pixels."""
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number:04d}.png"), np.full((48, 64, 3), 40 * number, np.uint8))
    content = {
        "video": {"url": str(tmp_path / "%04d.png")},
        "camera": {"file": str(tmp_path / "camera.toml")},
    }
    return MissionSettings.model_validate(content)


def opened(settings: MissionSettings, tmp_path: Path, lens: CameraIntrinsics) -> tuple[object, Camera, tuple[int, int]]:
    write_camera(tmp_path / "camera.toml", Camera(lens, Mounting.tilted(0.0), calibrated=True))
    source, camera = open_camera(settings, lambda _: None)
    try:
        frame = source.latest(-1, 5.0)
        assert frame is not None
        return source, camera, (frame.image.shape[1], frame.image.shape[0])
    finally:
        source.close()


def test_a_camera_with_square_pixels_is_used_as_it_is(settings: MissionSettings, tmp_path: Path) -> None:
    source, camera, size = opened(settings, tmp_path, LENS)
    assert not isinstance(source, SquareVideo)
    assert camera.intrinsics == LENS
    assert size == (64, 48)


def test_a_squeezed_picture_is_seen_and_marked_with_square_pixels(settings: MissionSettings, tmp_path: Path) -> None:
    source, camera, size = opened(settings, tmp_path, replace(LENS, fx=37.5))
    assert isinstance(source, SquareVideo)
    assert size == (camera.intrinsics.width_px, camera.intrinsics.height_px) == (85, 48)
    marked = on_square_pixels(TargetChoice(Box(32.0, 10.0, 16.0, 20.0), (32.0, 24.0)), source)
    assert marked.point == pytest.approx((42.5, 24.0))
    assert marked.box is not None
    assert marked.box.width_px == pytest.approx(16.0 * 85 / 64)
    assert on_square_pixels(TargetChoice(), source) == TargetChoice()
