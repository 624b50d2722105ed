"""Who is who, from boxes with places, sizes and colours alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.track.appearance import Histogram
from mission.track.crowd import Body, Crowd, Told
from mission.track.walk import Seen, Walk

HEIGHT = 80.0
LOOK_S = 0.14
STILL = (0.0, 0.0)


def looks(kind: int) -> Histogram:
    """Colours of which those of another kind share a little."""
    answer = np.full((2, 6), 0.01, np.float32)
    answer[:, kind] = 0.95
    return answer


def body(x_px: float, kind: int, y_px: float = 200.0, height_px: float = HEIGHT) -> Body:
    return Body(Seen(x_px, y_px, math.log(height_px)), looks(kind), height_px)


def shown(_: Walk) -> bool:
    return True


class Film:
    """Looks one after the other."""

    def __init__(self, target: Body) -> None:
        self.crowd, self.t_s = Crowd(target, 0.0), 0.0

    def look(self, *bodies: Body) -> Told:
        self.t_s += LOOK_S
        self.crowd.predict(LOOK_S, STILL, STILL)
        return self.crowd.look(bodies, self.t_s, shown)


def together(kinds: tuple[int, int], *, swapped: bool = False) -> list[tuple[float, float | None, Told]]:
    """Two walk towards each other, one box is seen while they pass, then two: the target's and the other's place."""
    film = Film(body(100.0, kinds[0]))
    answer: list[tuple[float, float | None, Told]] = []
    for k in range(1, 30):
        own, other = 100.0 + 8.0 * k, 340.0 - 8.0 * k
        if abs(own - other) < 30.0:
            # The other one is in front.
            answer.append((own, other, film.look(body(other, kinds[1], 202.0))))
            continue
        if swapped and own > other:
            own, other = other, own
        answer.append((own, other, film.look(body(other, kinds[1], 202.0), body(own, kinds[0]))))
    return answer


def test_people_of_different_looks_who_pass_are_told_apart_again() -> None:
    told = together((0, 3))
    assert [t.box for *_, t in told[-6:]] == [1] * 6
    assert all(t.probability > 0.97 for *_, t in told[-6:])


def test_who_turns_back_at_the_meeting_is_known_by_the_looks() -> None:
    told = together((0, 3), swapped=True)
    assert [t.box for *_, t in told[-6:]] == [1] * 6


def test_of_people_of_the_same_looks_nobody_is_surely_the_target_while_one_box_is_seen() -> None:
    told = together((2, 2))
    hidden = [t for own, other, t in told if other is not None and abs(own - other) < 30.0]
    assert any(t.probability < 0.9 or t.box is None for t in hidden)
    # Afterwards it is who went on: the wrong one is never sure.
    assert all(t.box == 1 for own, other, t in told if t.probability > 0.97 and t.box is not None)


def test_somebody_else_who_appears_where_the_target_was_is_not_taken_for_it() -> None:
    film = Film(body(100.0, 0))
    for _ in range(8):
        assert film.look(body(100.0, 0)).box == 0
    told = [film.look(body(112.0, 4)) for _ in range(6)]
    assert not any(t.box == 0 and t.probability > 0.9 for t in told[2:])


def test_a_neighbour_is_not_taken_for_a_target_that_is_hidden() -> None:
    film = Film(body(100.0, 0))
    for k in range(10):
        film.look(body(100.0, 0), body(150.0 + k, 0))
    told = [film.look(body(160.0 + k, 0)) for k in range(12)]
    assert not any(t.box == 0 and t.probability > 0.9 for t in told)


def test_who_comes_back_from_behind_a_post_is_followed_on() -> None:
    film = Film(body(100.0, 0))
    for k in range(1, 12):
        film.look(body(100.0 + 6.0 * k, 0))
    for _ in range(8):
        assert film.look().box is None
    told = [film.look(body(172.0 + 6.0 * (8 + k), 0)) for k in range(2)]
    assert told[-1].box == 0
    assert told[-1].probability > 0.97


@pytest.mark.parametrize("count", [1, 6, 12])
def test_the_weights_are_probabilities_however_many_people_there_are(count: int) -> None:
    film = Film(body(0.0, 0))
    rng = np.random.default_rng(count)
    for _ in range(5):
        people = [body(60.0 * k + float(rng.normal(0.0, 3.0)), k % 4) for k in range(count)]
        told = film.look(*people)
    assert told.box == 0
    assert 0.9 < told.probability <= 1.0 + 1e-9
    assert len(told.others) == count - 1
