"""The comparators are right on data of their own assumptions, and refuse what they cannot answer."""

from __future__ import annotations

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from mission.errors import EstimateRefused
from mission.estimate import ConstantVelocity, Estimator
from mission.records import NoiseModel, TargetPrior
from sitl.evaluation.accuracy.flights import SimulatedFlight, Walk, gauss_markov, out_and_back, s_pattern, simulate
from sitl.evaluation.accuracy.programme import squared_miss
from sitl.evaluation.comparators import stone_soup
from sitl.evaluation.comparators.bearing_angle import BearingAngle
from sitl.evaluation.comparators.filter_problem import START_RANGE_M, filter_problem, inflation
from sitl.evaluation.comparators.ground_ray import GroundRay
from sitl.evaluation.comparators.least_squares import LeastSquares
from sitl.evaluation.comparators.stone_soup import StoneSoup

SILENT = NoiseModel(*(0.0,) * 12)
FAINT = replace(SILENT, pixel_sigma_px=0.1, size_sigma=0.01)
WHITE = replace(SILENT, pixel_sigma_px=1.0, size_sigma=0.02)
FEET_DOWN = 0.5 * 1.75 - 1.5

needs_stone_soup = pytest.mark.skipif(
    importlib.util.find_spec("stonesoup") is None, reason="Stone Soup is not installed"
)
FILTERS = [
    pytest.param(StoneSoup("EKF"), marks=needs_stone_soup, id="EKF"),
    pytest.param(StoneSoup("UKF"), marks=needs_stone_soup, id="UKF"),
    pytest.param(BearingAngle(), id="bearing-angle"),
]


def noise_free(depth_m: float, velocity: tuple[float, float, float], rate_hz: float = 10.0) -> SimulatedFlight:
    walk = Walk(depth_m, velocity, above_camera_m=FEET_DOWN)
    return simulate(s_pattern(rate_hz), walk, np.random.default_rng(0), noise=SILENT, told=FAINT)


@pytest.mark.parametrize("method", FILTERS)
@pytest.mark.parametrize(("depth_m", "velocity"), [(9.0, (0.0, 0.0, 0.0)), (12.0, (-0.4, 0.3, 0.0))])
def test_a_filter_finds_the_target_without_noise(
    method: Estimator, depth_m: float, velocity: tuple[float, float, float]
) -> None:
    sim = noise_free(depth_m, velocity, rate_hz=5.0)
    estimate = method.estimate(sim.flight)
    assert estimate.depth_m == pytest.approx(depth_m, rel=0.01)
    np.testing.assert_allclose(estimate.position_enu_m, sim.target_m[-1], atol=0.01 * depth_m)
    assert estimate.velocity_enu_m_s is not None
    np.testing.assert_allclose(estimate.velocity_enu_m_s, sim.velocity_m_s[-1], atol=0.03)


@pytest.mark.parametrize("method", FILTERS)
def test_a_filters_ellipse_is_right_for_white_noise(method: Estimator) -> None:
    rng = np.random.default_rng(3)
    squared = []
    for _ in range(16):
        # Where the start's range is about right: from 9 m the EKF's linearisation fails for noise as small as this.
        sim = simulate(s_pattern(3.0), Walk(13.0, (0.3, 0.2, 0.0)), rng, noise=WHITE)
        squared.append(squared_miss(method.estimate(sim.flight), sim))
    assert 0.8 < np.mean(np.array(squared, dtype=float)) < 4.0  # chi-square, 2 degrees of freedom: 2


def test_the_angular_size_adds_to_the_bearings() -> None:
    sim = noise_free(10.0, (0.0, -0.6, 0.0))
    silent_sizes = tuple(replace(s, height_px=None) if i else s for i, s in enumerate(sim.flight.sightings))
    with_sizes = BearingAngle().estimate(sim.flight)
    without = BearingAngle().estimate(replace(sim.flight, sightings=silent_sizes))
    assert with_sizes.covariance is not None
    assert without.covariance is not None
    assert np.linalg.det(with_sizes.covariance[:2, :2]) < np.linalg.det(without.covariance[:2, :2])


