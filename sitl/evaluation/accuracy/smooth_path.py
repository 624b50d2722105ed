"""Reported paths that err smoothly, as autopilots' do: a second-order Gauss-Markov process on each axis.

Its correlation over a lag L is (1 + L / tau) exp(-L / tau), so that over a short lag the error changes in proportion to
the lag. The sightings format's white noise plus random walk cannot state that.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mission.records import FlightSightings, Matrix, Vector


def smooth_path(flight: FlightSightings, sigma_m: float, tau_s: float, rng: np.random.Generator) -> FlightSightings:
    """The flight with a smooth error added to each reported position.

    Args:
        flight: as simulated; what it states of its noise stays.
        sigma_m: of the error, per axis.
        tau_s: its time constant.
        rng: all randomness.
    """
    error = sigma_m * second_order(np.array([s.t_s for s in flight.sightings]), tau_s, rng)
    moved = [np.asarray(s.position_enu_m) + e for s, e in zip(flight.sightings, error, strict=True)]
    sightings = (
        replace(s, position_enu_m=(float(p[0]), float(p[1]), float(p[2])))
        for s, p in zip(flight.sightings, moved, strict=True)
    )
    return replace(flight, sightings=tuple(sightings))


def second_order(t_s: Vector, tau_s: float, rng: np.random.Generator) -> Matrix:
    """Three independent second-order Gauss-Markov processes of unit variance at the times `t_s`, (n, 3)."""
    lag = np.abs(t_s[:, None] - t_s) / tau_s
    correlation = (1.0 + lag) * np.exp(-lag)
    # Smooth processes' matrices are nearly singular; the jitter is a hundred-thousandth of the sigma.
    root = np.linalg.cholesky(correlation + 1e-10 * np.eye(len(t_s)))
    return np.asarray(root @ rng.standard_normal((len(t_s), 3)))
