"""The camera's true path given the reported one: aircraft fly smoothly, their reports need not be smooth.

The reported path is the true one plus white noise and a random walk. Taking the reports themselves as regressors would
pull every distance out (errors in variables: attenuation by the share of the noise; Fuller, Measurement Error Models,
1.1). So the path is first smoothed: a place whose acceleration is a random walk of an intensity that the reports
themselves choose (maximum marginal likelihood), start, velocity and acceleration unknown. What is left of the errors
after that is independent of the smoothed path, and enters the estimate as a covariance.
"""

from __future__ import annotations

import numpy as np

from mission.estimate.kernels import random_walk, twice_integrated_random_walk
from mission.estimate.knots import Knots
from mission.records import Matrix, NoiseModel, Vector

_JERK_PSD = np.geomspace(1e-4, 1e2, 9)
"""Intensities tried, m2/s5."""
_LEAST_WHITE_M = 1e-3
_UNKNOWN_M2 = 1e4


def smoothed_path(t_s: Vector, reported_m: Matrix, noise: NoiseModel, knots: Knots) -> tuple[Matrix, Matrix]:
    """The path at the sightings, and what it may be wrong by.

    Args:
        t_s: (n,), zero where the reports' random walk is.
        reported_m: (n, 3).
        noise: of the reports.
        knots: the averages in which the covariance is wanted.

    Returns:
        Smoothed positions (n, 3), and the covariance (k, k) of their errors at the knots, per axis.
    """
    average, span = knots.bearing, max(float(np.ptp(t_s)), 1e-3)
    error = max(noise.position_sigma_m, _LEAST_WHITE_M) ** 2 * (average @ average.T)
    error = error + noise.position_walk_m_per_sqrt_s**2 * knots.averaged(random_walk(t_s))
    powers = (t_s[:, None] / span) ** np.arange(3)
    start = _UNKNOWN_M2 * powers @ powers.T
    wander = twice_integrated_random_walk(t_s, t_s)
    start_k, wander_k = knots.averaged(start), knots.averaged(wander)
    offset = average @ (reported_m - reported_m[0])
    best, chosen = -np.inf, float(_JERK_PSD[-1])
    for psd in _JERK_PSD:
        try:
            factor = np.linalg.cholesky(psd * wander_k + start_k + error)
        except np.linalg.LinAlgError:
            continue
        whitened = np.linalg.solve(factor, offset)
        likelihood = -0.5 * float(np.vdot(whitened, whitened)) - 3.0 * float(np.log(factor.diagonal()).sum())
        if likelihood > best:
            best, chosen = likelihood, float(psd)
    gain = np.linalg.solve(chosen * wander_k + start_k + error, np.column_stack((offset, error)))
    path = reported_m[0] + (chosen * wander + start) @ average.T @ gain[:, :3]
    left = error - error @ gain[:, 3:]
    return path, 0.5 * (left + left.T)
