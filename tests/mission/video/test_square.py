"""Pictures whose pixels are not square are brought back to the shape that the lens saw."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from mission.camera.camera import Camera
from mission.camera.model import CameraModel
from mission.camera.mounting import Mounting
from mission.records import Box, CameraIntrinsics, Frame
from mission.video import VideoState, VideoStats
from mission.video.square import SquareVideo, square_camera, with_square_pixels

SQUEEZED = Camera(
    CameraIntrinsics(640, 480, 516.5, 688.7, 322.0, 238.3, (-0.06, 0.012, 0.0004, -0.0003, 0.0)),
    Mounting.tilted(0.0),
    calibrated=True,
    readout_s=0.03,
)
"""An AR.Drone's 1280 x 720 picture scaled to 640 x 480."""
PLAIN = replace(SQUEEZED, intrinsics=CameraIntrinsics(640, 480, 516.5, 517.9, 322.0, 238.5))


class OnePicture:
    """A video of one picture."""

    def __init__(self, frame: Frame | None) -> None:
        self.frame, self.closed = frame, False

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        return self.frame

    def stats(self) -> VideoStats:
        return VideoStats(VideoState.PLAYING, 15.0, 1, 0, 0, 0, 0.1, 0.01, "")

    def close(self) -> None:
        self.closed = True


def test_both_focal_lengths_become_the_larger_one_and_the_view_stays() -> None:
    lens = square_camera(SQUEEZED).intrinsics
    assert (lens.width_px, lens.height_px) == (853, 480)
    assert lens.fx == pytest.approx(lens.fy, rel=1e-3)
    assert lens.fy == 688.7
    assert square_camera(SQUEEZED).readout_s == 0.03


def test_a_direction_is_seen_at_the_place_where_the_pixel_was_moved() -> None:
    square = square_camera(SQUEEZED)
    video = SquareVideo(OnePicture(None), SQUEEZED, square)
    for direction in ([0.2, -0.1, 1.0], [-0.5, 0.3, 1.0]):
        before = CameraModel(SQUEEZED.intrinsics).project(direction)
        after = CameraModel(square.intrinsics).project(direction)
        assert video.point(*before.tolist()) == pytest.approx(tuple(after.tolist()), abs=1e-6)


def test_a_circle_that_was_squeezed_is_round_again() -> None:
    image = np.zeros((480, 640, 3), np.uint8)
    cv2.ellipse(image, (320, 240), (75, 100), 0.0, 0.0, 360.0, (255, 255, 255), -1)
    video, camera = with_square_pixels(OnePicture(Frame(image, 3.0, 7)), SQUEEZED)
    frame = video.latest(-1, 1.0)
    assert frame is not None
    assert frame.image.shape == (480, camera.intrinsics.width_px, 3)
    assert (frame.t_s, frame.index) == (3.0, 7)
    _, _, width, height = cv2.boundingRect((frame.image[:, :, 0] > 128).astype(np.uint8))
    assert width == pytest.approx(height, abs=2)


def test_a_box_keeps_what_it_holds() -> None:
    video = SquareVideo(OnePicture(None), SQUEEZED, square_camera(SQUEEZED))
    box = video.box(Box(320.0, 100.0, 64.0, 200.0))
    assert box.centre_px == pytest.approx(video.point(352.0, 200.0))
    assert (box.width_px, box.height_px) == pytest.approx((85.3, 200.0), abs=0.01)


def test_square_pixels_are_left_alone() -> None:
    source = OnePicture(None)
    assert with_square_pixels(source, PLAIN) == (source, PLAIN)


def test_no_picture_stays_none_and_the_source_is_asked_and_closed() -> None:
    source = OnePicture(None)
    video, _ = with_square_pixels(source, SQUEEZED)
    assert video.latest(-1, 0.0) is None
    assert video.stats().fps == 15.0
    video.close()
    assert source.closed
