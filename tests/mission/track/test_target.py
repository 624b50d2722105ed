"""What may be the target, and what of a body that is partly out of the picture can be measured."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.records import Box
from mission.track.measure import Extent
from mission.track.motion import Motion
from mission.track.target import Target, meets, told_apart

HEIGHT = 200.0
PLACE = (320.0, 240.0)


def body(
    x: float = PLACE[0], top: float = 140.0, bottom: float = 340.0, *, head: bool = True, feet: bool = True
) -> Extent:
    """A body in an upright camera's picture."""
    middle = (x, 0.5 * (top + bottom))
    box = Box(x - 30.0, top, 60.0, bottom - top)
    return Extent(middle, (x, top), (x, bottom), bottom - top, 0.8, head, feet, True, box)


def target() -> Target:
    motion = Motion(PLACE, HEIGHT, 0.01, 0.03)
    looks = np.ones((2, 4), np.float32)
    return Target(0.0, motion, motion, motion, 0.0, looks, None, 0.0, 0.0, 0.0, whole_s=0.0)


@pytest.mark.parametrize(
    ("seen", "middle"),
    [
        (body(), PLACE),
        (body(bottom=290.0, feet=False), PLACE),
        (body(top=200.0, head=False), PLACE),
        (body(top=200.0, bottom=290.0, head=False, feet=False), None),
    ],
    ids=["whole", "feet-out", "head-out", "both-out"],
)
def test_the_middle_comes_from_the_end_that_is_in_the_picture(seen: Extent, middle: tuple[float, float] | None) -> None:
    assert seen.middle(HEIGHT, 0.0) == middle


def test_the_middle_of_half_a_body_lies_along_the_rolled_upright() -> None:
    roll = 0.3
    down = np.array([math.sin(roll), math.cos(roll)])
    ends = [PLACE + side * 0.5 * HEIGHT * down for side in (-1.0, 1.0)]
    top, bottom = ((float(end[0]), float(end[1])) for end in ends)
    box = Box(0.0, 0.0, 1.0, 1.0)
    for head in (True, False):
        seen = Extent((0.0, 0.0), top, bottom, 120.0, 0.8, head, not head, True, box)
        assert seen.middle(HEIGHT, roll) == pytest.approx(PLACE)


def test_half_a_body_may_be_the_target_by_its_visible_end() -> None:
    assert target().may_be(body(top=230.0, head=False), 0.0)
    assert not target().may_be(body(top=230.0, bottom=340.0), 0.0), "somebody of half the height"
    assert not target().may_be(body(top=230.0, bottom=460.0, head=False), 0.0), "feet far too low"


def test_a_height_may_have_changed_while_it_was_not_seen() -> None:
    nearer = body(top=240.0 - 140.0, bottom=240.0 + 140.0)
    assert not target().may_be(nearer, 0.0)
    assert target().may_be(nearer, 0.0, unseen_s=1.0)


def test_a_shadow_at_the_feet_is_told_from_a_person_who_comes_nearer() -> None:
    assert target().stretched(body(bottom=360.0), 0.0)
    assert not target().stretched(body(top=130.0, bottom=350.0), 0.0), "grows both ways"
    assert not target().stretched(body(bottom=345.0), 0.0), "within the box's noise"


def test_a_long_shadow_is_believed_to_be_the_body_at_last() -> None:
    one = target()
    one.t_s = 2.0
    assert not one.stretched(body(bottom=360.0), 0.0)


@pytest.mark.parametrize(("aside_px", "met"), [(40.0, True), (-40.0, True), (80.0, False)])
def test_people_meet_when_they_are_about_to_cover_each_other(aside_px: float, met: bool) -> None:
    assert meets(body(PLACE[0] + aside_px), np.array(PLACE), HEIGHT) is met


def test_people_of_the_same_looks_are_told_apart_by_place_or_not_at_all() -> None:
    mine, near, far = body(PLACE[0] + 8.0), body(PLACE[0] + 30.0), body(PLACE[0] - 120.0)
    assert told_apart([far, mine], target(), 0.0) is mine
    assert told_apart([near, mine], target(), 0.0) is None, "they still cover each other"
    halfway = [body(PLACE[0] - 32.0), body(PLACE[0] + 30.0)]
    assert told_apart(halfway, target(), 0.0) is None, "it could be either"
    gone = [far, body(PLACE[0] + 150.0)]
    assert told_apart(gone, target(), 0.0) is None, "nobody is where the target should be"


def test_a_foretold_place_is_believed_less_and_less() -> None:
    mine, far = body(PLACE[0] + 8.0), body(PLACE[0] - 120.0)
    later = target()
    later.t_s = 1.5
    assert told_apart([far, mine], later, 0.0) is None
    nearer = body(PLACE[0] - 120.0, top=80.0, bottom=400.0)
    assert told_apart([nearer, mine], later, 0.0) is mine, "a height is foretold better"


def test_the_other_one_s_height_is_learned_from_who_cannot_be_the_target() -> None:
    one = target()
    mine, nearer = body(), body(top=90.0, bottom=390.0)
    assert told_apart([mine], one, 0.0) is None
    assert told_apart([nearer], one, 0.0) is None
    assert told_apart([mine], one, 0.0) is mine


def test_somebody_alone_after_a_meeting_may_hide_the_target_unless_heights_differ() -> None:
    assert told_apart([body()], target(), 0.0) is None
    one = target()
    one.met_size = 0.4
    mine = body()
    assert told_apart([mine], one, 0.0) is mine
    assert told_apart([body(top=90.0, bottom=390.0)], one, 0.0) is None, "the other one"
