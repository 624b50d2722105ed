"""Two looks running that show a person in the same place."""

from __future__ import annotations

from mission.detect import Confirmation
from mission.records import Box, Detection

HERE = Detection(Box(100.0, 50.0, 40.0, 100.0), 0.9)
A_LITTLE_ON = Detection(Box(108.0, 50.0, 40.0, 100.0), 0.8)
ELSEWHERE = Detection(Box(300.0, 50.0, 40.0, 100.0), 0.9)


def test_nobody_is_confirmed_by_the_first_look() -> None:
    assert Confirmation().confirmed([HERE]) == []


def test_who_stands_in_the_same_place_in_the_next_look_is_confirmed_as_seen_there() -> None:
    confirmation = Confirmation()
    confirmation.confirmed([HERE])
    assert confirmation.confirmed([A_LITTLE_ON, ELSEWHERE]) == [A_LITTLE_ON]


def test_a_look_that_shows_nobody_breaks_the_run() -> None:
    confirmation = Confirmation()
    confirmation.confirmed([HERE])
    confirmation.confirmed([])
    assert confirmation.confirmed([HERE]) == []


def test_who_is_confirmed_stays_so_while_every_look_shows_them() -> None:
    confirmation = Confirmation()
    confirmation.confirmed([HERE])
    assert [confirmation.confirmed([HERE]) for _ in range(3)] == [[HERE]] * 3
