"""Correlated picture noise stated as white noise of the same weight, for cameras whose reported path is smooth.

A flight states how its reported positions err: white plus a random walk, whose power falls with the square of the
frequency. So does that of the detector's noise, a first-order Gauss-Markov process, and to the estimator the two are
in one proportion at all high frequencies. But an autopilot's estimate is smooth: its errors change in proportion to
the lag and have next to no power up there. What jitters in the pictures is then put down to the reported path, which
is noisy as stated, and that is inverse regression: of x on y, not y on x. With n sightings and a depth known to a
share s of itself the answer is too near by a share of about n s^2 (attenuation; Fuller, Measurement Error Models,
1.3): simulated, 0.15 m of smooth error and 20 sightings a second, 3 % at 3 m and 10 % at 15 m, two of its own sigmas.

The remedy costs next to nothing, since the parallax lives at low frequencies. White noise whose variance is
(1 + rho) / (1 - rho) times as large, rho the correlation of neighbours, weighs the same there and more at high ones.
Then the path is believed where it can be, and the same flights have no visible bias and true ellipses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mission.records import FlightSightings, Vector


def white_equivalent(flight: FlightSightings) -> FlightSightings:
    """The flight with its pixel and size noise stated as white, as heavy at low frequencies as it was.

    Args:
        flight: the sightings in time order, with their noise model.
    """
    noise, sightings = flight.noise, flight.sightings
    if len(sightings) < 2:
        return flight
    spacing = _spacing_s(np.array([s.t_s for s in sightings]))
    pixel = _inflation(spacing, noise.pixel_correlation_s)
    size = _inflation(spacing, noise.size_correlation_s)
    stated = replace(
        noise,
        pixel_sigma_px=noise.pixel_sigma_px * float(np.median(pixel)),
        pixel_correlation_s=0.0,
        size_sigma=noise.size_sigma * float(np.median(size)),
        size_correlation_s=0.0,
    )
    whitened = tuple(
        replace(
            s,
            pixel_sigma_px=(noise.pixel_sigma_px if s.pixel_sigma_px is None else s.pixel_sigma_px) * float(pixel[i]),
            size_sigma=(noise.size_sigma if s.size_sigma is None else s.size_sigma) * float(size[i]),
        )
        for i, s in enumerate(sightings)
    )
    return replace(flight, noise=stated, sightings=whitened)


def _spacing_s(t_s: Vector) -> Vector:
    """The time that each sighting stands for: to the middles between it and its neighbours, (n,)."""
    steps = np.diff(t_s)
    before, after = np.append(steps[0], steps), np.append(steps, steps[-1])
    spacing: Vector = 0.5 * (before + after)
    return spacing


def _inflation(spacing_s: Vector, correlation_s: float) -> Vector:
    """By how much white noise must be larger than a first-order process to leave a mean as uncertain, (n,)."""
    if correlation_s <= 0.0:
        return np.ones(len(spacing_s))
    # Equal times (and simultaneous sightings) count as a hundredth of the correlation time.
    rho = np.exp(-np.maximum(spacing_s / correlation_s, 0.01))
    factor: Vector = np.sqrt((1.0 + rho) / (1.0 - rho))
    return factor
