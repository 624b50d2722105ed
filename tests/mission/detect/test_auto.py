"""Whom HOG and NanoDet together take for a person."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from mission.detect.auto import AutoDetector
from mission.records import Box, Detection, Image

PICTURE = np.zeros((480, 640, 3), np.uint8)
PERSON = Box(300.0, 100.0, 90.0, 240.0)


@dataclass
class Sees:
    """Finds what it is told."""

    boxes: tuple[Box, ...] = ()
    score: float = 1.0
    name: str = "told"
    regions: list[Box | None] = field(default_factory=list)

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        self.regions.append(region)
        return [Detection(box, self.score) for box in self.boxes]


def seen(hog: tuple[Box, ...], network: tuple[Box, ...]) -> list[Box]:
    return [d.box for d in AutoDetector(Sees(hog), Sees(network)).detect(PICTURE)]


def test_what_both_see_is_hog_s() -> None:
    wide = Box(290.0, 90.0, 110.0, 260.0)
    assert seen((wide,), (PERSON,)) == [wide]


@pytest.mark.parametrize(
    "wrong",
    [
        Box(60.0, 100.0, 90.0, 240.0),  # a tree
        Box(300.0, 100.0, 60.0, 120.0),  # half of the body
        Box(330.0, 200.0, 20.0, 60.0),  # something on the body
    ],
)
def test_where_hog_sees_something_else_the_network_is_believed(wrong: Box) -> None:
    assert seen((wrong,), (PERSON,)) == [PERSON]


def test_of_hog_s_boxes_only_the_confirmed_ones_stay() -> None:
    assert seen((Box(60.0, 100.0, 90.0, 240.0), PERSON), (PERSON,)) == [PERSON]


def test_whom_the_network_alone_sees_is_there_too_if_it_is_sure() -> None:
    other = Box(80.0, 120.0, 80.0, 200.0)
    assert seen((PERSON,), (PERSON, other)) == [PERSON, other]
    unsure = AutoDetector(Sees((PERSON,)), Sees((PERSON, other), score=0.45))
    assert [d.box for d in unsure.detect(PICTURE)] == [PERSON]


def test_one_who_sees_nobody_leaves_it_to_the_other() -> None:
    assert seen((PERSON,), ()) == [PERSON]
    assert seen((), (PERSON,)) == [PERSON]
    assert seen((), ()) == []


def test_both_look_in_the_region_asked_for() -> None:
    hog, network = Sees(), Sees()
    AutoDetector(hog, network).detect(PICTURE, PERSON)
    assert hog.regions == network.regions == [PERSON]
