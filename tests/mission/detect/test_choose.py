"""The operator's choice wins; without one it is whoever is nearest to the image centre."""

from __future__ import annotations

import pytest

from mission.detect import choose
from mission.errors import DetectionError
from mission.records import Box, Detection

SIZE = (640, 480)
LEFT = Detection(Box(100, 150, 60, 150), 0.9)
MIDDLE = Detection(Box(300, 180, 50, 125), 0.5)
RIGHT = Detection(Box(520, 150, 60, 150), 0.8)
ALL = [LEFT, MIDDLE, RIGHT]


def test_without_a_choice_the_person_nearest_the_centre_is_taken_whatever_the_scores() -> None:
    assert choose(ALL, SIZE) is MIDDLE


def test_a_box_takes_the_person_it_overlaps_most() -> None:
    assert choose(ALL, SIZE, box=Box(500, 140, 70, 160)) is RIGHT


@pytest.mark.parametrize(
    ("drawn", "meant"),
    [
        (Box(20, 20, 240, 440), LEFT),  # generous: twelve times the body
        (Box(440, 20, 200, 460), RIGHT),
        (Box(120, 190, 15, 30), LEFT),  # on the chest
        (Box(95, 140, 300, 300), LEFT),  # around two: the one that fills more of it
        (Box(60, 0, 262, 480), LEFT),  # wide around one, and an arm of another
    ],
)
def test_a_box_that_is_drawn_generously_or_small_still_takes_the_person_in_it(drawn: Box, meant: Detection) -> None:
    assert choose(ALL, SIZE, box=drawn) is meant


@pytest.mark.parametrize("drawn", [Box(165, 0, 130, 480), Box(0, 0, 640, 145), Box(150, 280, 160, 200)])
def test_a_box_beside_people_or_on_an_arm_of_them_is_nobodys(drawn: Box) -> None:
    with pytest.raises(DetectionError, match="inside the box"):
        choose(ALL, SIZE, box=drawn)


def test_a_point_on_a_body_takes_that_person() -> None:
    assert choose(ALL, SIZE, point=(120, 170)) is LEFT


def test_a_click_beside_a_thin_body_still_counts() -> None:
    assert choose(ALL, SIZE, point=(95, 220)) is LEFT


def test_the_box_wins_over_the_point() -> None:
    assert choose(ALL, SIZE, box=RIGHT.box, point=LEFT.box.centre_px) is RIGHT


def test_nobody_in_view_is_said_with_a_remedy() -> None:
    with pytest.raises(DetectionError) as caught:
        choose([], SIZE)
    assert "Nobody" in caught.value.cause
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("box", "point"), [(Box(400, 300, 50, 100), None), (None, (250.0, 50.0))], ids=["box", "point"]
)
def test_pointing_at_nobody_names_where_the_people_are(box: Box | None, point: tuple[float, float] | None) -> None:
    with pytest.raises(DetectionError, match=r"\(130, 225\)"):
        choose(ALL, SIZE, box=box, point=point)
