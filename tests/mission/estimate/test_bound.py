"""The Cramer-Rao bound: the figures that decided the flight pattern, and how it answers to pattern and noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mission.errors import EstimateRefused
from mission.estimate.bound import Bound, bound
from mission.records import NoiseModel, TargetPrior
from sitl.evaluation.accuracy.flights import PAPER_CAMERA, Pattern, out_and_back, paper_pattern, s_pattern


def of(
    pattern: Pattern,
    *,
    depth_m: float = 9.0,
    noise: NoiseModel | None = None,
    sized: bool = True,
    velocity: tuple[float, float, float] = (0.6, 0.0, 0.0),
) -> Bound:
    return bound(
        pattern.t_s,
        pattern.left_ahead_up_m * (-1.0, 1.0, 1.0),
        np.array([0.0, depth_m, -0.6]),
        np.array(velocity),
        PAPER_CAMERA,
        noise or NoiseModel(),
        TargetPrior(),
        sized=sized,
    )


def test_out_and_back_beats_one_way_by_far() -> None:
    assert of(paper_pattern()).relative_depth_sigma > 2.5 * of(out_and_back()).relative_depth_sigma


def test_an_s_beats_an_out_and_back() -> None:
    assert of(s_pattern()).relative_depth_sigma < of(out_and_back()).relative_depth_sigma


def test_sizes_help_a_one_way_pattern_most() -> None:
    assert of(paper_pattern(), sized=False).depth_sigma_m > 1.5 * of(paper_pattern()).depth_sigma_m


def test_the_simplified_noise_of_the_design_table_gives_its_figures() -> None:
    # observability.md: 3 px, 0.10 m a frame, 4 % size, all white, no biases; out and back, heading on target.
    table = NoiseModel(3.0, 0.0, 0.04, 0.0, 0.10, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    pattern = out_and_back(rate_hz=10.0)
    for depth_m, percent in ((5.5, 2.1), (9.0, 2.1), (15.0, 2.4)):
        sigma = 100.0 * of(pattern, depth_m=depth_m, noise=table, sized=False).relative_depth_sigma
        assert sigma == pytest.approx(percent, rel=0.25)


def test_more_noise_never_helps() -> None:
    best = of(out_and_back()).depth_sigma_m
    for field in (
        "pixel_sigma_px",
        "size_sigma",
        "position_sigma_m",
        "position_walk_m_per_sqrt_s",
        "heading_sigma_rad",
    ):
        worse = replace(NoiseModel(), **{field: 3.0 * getattr(NoiseModel(), field)})
        assert of(out_and_back(), noise=worse).depth_sigma_m > best


def test_a_heading_bias_turns_the_answer_about_the_drone() -> None:
    turned = replace(NoiseModel(), heading_bias_sigma_rad=0.2)
    across = of(out_and_back(), noise=turned, velocity=(0.0, 0.0, 0.0)).first_covariance[0, 0]
    assert across > 3.0 * of(out_and_back(), velocity=(0.0, 0.0, 0.0)).first_covariance[0, 0]


def test_standing_still_determines_no_depth() -> None:
    still = replace(out_and_back(), left_ahead_up_m=np.zeros((61, 3)))
    with pytest.raises(EstimateRefused, match="does not determine"):
        of(still, sized=False, velocity=(0.0, 0.0, 0.0))
