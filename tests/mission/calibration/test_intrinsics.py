import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from mission.calibration.board import CharucoBoard, Chessboard
from mission.calibration.intrinsics import BoardCalibration, calibrate_board, read_pictures
from mission.camera import CameraModel
from mission.errors import CalibrationError
from mission.records import Image
from tests.support import boards
from tests.support.boards import COLUMNS, LENS, ROWS, SQUARE_M

CHESSBOARD = Chessboard(COLUMNS, ROWS, SQUARE_M)
CHARUCO = CharucoBoard(COLUMNS, ROWS, SQUARE_M, 0.022, "DICT_5X5_100")


@pytest.fixture(scope="module")
def views() -> list[tuple[str, Image]]:
    return boards.pictures(boards.chessboard(), 14, np.random.default_rng(3))


@pytest.fixture(scope="module")
def by_chessboard(views: list[tuple[str, Image]]) -> BoardCalibration:
    """From the views, and three pictures that are none."""
    odd = [("blank", np.zeros_like(views[0][1])), ("small", views[0][1][:200, :300]), ("broken", None)]
    return calibrate_board([*views, *odd], CHESSBOARD)


@pytest.mark.parametrize("board", ["chessboard", "charuco"])
def test_a_known_lens_is_recovered_from_pictures_of_a_board(board: str, by_chessboard: BoardCalibration) -> None:
    result = by_chessboard
    if board == "charuco":
        result = calibrate_board(boards.pictures(boards.charuco(), 14, np.random.default_rng(3)), CHARUCO)
    lens = result.camera.intrinsics
    assert result.camera.calibrated
    assert result.rms_px < 0.3
    assert lens.fx == pytest.approx(LENS.fx, rel=0.005)
    assert lens.fy == pytest.approx(LENS.fy, rel=0.005)
    assert lens.cx == pytest.approx(LENS.cx, abs=2.5)
    assert lens.cy == pytest.approx(LENS.cy, abs=2.5)
    pixels = [(x, y) for x in (60.0, 320.0, 580.0) for y in (60.0, 240.0, 420.0)]
    seen, true = CameraModel(lens).ray(pixels), CameraModel(LENS).ray(pixels)
    assert np.degrees(np.arccos(np.clip(np.sum(seen * true, axis=1), -1, 1))).max() < 0.35
    assert sum(one.verdict == "used" for one in result.pictures) >= 8
    assert all((one.rms_px is not None) == (one.verdict == "used") for one in result.pictures)


def test_the_corners_of_a_board_are_where_the_lens_puts_them() -> None:
    (_, image), *_ = boards.pictures(boards.chessboard(), 1, np.random.default_rng(0), tilt_deg=0.01)
    found = CHESSBOARD.find(image)
    assert found is not None
    rays = CameraModel(LENS).ray(found.pixels)
    flat = rays[:, :2] / rays[:, 2:]
    # A board that is not tilted keeps its shape on the undistorted plane: corners are equally spaced.
    grid = flat.reshape(ROWS - 1, COLUMNS - 1, 2)
    steps = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    assert steps.std() / steps.mean() < 0.005


def test_the_same_picture_again_does_not_count(views: list[tuple[str, Image]]) -> None:
    with pytest.raises(CalibrationError, match=r"Only [23] pictures .* [46] too similar") as caught:
        calibrate_board(views[:3] * 3, CHESSBOARD)
    assert "tilted" in caught.value.remedy


def test_boards_that_were_never_tilted_do_not_tell_the_focal_length() -> None:
    views = boards.pictures(boards.chessboard(), 10, np.random.default_rng(3), tilt_deg=1.0)
    with pytest.raises(CalibrationError, match="too similar"):
        calibrate_board(views, CHESSBOARD)


def test_pictures_without_a_board_of_another_size_or_broken_are_reported(by_chessboard: BoardCalibration) -> None:
    verdicts = {one.name: one.verdict for one in by_chessboard.pictures}
    assert (verdicts["blank"], verdicts["small"], verdicts["broken"]) == ("no board", "other size", "unreadable")


def test_a_folder_without_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="no folder"):
        read_pictures(tmp_path / "none")
    with pytest.raises(CalibrationError, match="no pictures"):
        read_pictures(tmp_path)
    (tmp_path / "broken.png").write_bytes(b"not a picture")
    assert read_pictures(tmp_path) == [("broken.png", None)]


def test_an_impossible_board_is_refused() -> None:
    with pytest.raises(CalibrationError, match="too small"):
        Chessboard(3, 7, 0.03)
    with pytest.raises(CalibrationError, match="no size"):
        Chessboard(9, 7, float("nan"))
    with pytest.raises(CalibrationError, match="smaller"):
        CharucoBoard(9, 7, 0.02, 0.03, "DICT_5X5_100")
    with pytest.raises(CalibrationError, match="no marker dictionary"):
        CharucoBoard(9, 7, 0.03, 0.02, "nonsense")


def _held(jpeg: bytes, orientation: int) -> bytes:
    """The picture with an EXIF header that tells how the camera was held."""
    entry = struct.pack("<HHIHH", 0x0112, 3, 1, orientation, 0)
    tiff = b"II*\0" + struct.pack("<IH", 8, 1) + entry + struct.pack("<I", 0)
    header = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(header) + 2) + header + jpeg[2:]


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_pictures_are_read_as_the_sensor_gave_them_however_the_camera_was_held(
    orientation: int, tmp_path: Path
) -> None:
    image = np.zeros((48, 64, 3), dtype=np.uint8)
    image[:16, :16] = 255
    jpeg = cv2.imencode(".jpg", image)[1].tobytes()
    (tmp_path / "held.jpg").write_bytes(_held(jpeg, orientation))
    ((_, read),) = read_pictures(tmp_path)
    assert read is not None
    assert read.shape == (48, 64, 3)
    assert read[5, 5].mean() > 200.0
