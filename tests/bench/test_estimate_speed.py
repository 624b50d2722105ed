"""How long one solution takes: `pytest tests/bench --benchmark-only`."""

from __future__ import annotations

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from mission.estimate import Batch, ConstantVelocity
from mission.estimate.batch import estimate_together
from mission.estimate.bound import bound
from mission.estimate.noise_fit import fit_noise
from mission.records import FlightSightings, TargetPrior
from sitl.evaluation.accuracy.flights import PAPER_CAMERA, SimulatedFlight, Walk, out_and_back, simulate
from sitl.evaluation.accuracy.repeated import repeated_passes
from sitl.evaluation.comparators.least_squares import LeastSquaresProblem


def flight_of(count: int, *, wrong_share: float = 0.0) -> SimulatedFlight:
    pattern = out_and_back(rate_hz=(count - 1) / 6.0)
    return simulate(pattern, Walk(9.0, (0.4, 0.2, 0.0)), np.random.default_rng(1), wrong_share=wrong_share)


@pytest.mark.parametrize("count", [60, 121, 600])
def test_batch(benchmark: BenchmarkFixture, count: int) -> None:
    sim = flight_of(count)
    estimate = benchmark(Batch().estimate, sim.flight)
    assert estimate.depth_m == pytest.approx(sim.depth_m, rel=0.15)


@pytest.mark.parametrize("count", [60, 121, 600])
def test_constant_velocity(benchmark: BenchmarkFixture, count: int) -> None:
    sim = flight_of(count)
    estimate = benchmark(ConstantVelocity().estimate, sim.flight)
    assert estimate.depth_m == pytest.approx(sim.depth_m, rel=0.15)


def test_batch_with_a_tenth_of_wrong_sightings(benchmark: BenchmarkFixture) -> None:
    sim = flight_of(60, wrong_share=0.1)
    estimate = benchmark(Batch().estimate, sim.flight)
    assert estimate.depth_m == pytest.approx(sim.depth_m, rel=0.15)


def test_scipy_least_squares_on_the_same_residuals(benchmark: BenchmarkFixture) -> None:
    sim = flight_of(60)
    problem = LeastSquaresProblem(sim.flight)
    state = benchmark.pedantic(problem.solve, rounds=2, iterations=1)  # type: ignore[no-untyped-call]
    ours = ConstantVelocity().estimate(sim.flight)
    assert float(np.hypot(*state.border[:2])) == pytest.approx(ours.depth_m, rel=0.02)


def test_fit_noise(benchmark: BenchmarkFixture) -> None:
    flight: FlightSightings = flight_of(60).flight
    assert benchmark(fit_noise, flight).pixel_sigma_px > 0.0


def test_two_passes_together(benchmark: BenchmarkFixture) -> None:
    first, second = repeated_passes(
        out_and_back(), (8.0,), Walk(9.0, (0.4, 0.2, 0.0)), np.random.default_rng(1), between_psd_m2_s3=0.02
    )
    estimate = benchmark(estimate_together, (first.flight, second.flight))
    assert estimate.depth_m == pytest.approx(second.depth_m, rel=0.15)


def test_bound(benchmark: BenchmarkFixture) -> None:
    pattern = out_and_back()
    path = pattern.left_ahead_up_m * (-1.0, 1.0, 1.0)
    target, velocity = np.array([0.0, 9.0, -0.6]), np.zeros(3)
    noise = flight_of(60).flight.noise
    result = benchmark(bound, pattern.t_s, path, target, velocity, PAPER_CAMERA, noise, TargetPrior())
    assert 0.0 < result.relative_depth_sigma < 0.1
