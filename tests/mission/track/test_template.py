"""Correlation of head and shoulders, and the colours of the clothes."""

from __future__ import annotations

import numpy as np
import pytest

from mission.detect.window import Window, cut_window
from mission.track.appearance import adapted, colours, likeness
from mission.track.template import Template
from tests.support.people import Shot, film, person

SIZE = (128, 224)
MIDDLE = np.array([64.0, 112.0])
BLUE = 'clothes = { shirt = "#3050b0", trousers = "#303030" }\n'
RED = 'clothes = { shirt = "#b03030", trousers = "#303030" }\n'


def cut(shot: Shot, dx: float = 0.0, dy: float = 0.0) -> Window:
    x, y = shot.truth.pixel
    return cut_window(shot.frame.image, (x + dx, y + dy), shot.truth.height_px, 120.0, SIZE, shot.roll_rad)


def window(shot: Shot, dx: float = 0.0, dy: float = 0.0) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return cut(shot, dx, dy).image


@pytest.mark.parametrize(("dx", "dy"), [(0.0, 0.0), (1.3, -0.6), (-4.2, 3.7)])
def test_a_shift_is_found_to_a_quarter_of_a_pixel(dx: float, dy: float) -> None:
    shot = film(person(5.0))[0]
    scale = 120.0 / shot.truth.height_px
    template = Template.cut(window(shot), MIDDLE, 120.0, 0.0)
    assert template is not None
    match = template.find(window(shot, dx, dy), MIDDLE, 120.0)
    assert match is not None
    assert (match.x_px - 64.0, match.y_px - 112.0) == pytest.approx((-dx * scale, -dy * scale), abs=0.25)
    assert match.score > 0.9


def test_a_plain_surface_matches_nothing() -> None:
    template = Template.cut(window(film(person(5.0))[0]), MIDDLE, 120.0, 0.0)
    assert template is not None
    match = template.find(np.full((224, 128, 3), 90, np.uint8), MIDDLE, 120.0)
    assert match is None or match.score < 0.5


def test_a_template_that_reaches_out_of_the_window_is_none() -> None:
    assert Template.cut(np.zeros((224, 128, 3), np.uint8), np.array([5.0, 20.0]), 120.0, 0.0) is None


def looks(people: str, seed: int = 5) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return colours(cut(film(people, seed=seed)[0]), MIDDLE, 120.0)


def test_the_same_clothes_look_alike_from_another_side_and_distance() -> None:
    front = looks(person(4.0, walk_deg=180.0) + BLUE)
    side = looks(person(8.0, walk_deg=90.0) + BLUE)
    assert likeness(front, side) > 0.6


def test_another_shirt_is_not_alike() -> None:
    assert likeness(looks(person(5.0) + BLUE), looks(person(5.0) + RED)) < 0.3


def test_what_lies_beyond_the_picture_has_no_colours() -> None:
    shot = film(person(5.0) + BLUE)[0]
    (x, y), height = shot.truth.pixel, shot.truth.height_px
    whole = colours(cut(shot), MIDDLE, 120.0)
    without_legs = shot.frame.image[: round(y)]
    half = colours(cut_window(without_legs, (x, y), height, 120.0, SIZE), MIDDLE, 120.0)
    assert half[0].any()
    assert not half[1].any()
    assert likeness(half, whole) > 0.95, "of what both show"
    assert likeness(np.zeros_like(half), whole) == 0.0


def test_looks_are_learned_part_by_part() -> None:
    whole = looks(person(5.0) + BLUE)
    half = whole.copy()
    half[1] = 0.0
    assert adapted(half, whole, 0.02) == pytest.approx(whole), "legs that come into view are new"
    assert adapted(whole, half, 0.02) == pytest.approx(whole), "legs that go out of view are kept"
    other = looks(person(5.0) + RED)
    assert likeness(adapted(whole, other, 0.02), whole) > likeness(other, whole)
