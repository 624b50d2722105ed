"""People of the same looks who pass each other are told apart by where both should be by now, or not at all."""

from __future__ import annotations

from mission.track.measure import Extent
from mission.track.meeting import told_apart
from mission.track.other import Other
from tests.mission.track.two_people import FRAME_S, X, body, later, target, walked


def test_both_are_told_apart_by_place_or_not_at_all() -> None:
    mine, far, near = body(X + 8.0), body(X - 140.0), body(X + 30.0)
    other = walked(260.0, 180.0)
    told = told_apart([far, mine], target(), other, 0.0, -FRAME_S, 0.0)
    assert told is not None
    assert (told.target, told.other, told.apart) == (mine, far, True)
    beside = told_apart([near, mine], target(), walked(420.0, 370.0), 0.0, -FRAME_S, 0.0)
    assert beside is None or not beside.apart, "they still cover each other"
    assert told_apart([far, body(X + 250.0)], target(), other, 0.0, -FRAME_S, 0.0) is None, "neither is the target"


def test_where_the_other_one_should_be_tells_what_the_target_s_place_alone_does_not() -> None:
    mine, passer = body(X - 30.0), body(X + 46.0)

    def told(other: Other) -> Extent | None:
        expected = target()
        later(expected, 0.6)
        later(other.motion, 0.6)
        found = told_apart([mine, passer], expected, other, 0.6, 0.0, 0.0)
        return None if found is None else found.target

    assert told(walked(250.0, 310.0)) is mine
    standing = Other.at(body(X + 8.0), target(), 0.0, 0.0)
    assert told(standing) is None, "it could be either"


def test_somebody_alone_may_hide_the_target_unless_the_other_one_is_elsewhere_or_of_another_height() -> None:
    def told(other: Other, seen: Extent) -> Extent | None:
        found = told_apart([seen], target(), other, 0.0, -FRAME_S, 0.0)
        return None if found is None else found.target

    mine = body()
    assert told(Other.at(body(X + 12.0), target(), 0.0, 0.0), mine) is None
    assert told(Other.at(body(X + 120.0), target(), 0.0, 0.0), mine) is mine
    taller = Other.at(body(X + 12.0, height=280.0), target(), 0.0, 0.0)
    assert told(taller, mine) is mine
    assert told(taller, body(height=280.0)) is None, "the other one"


def test_a_foretold_place_is_believed_less_and_less() -> None:
    bodies = [body(X + 15.0), body(X - 70.0)]
    other = walked(X - 70.0, X - 70.0)
    expected = target()
    assert told_apart(bodies, expected, other, 0.0, -FRAME_S, 0.0) is not None
    later(expected, 2.0)
    later(other.motion, 2.0)
    assert told_apart(bodies, expected, other, 2.0, 0.0, 0.0) is None


def test_all_may_be_astray_together_when_the_camera_turned_more_than_was_told() -> None:
    def told(astray_px: float, others_px: float) -> Extent | None:
        expected, other = target(), walked(X + 120.0, X + 120.0)
        for motion in (expected, other.motion):
            later(motion, 0.5)
        found = told_apart([mine(astray_px), body(X + 120.0 + others_px)], expected, other, 0.5, 0.0, 0.0)
        return None if found is None else found.target

    def mine(astray_px: float) -> Extent:
        return body(X + astray_px)

    assert told(0.0, 0.0) == mine(0.0)
    assert told(-50.0, -50.0) == mine(-50.0)
    assert told(50.0, -50.0) is None, "each astray by itself"
    assert told(-90.0, -90.0) is None, "the passer is nearer to where the target should be"
