"""The joint model: its derivatives, its noise and its linear algebra, against plain dense ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mission.estimate.arrow import NotPositiveDefinite, factor
from mission.estimate.joint_model import JointModel, State
from mission.estimate.markov import gauss_markov, random_walk, white_noise_acceleration
from mission.estimate.observations import observe
from mission.records import FlightSightings, Matrix, NoiseModel, TargetPrior
from sitl.evaluation.accuracy.flights import PAPER_CAMERA, Walk, out_and_back, simulate

TIMES = np.array([0.0, 0.1, 0.15, 0.6, 2.0, 2.05])


def flight_of(sizes: str, psd: float, distortion: tuple[float, float, float, float, float]) -> FlightSightings:
    return simulate(
        out_and_back(rate_hz=1.5),
        Walk(6.0, (0.4, -0.2, 0.0)),
        np.random.default_rng(3),
        camera=replace(PAPER_CAMERA, distortion=distortion),
        heading_rad=0.3,
        prior=TargetPrior(acceleration_psd_m2_s3=psd),
        sizes={"all": lambda _: True, "none": lambda _: False, "some": lambda i: i % 3 == 0}[sizes],
    ).flight


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.2, 0.05, 0.001, -0.002, 0.0)], ids=["ideal", "distorted"])
@pytest.mark.parametrize("psd", [0.0, 0.005])
@pytest.mark.parametrize("sizes", ["all", "some", "none"])
def test_jacobians_agree_with_numerical_ones(
    sizes: str, psd: float, distortion: tuple[float, float, float, float, float]
) -> None:
    flight = flight_of(sizes, psd, distortion)
    model = JointModel(observe(flight), flight.noise, flight.prior)
    rng = np.random.default_rng(0)
    state = model.start(np.array([2.0, 5.0, -0.5]), np.array([0.3, -0.1, 0.0]), 0.5)
    state = State(state.chain + rng.standard_normal(state.chain.shape), state.border + 0.1 * rng.standard_normal(9))
    at = model.linearise(state)
    assert at is not None
    step = 1e-6
    for place in range(9):
        moved = state.border.copy()
        moved[place] += step
        ahead = model.linearise(State(state.chain, moved))
        assert ahead is not None
        numerical = (ahead.residual - at.residual) / step
        np.testing.assert_allclose(at.border_jacobian[:, :, place], numerical, rtol=1e-4, atol=2e-3)
    for place in range(model.block):
        chain = state.chain.copy()
        chain[:, place] += step
        ahead = model.linearise(State(chain, state.border))
        assert ahead is not None
        numerical = (ahead.residual - at.residual) / step
        np.testing.assert_allclose(at.chain_jacobian[:, :, place], numerical, rtol=1e-4, atol=2e-3)


@pytest.mark.parametrize("psd", [0.0, 0.005])
@pytest.mark.parametrize("sizes", ["all", "some", "none"])
def test_the_solved_step_is_where_the_gradient_of_the_cost_says(sizes: str, psd: float) -> None:
    flight = flight_of(sizes, psd, (0.0,) * 5)
    model = JointModel(observe(flight), flight.noise, flight.prior)
    state = model.start(np.array([2.0, 5.0, -0.5]), np.array([0.3, -0.1, 0.0]), 0.5)
    at = model.linearise(state)
    assert at is not None
    factored, chain, border = model.normal_equations(at)
    direction = np.random.default_rng(1).standard_normal(state.chain.shape), np.full(9, 0.01)
    step = 1e-5
    ahead = model.linearise(State(state.chain + step * direction[0], state.border + step * direction[1]))
    behind = model.linearise(State(state.chain - step * direction[0], state.border - step * direction[1]))
    assert ahead is not None
    assert behind is not None
    slope = (ahead.cost - behind.cost) / (2.0 * step)
    assert slope == pytest.approx(-2.0 * float(chain @ direction[0].reshape(-1) + border @ direction[1]), rel=1e-4)
    solved_chain, solved_border = factored.solve(chain, border)
    assert float(chain @ solved_chain + border @ solved_border) > 0.0


def covariance_of(diagonal: Matrix, off: Matrix) -> Matrix:
    return np.asarray(np.linalg.inv(np.diag(diagonal) + np.diag(off, -1) + np.diag(off, 1)))


def test_a_gauss_markov_precision_is_the_inverse_of_its_covariance() -> None:
    precision = gauss_markov(np.diff(TIMES), 0.3)
    expected = np.exp(-np.abs(TIMES[:, None] - TIMES) / 0.3)
    np.testing.assert_allclose(covariance_of(precision.diagonal, precision.off), expected, atol=1e-9)


def test_a_gauss_markov_process_without_correlation_is_white() -> None:
    precision = gauss_markov(np.diff(TIMES), 0.0)
    np.testing.assert_array_equal(covariance_of(precision.diagonal, precision.off), np.eye(6))


def test_a_random_walk_precision_is_the_inverse_of_its_covariance() -> None:
    precision = random_walk(np.diff(TIMES))
    expected = np.minimum(TIMES[:, None], TIMES)
    np.testing.assert_allclose(covariance_of(precision.diagonal, precision.off)[1:, 1:], expected[1:, 1:], atol=1e-9)


def test_white_noise_acceleration_has_the_textbook_covariance() -> None:
    diagonal, below = white_noise_acceleration(np.diff(TIMES))
    full = np.zeros((12, 12))
    for i in range(6):
        full[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = diagonal[i]
    for i in range(5):
        full[2 * i + 2 : 2 * i + 4, 2 * i : 2 * i + 2] = below[i]
        full[2 * i : 2 * i + 2, 2 * i + 2 : 2 * i + 4] = below[i].T
    covariance = np.linalg.inv(full)
    t = TIMES[-1]
    np.testing.assert_allclose(covariance[10:, 10:], [[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]], rtol=1e-6)


def test_the_arrow_is_solved_as_a_dense_matrix_would_be() -> None:
    rng = np.random.default_rng(5)
    count, size, border = 7, 4, 3
    dense = np.zeros((count * size + border,) * 2)
    for i in range(count - 1):
        rows = rng.standard_normal((30, 2 * size))
        dense[i * size : (i + 2) * size, i * size : (i + 2) * size] += rows.T @ rows
    rows = rng.standard_normal((60, count * size + border))
    dense[-border:] += (rows.T @ rows)[-border:]
    dense[:-border, -border:] = dense[-border:, :-border].T
    dense[-border:, -border:] += 500.0 * np.eye(border)
    blocks = dense[:-border, :-border].reshape(count, size, count, size).transpose(0, 2, 1, 3)
    every = np.arange(count)
    factored = factor(
        blocks[every, every], blocks[every[1:], every[:-1]], dense[:-border, -border:], dense[-border:, -border:]
    )
    right = rng.standard_normal(len(dense))
    chain, solved = factored.solve(right[:-border], right[-border:])
    inverse = np.linalg.inv(dense)
    np.testing.assert_allclose(np.concatenate((chain, solved)), inverse @ right, atol=1e-9)
    np.testing.assert_allclose(factored.border_covariance(), inverse[-border:, -border:], atol=1e-9)
    own, cross = factored.chain_covariance(np.array([24, 27]))
    np.testing.assert_allclose(own, inverse[np.ix_([24, 27], [24, 27])], atol=1e-9)
    np.testing.assert_allclose(cross, inverse[[24, 27], -border:], atol=1e-9)


def test_a_singular_arrow_is_refused() -> None:
    with pytest.raises(NotPositiveDefinite):
        factor(np.ones((3, 2, 2)), np.zeros((2, 2, 2)), np.zeros((6, 1)), np.eye(1))


def test_a_noise_of_zero_leaves_the_model_solvable() -> None:
    flight = flight_of("all", 0.0, (0.0,) * 5)
    silent = NoiseModel(*(0.0,) * 12)
    model = JointModel(observe(flight), silent, flight.prior)
    at = model.linearise(model.start(np.array([2.0, 5.0, -0.5]), np.zeros(3), 0.5))
    assert at is not None
    factored, _, _ = model.normal_equations(at)
    assert np.isfinite(factored.border_covariance()).all()
