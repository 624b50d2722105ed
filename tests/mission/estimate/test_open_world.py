"""A path that may be too long or turned as a whole: the same answer, an honest ellipse, and a file that keeps it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mission.estimate import ESTIMATORS
from mission.estimate.sightings_file import FlightProblem, read_flights, write_flight
from mission.records import Estimate, FlightSightings, Vector
from sitl.evaluation.accuracy.flights import SimulatedFlight, Walk, out_and_back, simulate

BATCH = ESTIMATORS["batch"]


@pytest.fixture(scope="module")
def flown() -> SimulatedFlight:
    """A person who walks, 9 m away, seen on the way out and back."""
    return simulate(out_and_back(), Walk(9.0, (0.5, 0.3, 0.0)), np.random.default_rng(4))


def told(flight: FlightSightings, **noise: float) -> Estimate:
    return BATCH.estimate(replace(flight, noise=replace(flight.noise, **noise)))


def sigma_along(estimate: Estimate, direction: Vector) -> float:
    """Of the first position, along a direction (3,)."""
    assert estimate.first is not None
    unit = direction / np.linalg.norm(direction)
    return float(np.sqrt(unit @ estimate.first.covariance @ unit))


def test_nothing_said_changes_nothing(flown: SimulatedFlight) -> None:
    plain, same = BATCH.estimate(flown.flight), told(flown.flight, position_scale_sigma=0.0)
    assert plain.covariance is not None
    assert same.covariance is not None
    assert np.array_equal(plain.covariance, same.covariance)


def test_an_unknown_scale_opens_the_depth_and_moves_nothing(flown: SimulatedFlight) -> None:
    plain, open_ = BATCH.estimate(flown.flight), told(flown.flight, position_scale_sigma=0.05)
    assert np.array_equal(plain.position_enu_m, open_.position_enu_m)
    assert plain.first is not None
    sight = plain.first.position_enu_m - np.array(flown.flight.sightings[0].position_enu_m)
    across = np.array([sight[1], -sight[0], 0.0])
    before, after = sigma_along(plain, sight), sigma_along(open_, sight)
    assert after == pytest.approx(np.hypot(before, 0.05 * np.linalg.norm(sight)), rel=0.02)
    assert sigma_along(open_, across) == pytest.approx(sigma_along(plain, across), rel=0.02)


def test_an_unknown_heading_opens_what_is_across_the_line_of_sight(flown: SimulatedFlight) -> None:
    plain, open_ = BATCH.estimate(flown.flight), told(flown.flight, world_heading_sigma_rad=0.05)
    assert plain.first is not None
    sight = (plain.first.position_enu_m - np.array(flown.flight.sightings[0].position_enu_m)) * [1.0, 1.0, 0.0]
    across = np.array([sight[1], -sight[0], 0.0])
    expected = np.hypot(sigma_along(plain, across), 0.05 * np.linalg.norm(sight))
    assert sigma_along(open_, across) == pytest.approx(expected, rel=0.02)
    assert sigma_along(open_, sight) == pytest.approx(sigma_along(plain, sight), rel=0.02)


def test_an_unknown_tilt_opens_the_height(flown: SimulatedFlight) -> None:
    up = np.array([0.0, 0.0, 1.0])
    plain, open_ = BATCH.estimate(flown.flight), told(flown.flight, world_tilt_sigma_rad=0.05)
    assert sigma_along(open_, up) == pytest.approx(np.hypot(sigma_along(plain, up), 0.05 * 9.0), rel=0.1)


def test_the_velocity_is_as_open_as_the_path(flown: SimulatedFlight) -> None:
    plain, open_ = BATCH.estimate(flown.flight), told(flown.flight, position_scale_sigma=0.2)
    assert plain.covariance is not None
    assert open_.covariance is not None
    assert plain.velocity_enu_m_s is not None
    added = (open_.covariance - plain.covariance)[3:, 3:]
    expected = 0.04 * np.outer(plain.velocity_enu_m_s, plain.velocity_enu_m_s)
    np.testing.assert_allclose(added, expected, atol=0.02 * np.abs(expected).max())


def test_the_file_keeps_it(flown: SimulatedFlight, tmp_path: Path) -> None:
    noise = replace(
        flown.flight.noise, position_scale_sigma=0.03, world_heading_sigma_rad=0.02, world_tilt_sigma_rad=0.01
    )
    flight = replace(flown.flight, noise=noise)
    write_flight(tmp_path / "flight.jsonl", flight)
    (read,) = read_flights(tmp_path / "flight.jsonl")
    assert not isinstance(read, FlightProblem)
    assert read.noise == noise
