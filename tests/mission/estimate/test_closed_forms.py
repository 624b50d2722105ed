"""The closed forms: the paper's equations, and agreement with `constant-velocity` on noise-free data."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mission.errors import EstimateRefused
from mission.estimate import ESTIMATORS, ConstantVelocity
from mission.records import NoiseModel, TargetPrior
from sitl.evaluation.accuracy.flights import (
    PAPER_BASELINES_M,
    Pattern,
    SimulatedFlight,
    Walk,
    out_and_back,
    paper_pattern,
    s_pattern,
    simulate,
)

SILENT = NoiseModel(*(0.0,) * 12)
TOLD = replace(SILENT, pixel_sigma_px=0.05)
LEFT = float(np.sum(PAPER_BASELINES_M))


def noise_free(pattern: Pattern, velocity: tuple[float, float, float], depth_m: float = 14.0) -> SimulatedFlight:
    return simulate(
        pattern,
        Walk(depth_m, velocity),
        np.random.default_rng(0),
        noise=SILENT,
        told=TOLD,
        prior=TargetPrior(speed_sigma_m_s=1e4),
        sizes=lambda _: False,
    )


@pytest.mark.parametrize(
    ("method", "pattern", "velocity"),
    [
        ("stereo", paper_pattern(), (0.0, 0.0, 0.0)),
        ("stereo", out_and_back(), (0.0, 0.0, 0.0)),
        ("classical", paper_pattern(), (0.0, 0.0, 0.0)),
        ("classical", s_pattern(), (0.0, 0.0, 0.0)),
        ("three-image", paper_pattern(), (0.6, 0.0, 0.0)),
        ("three-image", paper_pattern(), (-0.6, 0.0, 0.0)),
        ("three-image", out_and_back(), (0.6, 0.0, 0.0)),
        ("four-image", out_and_back(), (0.4, -0.3, 0.0)),
        ("four-image", s_pattern(), (-0.4, 0.3, 0.0)),
        ("four-image", paper_pattern(), (0.4, 0.4, 0.0)),
    ],
)
def test_a_closed_form_agrees_with_the_batch_on_its_own_case(
    method: str, pattern: Pattern, velocity: tuple[float, float, float]
) -> None:
    sim = noise_free(pattern, velocity)
    closed, batch = ESTIMATORS[method].estimate(sim.flight), ConstantVelocity().estimate(sim.flight)
    assert closed.depth_m == pytest.approx(sim.depth_m, rel=1e-9)
    assert closed.depth_m == pytest.approx(batch.depth_m, rel=1e-6)
    np.testing.assert_allclose(closed.position_enu_m, sim.target_m[-1], atol=1e-9)
    np.testing.assert_allclose(closed.position_enu_m, batch.position_enu_m, rtol=1e-6, atol=1e-6)
    assert closed.method == method
    assert closed.covariance is None


@pytest.mark.parametrize("speed", [0.6, -0.6])
def test_three_images_reproduce_the_papers_equation_5(speed: float) -> None:
    sim = noise_free(paper_pattern(), (speed, 0.0, 0.0), depth_m=20.0)
    pixels = [s.pixel[0] - 320.0 for s in sim.flight.sightings]
    # Level flight without roll: with the picture's roll taken out, tan(theta) is the horizontal offset over f.
    level = noise_free(paper_pattern(), (speed, 0.0, 0.0), depth_m=20.0)
    tangent_1 = (speed * 0.5) / 20.0
    tangent_n = (speed * 5.0 + LEFT) / 20.0
    assert pytest.approx(LEFT / (tangent_n - 10.0 * tangent_1)) == 20.0
    assert len(pixels) == 11
    assert ESTIMATORS["three-image"].estimate(level.flight).depth_m == pytest.approx(
        LEFT / (tangent_n - 10.0 * tangent_1), rel=1e-9
    )


def test_on_a_perpendicular_walk_the_stereo_depth_is_the_one_at_the_last_image() -> None:
    sim = noise_free(paper_pattern(), (0.0, -0.6, 0.0))
    assert ESTIMATORS["stereo"].estimate(sim.flight).depth_m == pytest.approx(14.0 - 0.6 * 5.0, rel=1e-9)


def test_closed_forms_name_their_assumption() -> None:
    sim = noise_free(out_and_back(), (0.0, 0.0, 0.0))
    for name in ("stereo", "classical", "three-image", "four-image"):
        assert any("assumes" in note for note in ESTIMATORS[name].estimate(sim.flight).notes)


@pytest.mark.parametrize("method", ["stereo", "classical", "three-image", "four-image"])
def test_closed_forms_refuse_what_they_cannot_answer(method: str) -> None:
    sim = noise_free(out_and_back(), (0.0, 0.0, 0.0))
    estimator = ESTIMATORS[method]
    with pytest.raises(EstimateRefused, match="too few"):
        estimator.estimate(replace(sim.flight, sightings=sim.flight.sightings[:1]))
    still = tuple(replace(s, position_enu_m=(0.0, 0.0, 1.5)) for s in sim.flight.sightings)
    with pytest.raises(EstimateRefused):
        estimator.estimate(replace(sim.flight, sightings=still))


def test_constant_velocity_flight_cannot_be_told_from_a_walking_target() -> None:
    t = np.arange(0.0, 6.0, 0.2)
    one_way = Pattern("one way", t, np.column_stack((0.5 * t, 0.0 * t, 0.0 * t)))
    sim = noise_free(one_way, (0.2, 0.1, 0.0))
    with pytest.raises(EstimateRefused, match="parallax"):
        ESTIMATORS["four-image"].estimate(sim.flight)


def test_the_papers_figure_for_the_edge_of_the_picture() -> None:
    assert math.degrees(math.atan(320.0 / 516.5)) == pytest.approx(31.78, abs=0.01)
