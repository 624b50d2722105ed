"""The offset between two curves of a rotation, one of which wanders as a real autopilot's heading does."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from mission.records import Matrix, Vector
from mission.timing.rate_match import RateMatch, best_offset
from mission.timing.reported_rotation import SMOOTH_S

FRAMES_S = np.arange(0.0, 2.6, 0.05)
FINE_S = np.arange(-1.0, 4.0, 0.02)


def turned(t_s: Vector) -> Vector:
    """Twenty degrees within one and a half seconds, smoothly begun and ended."""
    part = np.clip((t_s - 0.4) / 1.5, 0.0, 1.0)
    return np.asarray(0.35 * part**2 * (3.0 - 2.0 * part))


def slowly(t_s: Vector) -> Vector:
    """Ten degrees out and back within the whole time: what a pattern past a far target makes of the heading."""
    return np.asarray(0.09 * (1.0 - np.cos(2.0 * math.pi * t_s / 2.6)))


def curves(
    offset_s: float,
    wander_rad: float,
    seed: int,
    outliers: int = 0,
    gain: float = 1.0,
    movement: Callable[[Vector], Vector] = turned,
    walk: float = 0.0,
) -> RateMatch:
    """One simulated movement, seen and reported."""
    rng = np.random.default_rng(seed)
    lag = np.abs(FINE_S[:, None] - FINE_S[None, :]) / 1.8
    shape = (1.0 + lag) * np.exp(-lag) + 1e-9 * np.eye(len(FINE_S))
    told = movement(FINE_S) + wander_rad * np.linalg.cholesky(shape) @ rng.normal(size=len(FINE_S))
    if walk:
        told += walk * math.sqrt(0.02) * np.cumsum(np.random.default_rng([seed, 1]).normal(size=len(FINE_S)))
        # As `ReportedRotation` smooths them.
        told = gaussian_filter1d(told, SMOOTH_S / 0.02, mode="nearest", truncate=3.0)
    spans = np.stack([FRAMES_S[:-1], FRAMES_S[1:]], axis=1) + offset_s
    seen = gain * np.diff(movement(FRAMES_S)) + 5e-4 * rng.normal(size=len(spans))
    seen[rng.choice(len(spans), outliers, replace=False)] += 0.02

    def reported(at: Matrix) -> Vector:
        return np.asarray(np.interp(at[:, 1], FINE_S, told) - np.interp(at[:, 0], FINE_S, told))

    return RateMatch(spans, seen, reported)


def measured(
    offset_s: float,
    wander_rad: float,
    seed: int,
    outliers: int = 0,
    gain: float = 1.0,
    movement: Callable[[Vector], Vector] = turned,
    walk: float = 0.0,
) -> tuple[float, float, float]:
    """Error, stated standard deviation and gain of one simulated movement."""
    match = curves(offset_s, wander_rad, seed, outliers, gain, movement, walk)
    found_s = best_offset((match,), -0.2, 0.6)
    agreement = match.agreement(found_s)
    return found_s - offset_s, agreement.sigma_s, agreement.gain


@pytest.mark.parametrize("wander_rad", [0.0, 0.01, 0.02])
def test_the_offset_is_found_to_10_ms_and_its_sigma_is_true(wander_rad: float) -> None:
    found = np.array([measured(0.02 * k, wander_rad, k) for k in range(16)])
    assert np.sqrt(np.mean(found[:, 0] ** 2)) < 0.010
    assert np.mean(np.square(found[:, 0] / found[:, 1])) < 2.5


def test_a_tilt_that_walks_at_random_is_believed_as_little_as_it_deserves() -> None:
    found = np.array([measured(0.02 * k, 1e-4, k, movement=slowly, walk=0.0116) for k in range(16)])
    assert np.mean(np.square(found[:, 0] / found[:, 1])) < 2.5


def test_each_axis_adds_what_it_knows() -> None:
    """A heading that hardly tells, and a roll that does."""

    def error(k: int, *, both: bool) -> float:
        heading, roll = (curves(0.1, 0.03, k, movement=slowly), curves(0.1, 0.003, 50 + k))
        return best_offset((heading, roll) if both else (heading,), -0.2, 0.6) - 0.1

    alone, together = (np.array([error(k, both=both) for k in range(5)]) for both in (False, True))
    assert np.sqrt(np.mean(together**2)) < 0.5 * np.sqrt(np.mean(alone**2))


def test_a_few_wild_pairs_do_not_move_it() -> None:
    found = np.array([measured(0.1, 0.01, k, outliers=3) for k in range(8)])
    assert np.sqrt(np.mean(found[:, 0] ** 2)) < 0.010


def test_a_wrong_focal_length_shows_in_the_gain() -> None:
    error_s, _, gain = measured(0.1, 0.003, 1, gain=1.25)
    assert gain == pytest.approx(1.25, abs=0.06)
    assert abs(error_s) < 0.010
