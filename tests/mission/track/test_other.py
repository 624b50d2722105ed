"""Somebody near who looks like the target: believed, followed, and about to cover the target or not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mission.track.measure import Extent
from mission.track.other import Other, may_be_taken_for, seen_again
from tests.mission.track.two_people import FRAME_S, HEIGHT, X, body, later, target, walked


@pytest.mark.parametrize(("aside_px", "met"), [(40.0, True), (-40.0, True), (90.0, False)])
def test_people_meet_when_they_are_about_to_cover_each_other(aside_px: float, met: bool) -> None:
    assert walked(X + aside_px, X + aside_px).meets(target(), 0.0) is met


def test_what_is_taken_for_somebody_only_once_meets_nobody() -> None:
    tree = seen_again(None, [body(X + 40.0)], target(), 0.0, 0.0)
    assert tree is not None
    assert not tree.meets(target(), 0.0)
    tree = seen_again(tree, [body(X + 40.0)], target(), FRAME_S, 0.0)
    assert tree is not None
    assert tree.meets(target(), FRAME_S)


def test_a_second_box_on_the_target_itself_is_nobody_wherever_the_target_was_foretold() -> None:
    own, second = body(X + 30.0), body(X + 45.0, 180.0, score=0.45)
    assert seen_again(None, [second], target(), 0.0, 0.0) is not None
    assert seen_again(None, [second], target(), 0.0, 0.0, own) is None
    other = seen_again(None, [second], target(), 0.0, 0.0)
    other = seen_again(other, [second], target(), FRAME_S, 0.0, own)
    assert other is not None
    assert not other.meets(target(), FRAME_S)


@pytest.mark.parametrize(("score", "somebody"), [(0.45, False), (0.7, True)])
def test_who_overlaps_the_target_is_somebody_else_if_the_detector_is_sure(score: float, somebody: bool) -> None:
    seen = seen_again(None, [body(X + 40.0, score=score)], target(), 0.0, 0.0, body())
    assert (seen is not None) is somebody


def test_somebody_who_is_seen_no_more_meets_the_target_where_they_should_be_by_now() -> None:
    other = walked(480.0, 400.0)
    assert not other.meets(target(), 0.0)
    later(other.motion, 0.25)
    assert other.meets(target(), 0.25), "two who cover each other look like one"
    assert not other.meets(target(), 2.0), "not seen for so long: they are gone"


def test_who_is_much_nearer_or_hardly_seen_is_not_taken_for_the_target() -> None:
    assert may_be_taken_for(body(), HEIGHT)
    assert not may_be_taken_for(body(height=500.0), HEIGHT)
    assert not may_be_taken_for(body(score=0.3), HEIGHT)


def test_the_way_of_the_nearest_other_one_is_followed() -> None:
    assert seen_again(None, [], target(), 0.0, 0.0) is None
    other = seen_again(None, [body(520.0), body(430.0)], target(), 0.0, 0.0)
    assert other is not None
    assert other.motion.pixel[0] == pytest.approx(430.0)
    assert seen_again(other, [body(440.0)], target(), FRAME_S, 0.0) is other
    assert 430.0 < other.motion.pixel[0] <= 440.0
    third = seen_again(other, [body(200.0)], target(), 2 * FRAME_S, 0.0)
    assert third is not other
    assert third is not None


def test_a_second_box_on_the_target_itself_is_nobody_else() -> None:
    assert seen_again(None, [body(X + 20.0, 160.0)], target(), 0.0, 0.0) is None
    passer = walked(520.0, 420.0)
    assert seen_again(passer, [body(X + 20.0, 160.0)], target(), FRAME_S, 0.0) is passer, "it stays who it was"


def test_who_is_cut_off_by_the_picture_is_at_least_as_tall_as_what_is_seen() -> None:
    def cut_off(height: float) -> Extent:
        return replace(body(X + 60.0, height), feet_visible=False)

    assert Other.at(cut_off(120.0), target(), 0.0, 0.0).motion.height_px == pytest.approx(HEIGHT)
    other = Other.at(cut_off(300.0), target(), 0.0, 0.0)
    assert other.motion.height_px == pytest.approx(300.0)
    assert other.motion.pixel == pytest.approx([X + 60.0, 240.0])
    other.see(cut_off(400.0), FRAME_S, 0.0)
    assert other.motion.height_px > 380.0
    other.see(cut_off(200.0), 2 * FRAME_S, 0.0)
    assert other.motion.height_px > 380.0


def test_a_box_that_may_hold_two_does_not_say_how_tall_somebody_is() -> None:
    other = walked(X + 60.0, X + 60.0)
    other.see(body(X + 50.0, 300.0), FRAME_S, 0.0, alone=False)
    assert other.motion.height_px == pytest.approx(HEIGHT)
    assert other.motion.pixel[0] < X + 60.0


def test_who_is_neither_seen_nor_hidden_behind_the_target_is_belied() -> None:
    beside, behind = walked(X + 90.0, X + 90.0), walked(X + 30.0, X + 30.0)
    assert not beside.belied(target(), 0.0), "just seen"
    assert beside.belied(target(), FRAME_S)
    assert not behind.belied(target(), FRAME_S)
