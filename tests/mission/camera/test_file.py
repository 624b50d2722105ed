import math
from dataclasses import replace
from pathlib import Path

import pytest

from mission.camera import Camera, CameraModel, Mounting, read_camera, write_camera
from mission.errors import CalibrationError, CalibrationInputError
from mission.records import CameraIntrinsics, NoiseModel

LENS = CameraIntrinsics(640, 480, 516.5, 517.25, 318.0, 243.5, (-0.1, 0.02, 1e-4, -2e-5, 0.0))
CAMERA = Camera(LENS, Mounting.tilted(0.3, (0.1, 0.0, 0.02)), True, 0.025, 0.12, 0.004, 'a "board", 12 pictures\nü \\')

GOOD = """
format = "sidestep-camera"
version = 1
calibrated = true
[intrinsics]
width_px = 640
height_px = 480
fx = 516.5
fy = 516.5
cx = 320
cy = 240.0
[mounting]
tilt_down_deg = 20.0
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "camera.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_was_written_is_read_again(tmp_path: Path) -> None:
    write_camera(tmp_path / "camera.toml", CAMERA)
    assert read_camera(tmp_path / "camera.toml") == CAMERA
    assert [path.name for path in tmp_path.iterdir()] == ["camera.toml"]


def test_a_file_by_hand_may_give_the_tilt_and_leave_out_what_has_a_default(tmp_path: Path) -> None:
    camera = read_camera(written(tmp_path, GOOD))
    assert math.degrees(camera.mounting.tilt_down_rad) == pytest.approx(20.0)
    assert camera.intrinsics.distortion == (0.0, 0.0, 0.0, 0.0, 0.0)
    assert (camera.calibrated, camera.latency_s, camera.readout_s, camera.focal_sigma) == (True, 0.0, 0.0, 0.003)
    uncalibrated = read_camera(written(tmp_path, GOOD.replace("calibrated = true", "calibrated = false")))
    assert uncalibrated.focal_sigma == 0.05


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("fx = 516.5", "fx = -516.5", "intrinsics.fx"),
        ("fx = 516.5", "fx = nan", "intrinsics.fx"),
        ("fx = 516.5", 'fx = "516"', "intrinsics.fx"),
        ("fx = 516.5", "", "intrinsics.fx"),
        ("cx = 320", "cx = 900", "intrinsics.cx"),
        ("cx = 320", "cx = inf", "intrinsics.cx"),
        ("width_px = 640", "width_px = 0", "intrinsics.width_px"),
        ("width_px = 640", "width_px = 640.5", "intrinsics.width_px"),
        ("cy = 240.0", "cy = 240.0\ndistortion = [0.1, 0.2]", "intrinsics.distortion"),
        ("cy = 240.0", "cy = 240.0\ndistortion = [-2.0, 0, 0, 0, 0]", "intrinsics.distortion"),
        ("cy = 240.0", "cy = 240.0\ndistortion = [0, 0, nan, 0, 0]", "intrinsics.distortion"),
        ("cy = 240.0", "cy = 240.0\ndistortion = [1e5, 0, 0, 0, 0]", "no lens bends a picture so much"),
        ("cy = 240.0", "cy = 240.0\ndistortion = [0, 0, 0, 0, 1e300]", "no lens bends a picture so much"),
        ("cy = 240.0", "cy = 240.0\ndistortion = [0, 0, 1e300, 0, 0]", "no lens bends a picture so much"),
        ("tilt_down_deg = 20.0", "body_from_camera_wxyz = [1.0, 1.0, 0.0, 0.0]", "body_from_camera_wxyz"),
        ("tilt_down_deg = 20.0", "", "mounting"),
        ("tilt_down_deg = 20.0", "tilt_down_deg = 20.0\nposition_body_m = [1.0]", "mounting.position_body_m"),
        ("calibrated = true", "calibrated = true\nlatencey_s = 0.1", "latencey_s"),
        ("calibrated = true", "calibrated = true\nreadout_s = -0.1", "readout_s"),
        ("calibrated = true", "calibrated = true\nfocal_sigma = nan", "focal_sigma"),
        ("version = 1", "version = 2", "version"),
        ("[intrinsics]", "[intrinsics", "TOML"),
    ],
)
def test_a_wrong_field_is_named(tmp_path: Path, old: str, new: str, named: str) -> None:
    path = written(tmp_path, GOOD.replace(old, new))
    with pytest.raises(CalibrationError) as caught:
        read_camera(path)
    assert named in caught.value.cause
    assert str(path) in caught.value.cause


def test_a_missing_an_unreadable_and_a_binary_file_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="No such file"):
        read_camera(tmp_path / "none.toml")
    with pytest.raises(CalibrationError, match="cannot be read"):
        read_camera(tmp_path)
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CalibrationError, match="not text"):
        read_camera(tmp_path / "binary")


def test_a_file_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="cannot be written"):
        write_camera(tmp_path / "no" / "camera.toml", CAMERA)
    (tmp_path / "taken").mkdir()
    with pytest.raises(CalibrationError, match="cannot be written"):
        write_camera(tmp_path / "taken", CAMERA)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_a_camera_known_only_by_its_view_says_so_and_widens_the_noise() -> None:
    rough = Camera.from_field_of_view(640, 480, math.radians(70.0))
    assert not rough.calibrated
    clean, wide = NoiseModel(), rough.widen(NoiseModel())
    assert wide.heading_bias_sigma_rad == pytest.approx(
        math.hypot(clean.heading_bias_sigma_rad, 0.05 * 160.0 / rough.intrinsics.fx)
    )
    assert wide.tilt_bias_sigma_rad > clean.tilt_bias_sigma_rad
    assert wide.pixel_sigma_px == pytest.approx(math.hypot(1.5, 8.0))
    known = replace(rough, focal_sigma=0.001).widen(NoiseModel())
    assert known.pixel_sigma_px == pytest.approx(1.5, abs=0.02)


def test_an_impossible_view_is_a_calibration_error() -> None:
    with pytest.raises(CalibrationError, match="field of view"):
        Camera.from_field_of_view(640, 480, 4.0)


def test_another_picture_size_of_the_same_shape_is_scaled_and_another_shape_refused() -> None:
    double = CAMERA.for_picture(1280, 960)
    assert double.intrinsics.fx == 2 * LENS.fx
    assert double.intrinsics.cy == 2 * LENS.cy
    assert double.intrinsics.distortion == LENS.distortion
    with pytest.raises(CalibrationError, match="another shape"):
        CAMERA.for_picture(1280, 720)


def test_a_rolling_shutter_exposes_the_middle_row_at_the_frames_time() -> None:
    assert CAMERA.row_time_s(5.0, 240.0) == pytest.approx(5.0)
    assert CAMERA.row_time_s(5.0, 0.0) == pytest.approx(5.0 - 0.0125)
    assert CAMERA.row_time_s(5.0, 480.0) == pytest.approx(5.0 + 0.0125)


def test_the_smallest_of_all_numbers_as_a_distortion_is_none(tmp_path: Path) -> None:
    text = GOOD.replace("cy = 240.0", "cy = 240.0\ndistortion = [5e-324, 5e-324, 0, 0, 5e-324]")
    model = CameraModel(read_camera(written(tmp_path, text)).intrinsics)
    assert model.max_radius == math.inf


@pytest.mark.parametrize("number", ["1" + 400 * "0", "1" + 5000 * "0", "[" * 100_000])
def test_an_absurd_number_is_told(tmp_path: Path, number: str) -> None:
    (tmp_path / "camera.toml").write_text(f"version = {number}\n", "utf-8")
    with pytest.raises(CalibrationInputError, match=r"camera\.toml"):
        read_camera(tmp_path / "camera.toml")
