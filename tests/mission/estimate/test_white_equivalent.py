"""Smooth errors of the reported path: correlated picture noise stated as white takes the bias out of the depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mission.estimate import Batch
from mission.estimate.noise_likelihood import random_walk_intensity
from mission.estimate.white_equivalent import white_equivalent
from mission.records import FlightSightings, NoiseModel
from sitl.accuracy.flights import Walk, out_and_back, simulate
from sitl.accuracy.smooth_path import smooth_path


def test_a_mean_is_as_uncertain_as_before() -> None:
    flight = simulate(out_and_back(20.0), Walk(9.0), np.random.default_rng(1)).flight
    stated = white_equivalent(flight)
    steps, noise = 0.05, NoiseModel()
    times = np.arange(4000) * steps
    first_order = np.exp(-np.abs(times - times[2000]) / noise.pixel_correlation_s).sum() * noise.pixel_sigma_px**2
    assert stated.noise.pixel_correlation_s == stated.noise.size_correlation_s == 0.0
    assert stated.noise.pixel_sigma_px**2 == pytest.approx(first_order, rel=1e-6)
    assert stated.sightings[7].pixel_sigma_px == pytest.approx(stated.noise.pixel_sigma_px)
    assert stated.sightings[7].size_sigma == pytest.approx(stated.noise.size_sigma)


def test_nothing_but_the_stated_noise_of_the_pictures_changes() -> None:
    flight = simulate(out_and_back(20.0), Walk(9.0), np.random.default_rng(1)).flight
    stated = white_equivalent(flight)
    back = tuple(replace(s, pixel_sigma_px=None, size_sigma=None) for s in stated.sightings)
    pictures = {name: getattr(flight.noise, name) for name in ("pixel_sigma_px", "pixel_correlation_s")}
    pictures |= {name: getattr(flight.noise, name) for name in ("size_sigma", "size_correlation_s")}
    assert replace(stated, sightings=back, noise=replace(stated.noise, **pictures)) == flight


def test_a_sighting_after_a_gap_counts_for_more() -> None:
    flight = simulate(out_and_back(20.0), Walk(9.0), np.random.default_rng(1)).flight
    gap = replace(flight, sightings=flight.sightings[:40] + flight.sightings[80:])
    sigmas = [s.pixel_sigma_px or 0.0 for s in white_equivalent(gap).sightings]
    assert sigmas[40] < 0.5 * sigmas[20]
    assert sigmas[40] >= flight.noise.pixel_sigma_px


def test_white_noise_stays_as_it_is() -> None:
    noise = replace(NoiseModel(), pixel_correlation_s=0.0, size_correlation_s=0.0)
    flight = simulate(out_and_back(), Walk(9.0), np.random.default_rng(1), noise=noise).flight
    assert white_equivalent(flight).noise == noise
    assert white_equivalent(replace(flight, sightings=flight.sightings[:1])).sightings == flight.sightings[:1]


def smooth_flights(depth_m: float, count: int) -> list[tuple[float, FlightSightings]]:
    """True depths, and flights whose reported path errs by 0.15 m, smoothly, and that state a walk of that power."""
    pattern, silent = out_and_back(20.0), replace(NoiseModel(), position_sigma_m=0.0, position_walk_m_per_sqrt_s=0.0)
    walk = random_walk_intensity(0.15, 1.5, 1.4 * 2.0 * np.pi / 6.0)
    told = replace(silent, position_sigma_m=0.02, position_walk_m_per_sqrt_s=walk)
    flights = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        sim = simulate(pattern, Walk(depth_m, (0.4, 0.3, 0.0)), rng, noise=silent, told=told)
        flights.append((sim.depth_m, smooth_path(sim.flight, 0.15, 1.5, rng)))
    return flights


def test_a_smooth_path_s_bias_is_taken_out_and_the_sigma_is_true() -> None:
    errors, sigmas = [], []
    for depth, flight in smooth_flights(15.0, 40):
        as_stated, white = (Batch().estimate(f) for f in (flight, white_equivalent(flight)))
        errors.append([np.log(found.depth_m / depth) for found in (as_stated, white)])
        assert white.first is not None
        line = (white.first.position_enu_m - np.array(flight.sightings[0].position_enu_m))[:2]
        sigmas.append(float(np.sqrt(line @ white.first.covariance[:2, :2] @ line)) / float(line @ line))
    too_near, unbiased = np.mean(errors, axis=0)
    assert too_near < -0.06
    assert abs(unbiased) < 0.02
    assert 0.75 < np.std(errors, axis=0)[1] / np.mean(sigmas) < 1.25


def test_where_the_path_walks_as_stated_little_is_lost() -> None:
    errors = []
    for seed in range(40):
        sim = simulate(out_and_back(20.0), Walk(9.0, (0.4, 0.3, 0.0)), np.random.default_rng(seed))
        found = (Batch().estimate(flight) for flight in (sim.flight, white_equivalent(sim.flight)))
        errors.append([estimate.depth_m / sim.depth_m - 1.0 for estimate in found])
    as_stated, white = np.sqrt(np.mean(np.square(errors), axis=0))
    assert white < 1.15 * as_stated
