"""What an operator types, as an order."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component.orders import HandToAutopilot, LocateOrder, Mark, order_of
from gcs_plugin.mavproxy.arguments import ABORT, LOCATE, NEXT, PictureSize, TypedOrder, order
from mission.errors import SettingsError

VGA = PictureSize(640, 480)


def test_the_words_are_the_orders_of_the_component() -> None:
    assert order([], VGA) == TypedOrder(LOCATE)
    assert order(["next"], VGA) == TypedOrder(NEXT)
    assert order(["abort"], VGA) == TypedOrder(ABORT)
    waypoint = order(["waypoint"], VGA)
    assert order_of(waypoint.command, (*waypoint.params, 0.0, 0.0, 0.0), box_locates=True) == HandToAutopilot(
        False, True
    )
    assert (LOCATE, ABORT, NEXT) == (mavlink.MAV_CMD_USER_1, mavlink.MAV_CMD_USER_2, mavlink.MAV_CMD_USER_3)


@pytest.mark.parametrize(
    "words", [["box", "64,48,128,240"], ["box", "64", "48", "128", "240"], ["box", "64,", "48,128,240"]]
)
def test_a_box_in_pixels_becomes_its_corners_as_shares(words: list[str]) -> None:
    assert order(words, VGA).params == pytest.approx((0.1, 0.1, 0.3, 0.6))


def test_a_box_in_shares_needs_no_picture() -> None:
    assert order(["box", "0.1,0.2,0.3,0.4"], None).params == pytest.approx((0.1, 0.2, 0.4, 0.6))
    with pytest.raises(SettingsError, match="the size of the video is not known yet"):
        order(["box", "64,48,128,240"], None)


@given(x=st.floats(0.0, 1.0), y=st.floats(0.0, 1.0))
def test_the_component_reads_a_point_as_the_same_point(x: float, y: float) -> None:
    asked = order(["point", f"{x!r},{y!r}"], None)
    read = order_of(asked.command, asked.params, box_locates=True)
    assert isinstance(read, LocateOrder)
    assert isinstance(read.mark, Mark)
    assert read.mark.is_point
    assert (read.mark.left, read.mark.top) == pytest.approx((x, y), abs=2e-6)


@given(st.tuples(*[st.floats(0.0, 0.45)] * 2, *[st.floats(0.01, 0.5)] * 2))
def test_the_component_reads_a_box_as_the_same_box(box: tuple[float, float, float, float]) -> None:
    left, top, width, height = box
    asked = order(["box", ",".join(map(repr, box))], None)
    read = order_of(asked.command, asked.params, box_locates=True)
    assert isinstance(read, LocateOrder)
    assert isinstance(read.mark, Mark)
    corners = (read.mark.left, read.mark.top, read.mark.right, read.mark.bottom)
    assert corners == pytest.approx((left, top, left + width, top + height))


@given(st.lists(st.text(max_size=12), max_size=4))
def test_any_words_are_an_order_or_an_explanation(words: list[str]) -> None:
    try:
        found = order(words, VGA)
    except SettingsError:
        return
    assert isinstance(found, TypedOrder)
