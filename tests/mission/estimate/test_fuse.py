"""Carrying an estimate on: repeated passes narrow the ellipse, a gap widens it, and it stays true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mission.errors import EstimateRefused
from mission.estimate import Batch
from mission.estimate.fuse import Carried, carry_on
from mission.records import FlightSightings
from sitl.accuracy.flights import Pattern, SimulatedFlight, Walk, out_and_back, simulate


def passes(
    seed: int, velocity: tuple[float, float, float] = (0.3, 0.2, 0.0)
) -> tuple[SimulatedFlight, list[FlightSightings]]:
    """One long flight of three passes with pauses, cut into its passes."""
    one = out_and_back()
    times = np.concatenate([one.t_s + 8.0 * i for i in range(3)])
    pattern = Pattern("three passes", times, np.tile(one.left_ahead_up_m, (3, 1)))
    sim = simulate(pattern, Walk(9.0, velocity), np.random.default_rng(seed))
    third = len(one.t_s)
    cut = [sim.flight.sightings[i * third : (i + 1) * third] for i in range(3)]
    return sim, [replace(sim.flight, sightings=part) for part in cut]


def ellipse(covariance: object) -> float:
    return float(np.sqrt(np.linalg.det(np.asarray(covariance)[:2, :2])))


def test_the_first_pass_is_the_batch() -> None:
    _, (flight, *_) = passes(0)
    estimate, carried = carry_on(flight)
    batch = Batch().estimate(flight)
    np.testing.assert_array_equal(estimate.position_enu_m, batch.position_enu_m)
    # Position and velocity are the batch's, but relative to where the reports have walked to since the first sighting.
    walked_m = flight.noise.position_walk_m_per_sqrt_s * np.sqrt(6.0)
    assert 0.0 < np.abs(carried.mean[:3] - batch.position_enu_m).max() < 3.0 * walked_m
    assert batch.velocity_enu_m_s is not None
    assert batch.covariance is not None
    np.testing.assert_allclose(carried.mean[3:6], batch.velocity_enu_m_s, atol=1e-9)
    np.testing.assert_allclose(carried.covariance[3:6, 3:6], batch.covariance[3:, 3:], atol=1e-9)


def test_without_a_walk_the_batch_is_carried_as_it_is() -> None:
    _, (flight, *_) = passes(0)
    flight = replace(flight, noise=replace(flight.noise, position_walk_m_per_sqrt_s=0.0))
    _, carried = carry_on(flight)
    batch = Batch().estimate(flight)
    assert batch.covariance is not None
    np.testing.assert_allclose(carried.mean[:3], batch.position_enu_m, atol=1e-9)
    np.testing.assert_allclose(carried.covariance[:6, :6], batch.covariance, atol=1e-9)


def test_repeated_passes_narrow_the_ellipse() -> None:
    for seed in range(5):
        carried: Carried | None = None
        areas = []
        for flight in passes(seed, (0.0, 0.0, 0.0))[1]:
            estimate, carried = carry_on(flight, carried)
            areas.append(ellipse(estimate.covariance))
        assert areas[1] < 0.9 * areas[0]
        assert areas[2] < areas[1]


def test_a_gap_widens_it() -> None:
    _, carried = carry_on(passes(1)[1][0])
    sizes = [ellipse(carried.at(carried.t_s + gap, 0.02, 0.03).covariance) for gap in (0.0, 1.0, 5.0, 30.0)]
    assert sizes == sorted(sizes)
    assert sizes[-1] > 20.0 * sizes[0]


def test_three_passes_are_right_about_their_own_errors() -> None:
    squared = []
    for seed in range(40):
        rng = np.random.default_rng(seed + 500)
        sim, flights = passes(seed + 100, (0.5 * rng.standard_normal(), 0.5 * rng.standard_normal(), 0.0))
        carried: Carried | None = None
        for flight in flights:
            estimate, carried = carry_on(flight, carried)
        miss = (estimate.position_enu_m - sim.target_m[-1])[:2]
        assert estimate.covariance is not None
        squared.append(miss @ np.linalg.solve(estimate.covariance[:2, :2], miss))
    assert 1.0 < np.mean(squared) < 3.0
    assert np.mean(np.array(squared) < 5.99) > 0.85


def test_following_without_parallax_lives_on_what_was_carried() -> None:
    _, flights = passes(2)
    _, carried = carry_on(flights[0])
    still = tuple(replace(s, position_enu_m=flights[1].sightings[0].position_enu_m) for s in flights[1].sightings[:20])
    estimate, _ = carry_on(replace(flights[1], sightings=still), carried)
    assert np.isfinite(estimate.position_enu_m).all()
    with pytest.raises(EstimateRefused):
        carry_on(replace(flights[1], sightings=still))


def test_two_sightings_are_too_few_for_a_pass() -> None:
    _, flights = passes(3)
    with pytest.raises(EstimateRefused, match="too few"):
        carry_on(replace(flights[0], sightings=flights[0].sightings[:2]))
