"""A picture from the same place is found again, and so are the points that were followed in it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mission.bundle.loop_closure import MOST_PICTURES, SeenPatches
from mission.bundle.point_tracks import PointTracker
from mission.records import Frame, Image
from tests.mission.bundle.test_point_tracks import LENS, texture, view

SIZE = (320, 240)


def grey(seed: int, right: float = 0.0, down: float = 0.0) -> Image:
    """A picture that shows a texture moved to the right and down by so many work pixels."""
    move = np.array([[1.0, 0.0, 2.0 * right - 80.0], [0.0, 1.0, 2.0 * down - 60.0]])
    small = cv2.resize(view(texture(seed), move), SIZE, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), np.uint8)


def noisy(picture: Image, rng: np.random.Generator) -> Image:
    return np.clip(picture + rng.normal(0.0, 4.0, picture.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("moved", [(0.0, 0.0), (24.0, -8.0), (-36.0, 12.0)])
def test_the_twin_is_the_picture_of_the_same_place_and_its_shift_is_told(moved: tuple[float, float]) -> None:
    album, rng = SeenPatches(SIZE), np.random.default_rng(0)
    for number in range(5):
        assert album.look(noisy(grey(number), rng), 0.2 * number, 10 * number) is None
    twin = album.look(noisy(grey(2, *moved), rng), 5.0, 50)
    assert twin is not None
    assert twin.number == 20
    np.testing.assert_allclose(twin.shift, moved, atol=4.0)


def test_another_place_has_no_twin() -> None:
    album = SeenPatches(SIZE)
    for number in range(5):
        album.look(grey(number), 0.2 * number, number)
    assert album.look(grey(9), 5.0, 5) is None


def test_pictures_without_texture_have_no_twin() -> None:
    album, rng = SeenPatches(SIZE), np.random.default_rng(3)
    flat = np.full((240, 320), 128, np.uint8)
    album.look(flat, 0.0, 0)
    assert album.look(flat, 2.0, 1) is None
    album.look(noisy(flat, rng), 4.0, 2)
    assert album.look(noisy(flat, rng), 6.0, 3) is None


def test_a_picture_of_just_now_is_no_twin() -> None:
    album = SeenPatches(SIZE)
    album.look(grey(0), 0.0, 0)
    assert album.look(grey(0), 0.4, 1) is None
    assert album.look(grey(0), 1.5, 2) is not None


def test_the_album_holds_so_many_pictures_and_goes_on_finding_them() -> None:
    album = SeenPatches(SIZE)
    first = grey(0)
    album.look(first, 0.0, 0)
    for number in range(1, MOST_PICTURES + 5):
        album.look(np.full((240, 320), 50, np.uint8), 0.2 * number, number)
    twin = album.look(first, 100.0, 999)
    assert twin is not None
    assert twin.number == 0


def test_points_that_left_the_picture_keep_their_number_when_they_come_back() -> None:
    tracker, picture = PointTracker(LENS), texture(4)
    # Out by 300 px and back, too far for most points to stay in the picture all the while.
    way = np.concatenate([np.arange(0.0, 301.0, 15.0), np.arange(285.0, -1.0, -15.0)])
    wide = np.asarray(cv2.resize(picture, (1200, 900), interpolation=cv2.INTER_CUBIC), np.uint8)
    for k, across in enumerate(way):
        tracker.add(Frame(view(wide, np.array([[1.0, 0.0, -across], [0.0, 1.0, -100.0]])), 0.05 * k, k))
    first, middle, last = (tracker.frames[k] for k in (0, len(way) // 2, len(way) - 1))
    gone = np.setdiff1d(first.track, middle.track)
    back = np.intersect1d(gone, last.track)
    assert len(gone) > 20
    assert len(back) > 0.6 * len(gone)
    before = tracker.pixels(first, first.point[np.isin(first.track, back)])
    after = tracker.pixels(last, last.point[np.isin(last.track, back)])
    assert np.median(np.abs(after - before)) < 0.3
    for frame in tracker.frames:
        assert (np.diff(frame.track) > 0).all()
