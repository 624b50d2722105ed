"""Points are followed to a tenth of a pixel, keep out of boxes, and do not mind a banking aircraft."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mission.bundle.point_tracks import PointTracker
from mission.camera.model import from_field_of_view
from mission.records import Box, Frame, Image, Matrix

LENS = from_field_of_view(640, 480, 1.2)


def texture(seed: int = 0) -> Image:
    """(600, 800, 3) of smooth random grey."""
    noise = np.random.default_rng(seed).uniform(0.0, 255.0, (600, 800)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 4.0)
    smooth = 255.0 * (smooth - smooth.min()) / np.ptp(smooth)
    return np.asarray(np.repeat(smooth[:, :, None], 3, axis=2), dtype=np.uint8)


def view(picture: Image, move: Matrix) -> Image:
    """The 640 x 480 picture whose pixel x shows the texture at move^-1 x."""
    return np.asarray(cv2.warpAffine(picture, move, (640, 480), flags=cv2.INTER_CUBIC), dtype=np.uint8)


def turned(angle_rad: float) -> Matrix:
    """Turned about the picture's middle, as by a camera that rolls by minus that; (2, 3)."""
    return np.asarray(cv2.getRotationMatrix2D((320.0, 240.0), np.degrees(angle_rad), 1.0))


def test_points_move_as_the_picture_does() -> None:
    tracker, picture = PointTracker(LENS), texture()
    for k in range(8):
        tracker.add(Frame(view(picture, np.array([[1.0, 0.0, -2.3 * k], [0.0, 1.0, 1.1 * k]])), 0.05 * k, k))
    first, last = tracker.frames[0], tracker.frames[-1]
    both = np.intersect1d(first.track, last.track)
    assert len(both) > 40
    before = tracker.pixels(first, first.point[np.isin(first.track, both)])
    after = tracker.pixels(last, last.point[np.isin(last.track, both)])
    np.testing.assert_allclose(np.median(after - before, axis=0), [-16.1, 7.7], atol=0.1)


def test_no_point_is_taken_inside_a_box_around_a_person() -> None:
    tracker, picture = PointTracker(LENS), texture()
    box = Box(250.0, 100.0, 120.0, 300.0)
    for k in range(6):
        tracker.add(Frame(view(picture, np.array([[1.0, 0.0, -4.0 * k], [0.0, 1.0, 0.0]])), 0.05 * k, k), [box])
    for frame in tracker.frames:
        pixel = tracker.pixels(frame, frame.point)
        assert not any(box.contains(x, y) for x, y in pixel.tolist())
        assert len(pixel) > 20


def test_a_levelled_picture_keeps_points_in_place_when_the_aircraft_banks() -> None:
    picture, error = texture(1), {}
    for told in (True, False):
        tracker = PointTracker(LENS)
        for k in range(12):
            angle = 0.02 * k
            frame = Frame(view(picture, turned(angle)), 0.05 * k, k)
            tracker.add(frame, roll_rad=angle if told else 0.0)
        first, last = tracker.frames[0], tracker.frames[-1]
        both = np.intersect1d(first.track, last.track)
        before = tracker.pixels(first, first.point[np.isin(first.track, both)]) - 0.5
        after = tracker.pixels(last, last.point[np.isin(last.track, both)]) - 0.5
        move = turned(0.22)
        error[told] = float(np.median(np.abs(after - (before @ move[:, :2].T + move[:, 2]))))
    assert error[True] < 0.15
    assert error[True] < 0.6 * error[False]


def test_pixels_and_points_are_each_others_inverse() -> None:
    tracker = PointTracker(LENS)
    tracker.add(Frame(texture()[:480, :640], 0.0, 0), roll_rad=0.2)
    frame = tracker.frames[0]
    pixel = tracker.pixels(frame, frame.point)
    np.testing.assert_allclose(tracker.points(frame, pixel), frame.point, atol=1e-3)


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_picture_without_texture_has_no_points(grey: int) -> None:
    tracker, rng = PointTracker(LENS), np.random.default_rng(0)
    for k in range(4):
        image = np.clip(grey + rng.normal(0.0, 2.0, (480, 640, 3)), 0, 255).astype(np.uint8)
        tracker.add(Frame(image, 0.05 * k, k))
    assert len(tracker.frames[-1].track) < 12


def test_a_frame_that_is_not_later_is_passed_over() -> None:
    tracker = PointTracker(LENS)
    for t_s in (0.0, 0.05, 0.05, 0.02):
        tracker.add(Frame(texture()[:480, :640], t_s, 0))
    assert [frame.t_s for frame in tracker.frames] == [0.0, 0.05]
