"""The upright window takes out distance and roll."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.detect.window import cut_window
from tests.support.people import film, person

BLANK = np.zeros((480, 640, 3), np.uint8)
SIZE = (128, 160)


@given(
    x=st.floats(50, 600),
    y=st.floats(50, 400),
    body=st.floats(30, 400),
    roll=st.floats(-0.6, 0.6),
    dx=st.floats(-60, 60),
    dy=st.floats(-60, 60),
)
def test_points_go_to_the_frame_and_back(x: float, y: float, body: float, roll: float, dx: float, dy: float) -> None:
    window = cut_window(BLANK, (x, y), body, 96.0, SIZE, roll)
    assert window.to_window(x, y) == pytest.approx((64.0, 80.0))
    assert window.to_window(*window.to_frame(64.0 + dx, 80.0 + dy)) == pytest.approx((64.0 + dx, 80.0 + dy))
    assert window.scale == pytest.approx(96.0 / body)


def test_a_bright_dot_lands_where_the_transform_says() -> None:
    image = BLANK.copy()
    image[249:252, 309:312] = 255  # centred on (310.5, 250.5)
    window = cut_window(image, (300.0, 240.0), 96.0, 96.0, SIZE, 0.3)
    rows, columns = np.nonzero(window.image[:, :, 0] > 40)
    weights = window.image[rows, columns, 0].astype(float)
    seen = (np.average(columns, weights=weights) + 0.5, np.average(rows, weights=weights) + 0.5)
    assert seen == pytest.approx(window.to_window(310.5, 250.5), abs=0.1)


def test_a_rolled_camera_gives_the_same_upright_window() -> None:
    level, rolled = film(person(5.0), roll_deg=0.0)[0], film(person(5.0), roll_deg=12.0)[0]
    windows = [
        cut_window(s.frame.image, s.truth.pixel, 180.0, 96.0, SIZE, s.roll_rad).image.astype(float)
        for s in (level, rolled)
    ]
    turned = cut_window(rolled.frame.image, rolled.truth.pixel, 180.0, 96.0, SIZE, 0.0).image.astype(float)
    middle = np.s_[20:140, 40:88]
    apart = float(np.abs(windows[0][middle] - windows[1][middle]).mean())
    assert apart < 0.5 * float(np.abs(windows[0][middle] - turned[middle]).mean())


def test_what_is_beyond_the_edge_is_known_to_be_made_up() -> None:
    window = cut_window(BLANK, (320.0, 470.0), 100.0, 96.0, SIZE)
    assert window.shows(64.0, 80.0)
    assert not window.shows(64.0, 80.0 + 15.0)


@given(x=st.floats(0, 640), y=st.floats(0, 480), body=st.floats(30, 600), roll=st.floats(-0.6, 0.6))
def test_what_is_shown_is_what_lies_in_the_frame(x: float, y: float, body: float, roll: float) -> None:
    window = cut_window(BLANK + 7, (x, y), body, 96.0, SIZE, roll)
    shown = window.shown() > 0
    assert shown.shape == window.image.shape[:2]
    # Up to the pixels on the frame's edge, which are blends.
    assert np.mean(shown != (window.image[:, :, 0] < 60)) < 0.02
