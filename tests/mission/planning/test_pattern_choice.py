"""The pattern that is chosen in flight for a wanted accuracy."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pydantic import ValidationError

from mission.camera.camera import Camera
from mission.planning.bound import duration_s
from mission.planning.pattern_choice import chosen_pattern
from mission.planning.planner import SideRoom
from mission.records import NoiseModel, TargetPrior
from mission.settings import PatternSettings

CAMERA = Camera.from_field_of_view(640, 480, math.radians(64.0))
ROOM = SideRoom(15.0, 15.0, 2.0, 3.0, 60.0)


def chosen(range_m: float, room: SideRoom = ROOM, **pattern: Any) -> tuple[PatternSettings, str]:
    settings = PatternSettings.model_validate(pattern)
    return chosen_pattern(settings, range_m, CAMERA, NoiseModel(), TargetPrior(), room)


def test_without_a_wanted_accuracy_the_pattern_is_flown_as_it_is_set() -> None:
    assert chosen(10.0, length_m=3.0) == (PatternSettings(length_m=3.0), "")
    assert chosen(2.0, length_m=3.0)[0].length_m == pytest.approx(1.8)


def test_more_accuracy_takes_more_flight() -> None:
    coarse, fine = (chosen(12.0, accuracy_percent=percent, length_m=10.0)[0] for percent in (10.0, 5.0))
    assert fine.length_m > coarse.length_m
    assert duration_s(fine) > duration_s(coarse)


@pytest.mark.parametrize("side", ["left", "right"])
def test_it_never_goes_further_than_the_length_or_to_the_other_side(side: str) -> None:
    for percent in (1.0, 4.0, 10.0):
        pattern, _ = chosen(20.0, accuracy_percent=percent, length_m=2.5, side=side)
        assert pattern.length_m <= 2.5
        assert pattern.side == side
        assert pattern.kind == "out-and-back"


def test_what_cannot_be_had_is_said_and_the_time_stays_worth_it() -> None:
    pattern, said = chosen(20.0, accuracy_percent=0.5, length_m=3.0)
    assert "0.5 % cannot be had in this room" in said
    assert duration_s(pattern) < 25.0


def test_no_room_at_all_leaves_the_settings_pattern_and_says_why() -> None:
    pattern, said = chosen(10.0, SideRoom(0.5, 0.5, 2.0, 3.0, 60.0), accuracy_percent=5.0)
    assert pattern.length_m == 3.0
    assert "no pattern is chosen" in said


def test_the_papers_pattern_has_no_accuracy_to_choose() -> None:
    with pytest.raises(ValidationError, match="accuracy_percent"):
        PatternSettings.model_validate({"kind": "paper", "accuracy_percent": 5.0})
