"""The wandering errors of the simulated estimators."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sitl.gauss_markov import STILL, GaussMarkov, Wander


@pytest.mark.parametrize("order", [1, 2])
def test_a_gauss_markov_process_has_its_variance_and_its_correlation(order: int) -> None:
    tau, dt = 1.0, 0.05
    wander = Wander(2.0, tau, 1 if order == 1 else 2)
    process = GaussMarkov((wander,) * 400, dt, np.random.default_rng(0))
    rows = []
    for _ in range(400):
        process.step()
        rows.append(process.values)
    x = np.array(rows)
    assert x.std() == pytest.approx(2.0, rel=0.03)
    lag = round(tau / dt)
    found = float(np.mean(x[lag:] * x[:-lag]) / np.mean(x * x))
    expected = math.exp(-1.0) * (1.0 if order == 1 else 2.0)
    assert found == pytest.approx(expected, abs=0.03)


def test_a_process_that_stands_still_stays_at_zero() -> None:
    process = GaussMarkov((STILL, Wander(1.0, 1.0)), 0.01, np.random.default_rng(1))
    process.step()
    assert process.values[0] == 0.0
    assert process.values[1] != 0.0
