"""The offset between two curves of a rotation, one of which wanders as a real autopilot's heading does."""

from __future__ import annotations

import numpy as np
import pytest

from mission.camera.rate_match import RateMatch
from mission.records import Matrix, Vector

FRAMES_S = np.arange(0.0, 2.6, 0.05)
FINE_S = np.arange(-1.0, 4.0, 0.02)


def turned(t_s: Vector) -> Vector:
    """Twenty degrees within one and a half seconds, smoothly begun and ended."""
    part = np.clip((t_s - 0.4) / 1.5, 0.0, 1.0)
    return np.asarray(0.35 * part**2 * (3.0 - 2.0 * part))


def measured(
    offset_s: float, wander_rad: float, seed: int, outliers: int = 0, gain: float = 1.0
) -> tuple[float, float, float]:
    """Error, stated standard deviation and gain of one simulated turn."""
    rng = np.random.default_rng(seed)
    lag = np.abs(FINE_S[:, None] - FINE_S[None, :]) / 1.8
    shape = (1.0 + lag) * np.exp(-lag) + 1e-9 * np.eye(len(FINE_S))
    told = turned(FINE_S) + wander_rad * np.linalg.cholesky(shape) @ rng.normal(size=len(FINE_S))
    spans = np.stack([FRAMES_S[:-1], FRAMES_S[1:]], axis=1) + offset_s
    seen = gain * np.diff(turned(FRAMES_S)) + 5e-4 * rng.normal(size=len(spans))
    seen[rng.choice(len(spans), outliers, replace=False)] += 0.02

    def reported(at: Matrix) -> Vector:
        return np.asarray(np.interp(at[:, 1], FINE_S, told) - np.interp(at[:, 0], FINE_S, told))

    match = RateMatch(spans, seen, reported)
    found_s = match.best_offset(-0.2, 0.6)
    found_gain, _, sigma_s = match.quality(found_s)
    return found_s - offset_s, sigma_s, found_gain


@pytest.mark.parametrize("wander_rad", [0.0, 0.01, 0.02])
def test_the_offset_is_found_to_10_ms_and_its_sigma_is_true(wander_rad: float) -> None:
    found = np.array([measured(0.02 * k, wander_rad, k) for k in range(16)])
    assert np.sqrt(np.mean(found[:, 0] ** 2)) < 0.010
    assert np.mean(np.square(found[:, 0] / found[:, 1])) < 2.5


def test_a_few_wild_pairs_do_not_move_it() -> None:
    found = np.array([measured(0.1, 0.01, k, outliers=3) for k in range(8)])
    assert np.sqrt(np.mean(found[:, 0] ** 2)) < 0.010


def test_a_wrong_focal_length_shows_in_the_gain() -> None:
    error_s, _, gain = measured(0.1, 0.003, 1, gain=1.25)
    assert gain == pytest.approx(1.25, abs=0.06)
    assert abs(error_s) < 0.010
