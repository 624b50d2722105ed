"""The minimisation ends in the minimum, with factors from beside it, and takes few factorisations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mission.estimate import gauss_newton
from mission.estimate.gauss_newton import minimise
from mission.estimate.joint_model import JointModel, State
from mission.estimate.observations import observe
from mission.estimate.starts import find_starts
from mission.records import NoiseModel, TargetPrior
from sitl.evaluation.accuracy.flights import Walk, out_and_back, simulate


def started(rate_hz: float, seed: int = 1, psd: float = 0.0) -> tuple[JointModel, State]:
    prior = TargetPrior(acceleration_psd_m2_s3=psd)
    flight = simulate(
        out_and_back(rate_hz), Walk(9.0, (0.4, 0.2, 0.0)), np.random.default_rng(seed), prior=prior
    ).flight
    seen = observe(flight)
    start = find_starts(seen, flight.noise, flight.prior).starts[0]
    model = JointModel(seen, flight.noise, flight.prior)
    return model, model.start(start.position_m, start.velocity_m_s, start.log_size)


def size_of(model: JointModel, state: State) -> float:
    """Half the gradient's length in units of its own scale: zero at a minimum."""
    at = model.linearise(state)
    assert at is not None
    chain, border = model.gradient(at)
    factored, _, _ = model.normal_equations(at)
    step = factored.solve(chain, border)
    return float(np.concatenate((chain, border)) @ np.concatenate(step))


@pytest.mark.parametrize("psd", [0.0, 0.01])
def test_the_gradient_is_that_of_the_cost(psd: float) -> None:
    model, state = started(3.0, psd=psd)
    rng = np.random.default_rng(0)
    chain = 0.1 * rng.standard_normal(state.chain.shape)
    direction = State(rng.standard_normal(state.chain.shape), 0.1 * rng.standard_normal(state.border.shape))
    step = 1e-5

    def cost(share: float) -> float:
        at = model.linearise(State(chain + share * direction.chain, state.border + share * direction.border))
        assert at is not None
        return at.cost

    at = model.linearise(State(chain, state.border))
    assert at is not None
    by_chain, by_border = model.gradient(at)
    slope = 2.0 * (by_chain @ direction.chain.reshape(-1) + by_border @ direction.border)
    assert (cost(step) - cost(-step)) / (2.0 * step) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("rate_hz", [4.0, 10.0, 50.0])
@pytest.mark.parametrize("psd", [0.0, 0.01])
def test_it_ends_in_the_minimum(rate_hz: float, psd: float) -> None:
    for seed in range(3):
        model, start = started(rate_hz, seed, psd)
        found = minimise(model, start)
        exact = minimise(model, start, tolerance=1e-9)
        assert found.converged
        assert size_of(model, found.at.state) < 2.0 * gauss_newton.CONVERGED
        assert exact.at.cost <= found.at.cost < exact.at.cost + 2.0 * gauss_newton.CONVERGED


def test_the_covariance_is_that_of_the_minimum() -> None:
    for seed in range(5):
        model, start = started(10.0, seed)
        found, exact = (minimise(model, start, tolerance=tolerance) for tolerance in (5e-3, 1e-9))
        there = model.normal_equations(exact.at)[0].border_covariance()
        scale = np.sqrt(np.diag(there))
        off = (found.factored.border_covariance() - there) / np.outer(scale, scale)
        assert np.abs(off).max() < 0.05


def test_many_sightings_take_no_more_factorisations_than_few() -> None:
    counts = [minimise(*started(rate_hz)).steps for rate_hz in (10.0, 100.0)]
    assert counts[1] <= counts[0] + 3
    assert max(counts) <= 7


def test_what_one_step_cannot_do_is_told() -> None:
    model, start = started(10.0)
    noisy = JointModel(model.seen, replace(NoiseModel(), position_sigma_m=0.2), TargetPrior())
    stopped = minimise(noisy, noisy.start(start.border[:3], np.zeros(3), float(start.border[6])), max_steps=1)
    assert not stopped.converged
    assert stopped.steps == 1
