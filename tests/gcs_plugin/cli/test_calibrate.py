import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from gcs_plugin.cli import calibrate as command
from mission.camera import Camera, read_camera, write_camera
from mission.errors import CalibrationError, LinkError, SettingsError
from mission.timing.time_offset import TimeOffset
from tests.support import boards


def run(*arguments: str) -> Result:
    app = typer.Typer()
    command.register(app)
    return CliRunner().invoke(app, ["calibrate", *arguments])


def test_theta_writes_the_papers_camera(tmp_path: Path) -> None:
    output = tmp_path / "camera.toml"
    size = ["--width", "640", "--height", "480", "--tilt-down-deg", "15"]
    done = run("theta", "--depth-m", "0.92", "--side-m", "0.57", "--pixels", "320", *size, "--output", str(output))
    assert done.exit_code == 0, done.output
    assert "f 516.5 px" in done.output
    camera = read_camera(output)
    assert camera.intrinsics.fx == pytest.approx(516.5, abs=0.05)
    assert math.degrees(camera.mounting.tilt_down_rad) == pytest.approx(15.0)


def test_board_writes_a_camera_and_tells_what_became_of_each_picture(tmp_path: Path) -> None:
    for name, image in boards.pictures(boards.charuco(), 12, np.random.default_rng(3)):
        cv2.imwrite(str(tmp_path / name), image)
    output = tmp_path / "camera.toml"
    size = ["--columns", "9", "--rows", "7", "--square-mm", "30", "--charuco", "DICT_5X5_100", "--marker-mm", "22"]
    done = run("board", str(tmp_path), *size, "--output", str(output))
    assert done.exit_code == 0, done.output
    assert "view00.png" in done.output
    camera = read_camera(output)
    assert camera.calibrated
    assert camera.intrinsics.fx == pytest.approx(boards.LENS.fx, rel=0.01)
    assert "ChArUco" in camera.provenance


def test_board_refuses_what_is_missing(tmp_path: Path) -> None:
    size = ["--columns", "9", "--rows", "7", "--square-mm", "30", "--output", str(tmp_path / "camera.toml")]
    assert isinstance(run("board", str(tmp_path / "none"), *size).exception, CalibrationError)
    assert isinstance(run("board", str(tmp_path), *size, "--charuco", "DICT_5X5_100").exception, SettingsError)
    assert not (tmp_path / "camera.toml").exists()


class NoDrone:
    """A link that answers, or does not."""

    closed = 0
    fails = False

    def __init__(self, url: str, camera: Camera) -> None:
        self.url = url

    def connect(self, timeout_s: float) -> None:
        if self.fails:
            raise LinkError("No heartbeat")

    def close(self) -> None:
        NoDrone.closed += 1


class NoVideo:
    def latest(self, after_index: int, timeout_s: float) -> None:
        return None

    def close(self) -> None: ...


def test_latency_adds_what_was_measured_to_the_camera_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "camera.toml"
    write_camera(path, Camera.from_field_of_view(640, 480, 1.2, latency_s=0.05))
    monkeypatch.setattr(command, "make_drone", NoDrone)
    monkeypatch.setattr(command, "open_video", lambda *_, **__: NoVideo())
    monkeypatch.setattr(command, "measure_latency", lambda *_, **__: TimeOffset(0.1234, 0.004, 0.7, 1.3))
    arguments = ["latency", "--drone", "udp://:14540", "--video", "udp://:5600", "--camera", str(path)]
    done = run(*arguments)
    assert done.exit_code == 0, done.output
    assert read_camera(path).latency_s == pytest.approx(0.1734)
    assert "173 ms" in done.output
    assert "focal length is wrong" in done.output
    closed = NoDrone.closed
    monkeypatch.setattr(NoDrone, "fails", True)
    assert isinstance(run(*arguments).exception, LinkError)
    assert NoDrone.closed == closed + 1
    assert read_camera(path).latency_s == pytest.approx(0.1734)
