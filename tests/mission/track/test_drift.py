"""The filter of place and size."""

from __future__ import annotations

import numpy as np
import pytest

from mission.track.drift import DriftFilter
from mission.track.motion import Motion


def test_a_steady_change_is_followed_without_lag_and_noise_is_reduced() -> None:
    rng = np.random.default_rng(1)
    drift = DriftFilter(0.0, 0.03, 0.15, 1.0)
    errors, raw = [], []
    for k in range(1, 200):
        t = 0.05 * k
        drift.predict(0.05, 0.15)
        if k % 2:
            noise = 0.03 * rng.standard_normal()
            raw.append(noise)
            drift.update(0.1 * t + noise, 0.03)
        if k > 40:
            errors.append(drift.value - 0.1 * t)
    assert abs(np.mean(errors)) < 0.01
    assert np.std(errors) < 0.7 * np.std(raw)


def test_one_wild_measurement_moves_it_little_and_good_ones_bring_it_back() -> None:
    drift = DriftFilter(0.0, 0.03, 0.15, 1.0)
    for _ in range(20):
        drift.predict(0.1, 0.15)
        drift.update(0.0, 0.03)
    drift.predict(0.1, 0.15)
    drift.update(0.4, 0.03)
    assert abs(drift.value) < 0.06
    for _ in range(8):
        drift.predict(0.1, 0.15)
        drift.update(0.0, 0.03)
    assert abs(drift.value) < 0.02


def test_it_never_locks_itself_out_after_a_run_of_wrong_measurements() -> None:
    drift = DriftFilter(0.0, 0.03, 0.15, 1.0)
    for value in [0.3] * 6 + [0.0] * 15:
        drift.predict(0.1, 0.15)
        drift.update(value, 0.03)
    assert abs(drift.value) < 0.03


def test_uncertainty_grows_while_nothing_is_measured() -> None:
    motion = Motion((320.0, 240.0), 100.0, 0.01, 0.03)
    before = motion.sigma_px.max()
    for _ in range(20):
        motion.predict(0.05, (0.0, 0.0))
    assert motion.sigma_px.max() > 10 * before


def test_the_cameras_own_rotation_is_no_motion_of_the_person() -> None:
    motion = Motion((320.0, 240.0), 100.0, 0.01, 0.03)
    for k in range(1, 30):
        motion.predict(0.05, (12.0, -3.0))
        motion.see(0, 320.0 + 12.0 * k, 0.01)
        motion.see(1, 240.0 - 3.0 * k, 0.01)
    motion.predict(0.05, (0.0, 0.0))
    assert motion.pixel == pytest.approx((320.0 + 12.0 * 29, 240.0 - 3.0 * 29), abs=0.2)
