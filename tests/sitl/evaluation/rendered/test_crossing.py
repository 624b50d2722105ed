"""Somebody in the target's clothes walks through; drawn people differ in body and gait."""

from __future__ import annotations

import numpy as np
import pytest

from sitl.evaluation.rendered.case import WALKED_S, drawn_cases
from sitl.evaluation.rendered.crossing import walked
from sitl.evaluation.rendered.scenes import scenario
from sitl.people.world import World


@pytest.mark.parametrize("number", range(6))
def test_the_two_meet_on_the_line_of_sight_in_the_same_clothes(number: int) -> None:
    case = next(drawn_cases(1, seed=3, scene="crossing", first=number))
    made = scenario(case)
    target, passer = made.people
    assert target.clothes == passer.clothes
    assert target.clothes.shirt is not None
    world = World(made)
    # The drone stays within its pattern, so from the start the two are seen within its width of each other.
    off = []
    for t_s in np.arange(0.0, 2.0 * case.flown.leg_duration_s, 0.1):
        places = [world.person_centroid(i, float(t_s), -WALKED_S)[:2] for i in (0, 1)]
        azimuths = [np.arctan2(*place) for place in places]
        off.append(abs(np.angle(np.exp(1j * (azimuths[0] - azimuths[1])))))
    assert min(off) < np.arctan(case.flown.length_m / 2.5)
    assert max(off) > 0.1


def test_who_walks_from_before_the_pattern_is_where_they_should_be() -> None:
    np.testing.assert_allclose(walked(-WALKED_S + 0.3, 2.0, 0.4), 0.0, atol=1e-12)
    np.testing.assert_allclose(walked(0.0, 1.0, np.pi / 2), [1.2, 0.0], atol=1e-12)


def test_drawn_people_are_broad_and_slight_tall_and_small_and_step_as_they_like() -> None:
    cases = list(drawn_cases(40, seed=11))
    for values, low, high in (
        ([c.build for c in cases], 0.85, 1.2),
        ([c.stride for c in cases], 0.85, 1.15),
        ([c.height_m for c in cases], 1.5, 1.95),
    ):
        assert low <= min(values) < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < max(values) <= high


def test_a_broad_body_is_broader_and_as_tall_and_its_planted_foot_stays() -> None:
    case = next(drawn_cases(1, seed=5))
    made = scenario(case)
    plain = made.people[0].model_copy(update={"build": 1.0, "speed_m_s": 0.8})
    spans = {}
    for build in (1.0, 1.2):
        world = World(made.model_copy(update={"people": (plain.model_copy(update={"build": build}),)}))
        surface = world.person_surface(0, 1.0, -WALKED_S)
        spans[build] = np.linalg.svd(surface - surface.mean(axis=0), compute_uv=False), np.ptp(surface[:, 2])
        times = np.arange(1.0, 2.5, 0.02)
        feet = np.array([world.person_surface(0, float(t), -WALKED_S) for t in times])
        planted = np.diff(feet, axis=0)[:, :, :2][(feet[1:, :, 2] < 0.004) & (feet[:-1, :, 2] < 0.004)]
        assert np.median(np.hypot(*planted.T)) < 0.1 * 0.8 * 0.02
    assert spans[1.2][0][2] > 1.1 * spans[1.0][0][2]
    assert spans[1.2][1] == pytest.approx(spans[1.0][1], rel=0.02)
