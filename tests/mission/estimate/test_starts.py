"""Wrong sightings are found before anything depends on them, however restless the attitude is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mission.estimate import ConstantVelocity
from mission.estimate.observations import observe
from mission.estimate.starts import find_starts
from mission.records import NoiseModel
from sitl.evaluation.accuracy.flights import Walk, out_and_back, simulate

RESTLESS = replace(
    NoiseModel(),
    heading_sigma_rad=0.035,
    heading_correlation_s=5.0,
    tilt_sigma_rad=0.019,
    tilt_correlation_s=5.0,
    position_walk_m_per_sqrt_s=0.09,
)
"""2 degrees of wander, 18 px: more than some wrong sightings are off."""


@pytest.mark.parametrize("noise", [NoiseModel(), RESTLESS], ids=["calm", "restless"])
@pytest.mark.parametrize("rate_hz", [8.0, 20.0])
def test_right_sightings_are_kept(noise: NoiseModel, rate_hz: float) -> None:
    for seed in range(12):
        walk = Walk((4.0, 9.0, 20.0)[seed % 3], (0.5, -0.2, 0.0))
        flight = simulate(out_and_back(rate_hz), walk, np.random.default_rng(seed), noise=noise).flight
        assert find_starts(observe(flight), noise, flight.prior).right.mean() > 0.98


def test_wrong_ones_are_found_where_the_attitude_wanders_further_than_they_are_off() -> None:
    found = wrong = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        sim = simulate(out_and_back(20.0), Walk(9.0, (0.4, 0.2, 0.0)), rng, noise=RESTLESS, wrong_share=0.1)
        right = find_starts(observe(sim.flight), RESTLESS, sim.flight.prior).right
        found, wrong = found + int((~right & sim.wrong).sum()), wrong + int(sim.wrong.sum())
    assert found > 0.88 * wrong  # the rest at the minimum


@pytest.mark.parametrize("length", [1, 2, 3, 4])
def test_a_short_run_of_wrong_sightings_is_one_jump(length: int) -> None:
    sim = simulate(out_and_back(20.0), Walk(9.0), np.random.default_rng(3), noise=RESTLESS)
    sightings = list(sim.flight.sightings)
    for k in range(50, 50 + length):
        u, v = sightings[k].pixel
        sightings[k] = replace(sightings[k], pixel=(u + 70.0, v))
    flight = replace(sim.flight, sightings=tuple(sightings))
    right = find_starts(observe(flight), RESTLESS, flight.prior).right
    assert np.flatnonzero(~right).tolist() == list(range(50, 50 + length))


def test_a_restless_flight_with_a_tenth_of_wrong_sightings_is_as_exact_as_without() -> None:
    clean: list[float] = []
    spoilt: list[float] = []
    for seed in range(9):
        walk = Walk((5.5, 9.0, 15.0)[seed % 3], (0.4, 0.2, 0.0))
        for share, errors in ((0.0, clean), (0.1, spoilt)):
            rng = np.random.default_rng(seed)
            sim = simulate(out_and_back(20.0), walk, rng, noise=RESTLESS, wrong_share=share)
            errors.append(abs(ConstantVelocity().estimate(sim.flight).depth_m / sim.depth_m - 1.0))
    assert np.median(spoilt) < 1.5 * np.median(clean)
    assert np.max(spoilt) < 1.5 * np.max(clean)
