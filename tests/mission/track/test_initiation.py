"""Who is meant by a box: not the tree beside it."""

from __future__ import annotations

import numpy as np
import pytest

from mission.detect.window import Window, cut_window
from mission.errors import DetectionError
from mission.records import Box, Image
from mission.track.detections import BodyDetection, WindowDetectors
from mission.track.initiation import initial_detection

PICTURE = np.zeros((480, 640, 3), np.uint8)
BOX = Box(320.0, 0.0, 90.0, 480.0)


class Told(WindowDetectors):
    """Sees what it is told to."""

    def __init__(self, *bodies: BodyDetection) -> None:
        self._bodies = list(bodies)

    def bodies(
        self, image: Image, centre: tuple[float, float], height_px: float, roll_rad: float, wide: bool = False
    ) -> tuple[Window, list[BodyDetection]]:
        return cut_window(image, centre, height_px, 96.0, (128, 160), roll_rad), self._bodies


def body(x: float, height: float, score: float, *, whole: bool = True) -> BodyDetection:
    top, bottom = 240.0 - 0.5 * height, 240.0 + 0.5 * height
    return BodyDetection(
        (x, 240.0), (x, top), (x, bottom), height, score, whole, whole, True, Box(x - 30, top, 60.0, height)
    )


def test_somebody_cut_off_is_meant_rather_than_the_whole_tree_beside_them() -> None:
    near, tree = body(360.0, 440.0, 0.43, whole=False), body(283.0, 202.0, 0.39)
    assert initial_detection(Told(tree, near), PICTURE, BOX, 0.0) is near


def test_of_two_boxes_on_the_body_the_whole_one_is_preferred_where_it_is_about_as_sure() -> None:
    half, whole, unsure = body(360.0, 250.0, 0.6, whole=False), body(365.0, 470.0, 0.55), body(362.0, 480.0, 0.3)
    assert initial_detection(Told(half, whole), PICTURE, BOX, 0.0) is whole
    assert initial_detection(Told(half, unsure), PICTURE, BOX, 0.0) is half


def test_a_box_without_a_person_is_refused() -> None:
    with pytest.raises(DetectionError, match="nobody to follow"):
        initial_detection(Told(body(283.0, 202.0, 0.8)), PICTURE, BOX, 0.0)
