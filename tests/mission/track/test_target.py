"""What may be the target, and what of a body that is partly out of the picture can be measured."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.records import Box
from mission.track.crowd import Body, Crowd
from mission.track.detections import BodyDetection
from mission.track.motion import Motion
from mission.track.target import Target
from mission.track.walk import Seen

HEIGHT = 200.0
PLACE = (320.0, 240.0)


def body(
    x: float = PLACE[0], top: float = 140.0, bottom: float = 340.0, *, head: bool = True, feet: bool = True
) -> BodyDetection:
    """A body in an upright camera's picture."""
    middle = (x, 0.5 * (top + bottom))
    box = Box(x - 30.0, top, 60.0, bottom - top)
    return BodyDetection(middle, (x, top), (x, bottom), bottom - top, 0.8, head, feet, True, box)


def target() -> Target:
    looks = np.ones((2, 4), np.float32)
    crowd = Crowd(Body(Seen(*PLACE, math.log(HEIGHT)), looks, HEIGHT), 0.0)
    motion = Motion(PLACE, HEIGHT, 0.01, 0.03)
    return Target(0.0, motion, crowd, None, seen_s=0.0, agreed_s=0.0, height_s=0.0, whole_s=0.0, look_s=0.0)


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
def test_the_middle_comes_from_the_end_that_is_in_the_picture(
    seen: BodyDetection, middle: tuple[float, float] | None
) -> None:
    assert seen.middle(HEIGHT, 0.0) == middle


def test_the_middle_of_half_a_body_lies_along_the_rolled_upright() -> None:
    roll = 0.3
    down = np.array([math.sin(roll), math.cos(roll)])
    ends = [PLACE + side * 0.5 * HEIGHT * down for side in (-1.0, 1.0)]
    top, bottom = ((float(end[0]), float(end[1])) for end in ends)
    box = Box(0.0, 0.0, 1.0, 1.0)
    for head in (True, False):
        seen = BodyDetection((0.0, 0.0), top, bottom, 120.0, 0.8, head, not head, True, box)
        assert seen.middle(HEIGHT, roll) == pytest.approx(PLACE)


def test_half_a_body_may_be_the_target_by_its_visible_end() -> None:
    assert target().may_be(body(top=230.0, head=False), 0.0)
    assert not target().may_be(body(top=230.0, bottom=340.0), 0.0), "somebody of half the height"
    assert not target().may_be(body(top=230.0, bottom=460.0, head=False), 0.0), "feet far too low"


def around(height: float) -> BodyDetection:
    return body(top=240.0 - 0.5 * height, bottom=240.0 + 0.5 * height)


def test_a_box_may_hold_too_much_for_a_moment_but_not_somebody_much_nearer() -> None:
    assert target().may_be(around(250.0), 0.0)
    assert not target().may_be(around(280.0), 0.0)


def test_a_shadow_at_the_feet_is_told_from_a_person_who_comes_nearer() -> None:
    assert target().stretched(body(bottom=360.0), 0.0)
    assert not target().stretched(body(top=130.0, bottom=350.0), 0.0), "grows both ways"
    assert not target().stretched(body(bottom=345.0), 0.0), "within the box's noise"


def test_a_long_shadow_is_believed_to_be_the_body_at_last() -> None:
    one = target()
    one.t_s = 2.0
    assert not one.stretched(body(bottom=360.0), 0.0)