def test_the_ground_ray_is_exact_on_flat_ground_with_a_true_attitude() -> None:
    for pitch in (0.0, 0.3):
        sim = simulate(
            out_and_back(),
            Walk(8.0, above_camera_m=FEET_DOWN),
            np.random.default_rng(1),
            noise=SILENT,
            pitch_down_rad=pitch,
        )
        estimate = GroundRay().estimate(sim.flight)
        assert estimate.depth_m == pytest.approx(8.0, rel=1e-9)
        np.testing.assert_allclose(estimate.position_enu_m[:2], sim.target_m[0, :2], atol=1e-8)


def test_the_ground_ray_believes_a_tilted_horizon() -> None:
    tilted = replace(SILENT, tilt_bias_sigma_rad=0.009)
    rng = np.random.default_rng(2)
    walk = Walk(9.0, above_camera_m=FEET_DOWN)
    errors = [
        GroundRay().estimate(simulate(out_and_back(1.0), walk, rng, noise=tilted).flight).depth_m / 9.0 - 1.0
        for _ in range(200)
    ]
    # (Z / h + h / Z) e, to first order.
    assert np.median(np.abs(errors)) == pytest.approx(0.6745 * (9.0 / 1.5 + 1.5 / 9.0) * 0.009, rel=0.2)


def test_the_ground_ray_refuses_the_sky_and_a_target_without_a_foot() -> None:
    sim = simulate(out_and_back(), Walk(8.0, above_camera_m=3.0), np.random.default_rng(1), noise=SILENT)
    with pytest.raises(EstimateRefused, match="does not meet the ground"):
        GroundRay().estimate(sim.flight)
    no_size = simulate(out_and_back(), Walk(8.0), np.random.default_rng(1), sizes=lambda _: False)
    with pytest.raises(EstimateRefused, match="no foot"):
        GroundRay().estimate(no_size.flight)


def test_least_squares_ends_where_the_batch_does() -> None:
    sim = simulate(out_and_back(3.0), Walk(7.0, (0.3, -0.2, 0.0)), np.random.default_rng(5))
    theirs, ours = LeastSquares().estimate(sim.flight), ConstantVelocity().estimate(sim.flight)
    assert theirs.depth_m == pytest.approx(ours.depth_m, rel=2e-3)
    np.testing.assert_allclose(theirs.position_enu_m, ours.position_enu_m, atol=0.02)


def test_least_squares_refuses_what_its_residuals_do_not_cover() -> None:
    sim = simulate(out_and_back(2.0), Walk(7.0), np.random.default_rng(5), prior=TargetPrior(1.0, 0.05, 0.005))
    with pytest.raises(EstimateRefused):
        LeastSquares().estimate(sim.flight)


def test_filters_start_at_the_range_prior_on_the_first_line_of_sight() -> None:
    problem = filter_problem(noise_free(9.0, (0.0, 0.0, 0.0)).flight)
    mean, covariance = problem.start()
    np.testing.assert_allclose(mean[:3] / START_RANGE_M, problem.direction[0])
    along = problem.direction[0] @ covariance[:3, :3] @ problem.direction[0]
    draws = np.exp(np.random.default_rng(0).uniform(np.log(2.0), np.log(30.0), 200_000))
    assert draws.mean() == pytest.approx(START_RANGE_M, rel=0.01)
    assert np.sqrt(along) == pytest.approx(draws.std(), rel=0.01)
    # Height over range, not over depth.
    assert problem.angular_size[0] == pytest.approx(1.75 / np.hypot(9.0, FEET_DOWN), rel=1e-9)


def test_the_inflation_keeps_the_variance_of_a_mean() -> None:
    t, rng = np.arange(0.0, 40.0, 0.1), np.random.default_rng(6)
    means = [gauss_markov(t, 0.3, rng).mean() for _ in range(300)]
    assert np.var(means) == pytest.approx(inflation(0.1, 0.3, len(t)) / len(t), rel=0.25)
    assert inflation(0.1, 0.0, 10) == 1.0


@pytest.mark.parametrize("method", FILTERS)
def test_two_sightings_are_refused(method: Estimator) -> None:
    flight = noise_free(9.0, (0.0, 0.0, 0.0)).flight
    with pytest.raises(EstimateRefused, match="too few"):
        method.estimate(replace(flight, sightings=flight.sightings[:2]))


def test_without_stone_soup_its_filters_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stone_soup, "installed", lambda: False)
    with pytest.raises(EstimateRefused, match="Stone Soup is not installed"):
        StoneSoup("EKF").estimate(noise_free(9.0, (0.0, 0.0, 0.0)).flight)
