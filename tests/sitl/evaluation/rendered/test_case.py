"""Drawn flights past people who walk as people do."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sitl.evaluation.rendered.case import NEAREST_M, WALKED_S, drawn_cases, nearest_m
from sitl.evaluation.rendered.scenes import scenario
from sitl.people.world import World


@pytest.mark.parametrize("number", range(4))
def test_real_like_people_are_at_the_case_s_distance_when_the_pattern_begins(number: int) -> None:
    case = next(drawn_cases(1, seed=5, noise="wide", first=number, walks="real-like"))
    assert nearest_m(case) >= NEAREST_M
    world = World(scenario(case))
    east, north, _ = world.person_centroid(0, 0.0, -WALKED_S).tolist()
    assert math.hypot(east, north) == pytest.approx(case.distance_m, abs=0.1)
    places = np.array([world.person_centroid(0, t, -WALKED_S)[:2] for t in np.arange(0.0, 6.0, 0.5)])
    assert np.hypot(*places.T).min() > NEAREST_M - 0.6


def test_straight_cases_are_what_they_were() -> None:
    case = next(drawn_cases(1, seed=5))
    assert case.walks is None
    assert "straight" not in case.name
