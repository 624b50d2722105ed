"""The noise level that a flight supports: a good pose is believed, a bad one is not, and the ellipse holds on both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mission.estimate import Batch
from mission.estimate.noise_fit import fit_noise, rescaled, with_fitted_noise
from mission.estimate.noise_likelihood import first_order_sigma, random_walk_intensity, smooth
from mission.records import NoiseModel
from sitl.evaluation.accuracy.flights import Walk, out_and_back, s_pattern, simulate

GOOD = replace(NoiseModel(), heading_sigma_rad=0.0038, tilt_sigma_rad=0.0015, position_walk_m_per_sqrt_s=0.025)
ROUGH = replace(NoiseModel(), heading_sigma_rad=0.025, tilt_sigma_rad=0.010, position_walk_m_per_sqrt_s=0.11)


STEADIED = replace(
    NoiseModel(),
    heading_sigma_rad=0.0027,
    heading_bias_sigma_rad=0.0075,
    tilt_sigma_rad=0.0006,
    tilt_bias_sigma_rad=0.0006,
    position_sigma_m=0.0055,
    position_walk_m_per_sqrt_s=0.0032,
)
"""What the background achieves."""


def fitted_over(noise: NoiseModel, count: int) -> tuple[list[NoiseModel], float]:
    """The fitted models, and the share of final positions inside of their 95 % ellipse."""
    rng = np.random.default_rng(8)
    models, inside = [], 0
    for i in range(count):
        pattern = out_and_back() if i % 2 else s_pattern(rate_hz=7.4)
        walk = Walk((5.0, 7.0, 9.0, 12.0)[i % 4], (0.4, 0.2, 0.0))
        sim = simulate(pattern, walk, rng, noise=noise, told=NoiseModel())
        models.append(fit_noise(sim.flight))
        estimate = Batch().estimate(rescaled(sim.flight, models[-1]))
        assert estimate.covariance is not None
        miss = (estimate.position_enu_m - sim.target_m[-1])[:2]
        inside += bool(miss @ np.linalg.solve(estimate.covariance[:2, :2], miss) < 5.99)
    return models, inside / count


def middle(models: list[NoiseModel], name: str) -> float:
    return float(np.median([getattr(model, name) for model in models]))


def test_a_good_pose_is_believed_and_a_rough_one_is_not() -> None:
    good, inside_good = fitted_over(GOOD, 24)
    rough, inside_rough = fitted_over(ROUGH, 24)
    assert inside_good > 0.85
    assert inside_rough > 0.7
    for name in ("heading_sigma_rad", "tilt_sigma_rad", "position_walk_m_per_sqrt_s"):
        assert middle(rough, name) > 2.0 * middle(good, name)
    assert middle(good, "heading_sigma_rad") < 0.01


def test_what_the_background_achieved_stands() -> None:
    flight = simulate(out_and_back(), Walk(8.0), np.random.default_rng(1), noise=STEADIED).flight
    assert with_fitted_noise(flight, steadied=True) == flight


def test_a_background_that_moves_widens_the_ellipse() -> None:
    crooked = replace(STEADIED, heading_sigma_rad=0.03)
    inside, sigmas = 0, []
    for seed in range(12):
        true, told = (
            Batch().estimate(
                simulate(out_and_back(), Walk(6.0), np.random.default_rng(seed), noise=noise, told=STEADIED).flight
            )
            for noise in (crooked, STEADIED)
        )
        target = simulate(out_and_back(), Walk(6.0), np.random.default_rng(seed), noise=crooked).target_m[-1]
        assert true.covariance is not None
        assert told.covariance is not None
        miss = (true.position_enu_m - target)[:2]
        inside += bool(miss @ np.linalg.solve(true.covariance[:2, :2], miss) < 5.99)
        sigmas.append(np.linalg.det(true.covariance[:2, :2]) / np.linalg.det(told.covariance[:2, :2]))
    assert inside >= 8
    assert np.median(sigmas) > 4.0


def test_a_sharper_and_a_coarser_detector_are_told_apart() -> None:
    def pixel_and_size(factor: float) -> tuple[float, float]:
        noise = replace(NoiseModel(), pixel_sigma_px=factor * 1.5, size_sigma=factor * 0.04)
        models, _ = fitted_over(noise, 10)
        return middle(models, "pixel_sigma_px"), middle(models, "size_sigma")

    sharp, coarse = pixel_and_size(0.4), pixel_and_size(2.0)
    assert sharp[0] < 1.5 < coarse[0]
    assert sharp[1] == pytest.approx(0.016, rel=0.3)
    assert coarse[1] == pytest.approx(0.08, rel=0.3)


def test_a_flight_without_an_answer_keeps_its_stated_noise() -> None:
    flight = simulate(out_and_back(), Walk(9.0), np.random.default_rng(0)).flight
    for sightings in ((), flight.sightings[:2]):
        assert fit_noise(replace(flight, sightings=sightings)) == flight.noise
    still = tuple(replace(s, position_enu_m=(0.0, 0.0, 1.5)) for s in flight.sightings)
    assert fit_noise(replace(flight, sightings=still)) == flight.noise


def test_rescaling_keeps_the_ratios_of_single_sightings() -> None:
    flight = simulate(out_and_back(), Walk(9.0), np.random.default_rng(0)).flight
    own = replace(flight.sightings[0], pixel_sigma_px=3.0, size_sigma=0.1)
    scaled = rescaled(replace(flight, sightings=(own, *flight.sightings[1:])), NoiseModel(pixel_sigma_px=3.0))
    assert scaled.sightings[0].pixel_sigma_px == pytest.approx(6.0)
    assert scaled.sightings[0].size_sigma == pytest.approx(0.1)
    assert scaled.sightings[1].pixel_sigma_px is None


def test_first_order_processes_have_the_smooth_ones_power_at_the_stated_rate() -> None:
    lag = np.linspace(0.0, 60.0, 600_001)
    rate, tau = 1.4, 1.6
    power = 2.0 * np.trapezoid(smooth(lag, tau) * np.cos(rate * lag), lag)
    sigma = first_order_sigma(1.0, tau, 2.0, rate)
    assert power == pytest.approx(2.0 * np.trapezoid(sigma**2 * np.exp(-lag / 2.0) * np.cos(rate * lag), lag), rel=1e-4)
    assert power == pytest.approx((random_walk_intensity(1.0, tau, rate) / rate) ** 2, rel=1e-4)
