"""A point is where its first look is seen again, whatever brought it there; where that is not seen it stays."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy import ndimage

from mission.bundle.patch_alignment import PatchAlignment, Points
from mission.records import Image

SIZE = (240, 320)


def texture(seed: int) -> Image:
    """Blobs of some pixels' size, over a wide range of grey."""
    rng = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(rng.uniform(-1.0, 1.0, (2 * SIZE[0], 2 * SIZE[1])), (0, 0), 2.5)
    return np.asarray(np.clip(110.0 + 35.0 * rough / rough.std(), 0, 255), np.uint8)


def shifted(picture: Image, right: float, below: float, gain: float = 1.0, offset: float = 0.0) -> Image:
    """The middle of a picture, whose things are so much further right and down."""
    # Splines, not OpenCV's cubic filter: that one does not put a ramp where it belongs.
    moved = ndimage.shift(picture.astype(float), (below, right), order=3, mode="mirror")
    moved = moved[SIZE[0] // 2 : SIZE[0] // 2 + SIZE[0], SIZE[1] // 2 : SIZE[1] // 2 + SIZE[1]]
    return np.asarray(np.clip(gain * moved + offset, 0, 255), np.uint8)


@pytest.fixture(scope="module")
def picture() -> Image:
    return texture(1)


@pytest.fixture(scope="module")
def points(picture: Image) -> Points:
    corners = cv2.goodFeaturesToTrack(shifted(picture, 0.0, 0.0), 60, 0.05, 14)
    found = corners.reshape(-1, 2)
    return np.asarray(found[(found > 20).all(axis=1) & (found < [300, 220]).all(axis=1)], np.float32)


def numbers(points: Points) -> np.ndarray[tuple[int], np.dtype[np.int32]]:
    return np.arange(len(points), dtype=np.int32)


def anchored(picture: Image, points: Points) -> PatchAlignment:
    anchors = PatchAlignment()
    anchors.begin(shifted(picture, 0.0, 0.0), points)
    return anchors


@pytest.mark.parametrize("error", [(0.0, 0.0), (0.6, -0.5), (-1.0, 0.9)])
@pytest.mark.parametrize("way", [(0.0, 0.0), (3.37, -2.21), (-8.5, 5.5)])
def test_a_point_that_was_brought_beside_its_place_is_put_there(
    picture: Image, points: Points, way: tuple[float, float], error: tuple[float, float]
) -> None:
    moved = shifted(picture, *way)
    brought = points + np.array(way, np.float32) + np.array(error, np.float32)
    off = anchored(picture, points).refined(moved, numbers(points), brought) - points - way
    assert np.mean(np.abs(off).max(axis=1) < 0.1) > 0.9
    assert np.abs(np.median(off, axis=0)).max() < 0.02


@pytest.mark.parametrize(("gain", "offset"), [(0.8, 0.0), (1.2, 0.0), (1.0, 20.0), (0.85, 15.0)])
def test_the_exposure_may_change(picture: Image, points: Points, gain: float, offset: float) -> None:
    moved = shifted(picture, 1.3, 0.4, gain, offset)
    off = anchored(picture, points).refined(moved, numbers(points), points + np.array([1.7, 0.0], np.float32)) - points
    assert np.abs(np.median(off - [1.3, 0.4], axis=0)).max() < 0.03
    assert np.mean(np.abs(off - [1.3, 0.4]).max(axis=1) < 0.12) > 0.9


def test_errors_of_many_steps_do_not_add_up(picture: Image, points: Points) -> None:
    anchors, place, rng = anchored(picture, points), points, np.random.default_rng(3)
    for step in range(1, 40):
        moved = shifted(picture, 0.25 * step, 0.0)
        brought = place + np.array([0.25, 0.0], np.float32) + rng.normal(0.1, 0.1, place.shape).astype(np.float32)
        place = anchors.refined(moved, numbers(points), brought)
    off = place - points - [0.25 * 39, 0.0]
    assert np.mean(np.abs(off).max(axis=1) < 0.1) > 0.9


def test_what_does_not_look_as_it_did_stays_where_it_was_brought(picture: Image, points: Points) -> None:
    anchors = anchored(picture, points)
    assert np.array_equal(anchors.refined(shifted(texture(2), 0.0, 0.0), numbers(points), points), points)
    blank = np.full(SIZE, 90, np.uint8)
    assert np.array_equal(anchors.refined(blank, numbers(points), points), points)


def test_points_that_begin_later_have_looks_of_their_own(picture: Image, points: Points) -> None:
    anchors = PatchAlignment()
    anchors.begin(shifted(picture, 0.0, 0.0), points[:10])
    later = shifted(picture, 4.0, 1.0)
    anchors.begin(later, points[10:20] + np.array([4.0, 1.0], np.float32))
    some = np.array([3, 12, 15, 7], np.int32)
    brought = points[some] + np.array([4.6, 1.4], np.float32)
    off = anchors.refined(later, some, brought) - points[some] - [4.0, 1.0]
    assert np.abs(off).max() < 0.12


def test_where_there_is_nothing_to_see_nothing_breaks() -> None:
    anchors = PatchAlignment()
    none = np.empty((0, 2), np.float32)
    blank = np.full(SIZE, 90, np.uint8)
    assert anchors.refined(blank, np.empty(0, np.int32), none).shape == (0, 2)
    anchors.begin(blank, np.array([[50.0, 60.0], [0.0, 0.0]], np.float32))
    there = np.array([[50.0, 60.0], [-3.0, 500.0]], np.float32)
    assert np.array_equal(anchors.refined(blank, np.arange(2, dtype=np.int32), there), there)
