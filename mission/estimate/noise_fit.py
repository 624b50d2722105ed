"""The noise level that a flight's own sightings support: restricted maximum likelihood of a few scale factors.

Nobody tells the program how far an autopilot's pose wanders (0.2 deg and 0.05 m over a pattern on one, 2 deg and 0.3
m on another) or how well a detector centres its boxes in today's light, and a covariance from the wrong level is a
lie either way. But the sightings show it: residuals that are too restless, or too quiet. At the most probable
target,

    -2 log L(f) = y' P y + log det S(f) + log det of the unknowns' information + sum (log f - expected)^2 / spread^2

where y are the residuals without any error explained, S(f) their covariance with the sigmas of heading, tilt,
position, pixel and size scaled by the factors f, and the last term is a log-normal prior that holds a factor where
the flight is too short to show it (Patterson & Thompson 1971; `noise_likelihood.py`). The target is then found again
with the new noise, since both depend on each other; within a round it stays fixed, so that the flat prior of the
camera's path does no harm (see `range_profile.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.arrow import NotPositiveDefinite
from mission.estimate.constant_velocity import most_probable
from mission.estimate.gauss_newton import Minimum
from mission.estimate.joint_model import JointModel, State
from mission.estimate.noise_likelihood import (
    HEADING_TAU_S,
    POSITION_TAU_S,
    TILT_TAU_S,
    SmoothLikelihood,
    first_order_sigma,
    random_walk_intensity,
)
from mission.estimate.observations import Observations, observe, tamed_noise, tamed_prior
from mission.records import FlightSightings, NoiseModel, Sighting, Vector

_PATTERN_RATE = 1.4 * 2.0 * math.pi
"""Angular rate at which the parallax of an out-and-back or S pattern lives, times the pattern's duration."""
_MOST = 30
"""Sightings that the likelihood looks at, evenly thinned."""
_ROUNDS = 3
_SWEEPS = 3
_REACH_OF_CURVATURE = 0.5
"""How far from the mode the posterior's curvature is looked at, in the factors' logarithms."""


@dataclass(frozen=True, slots=True)
class _Factor:
    """What is believed of a scale factor's logarithm beforehand."""

    middle: float
    """Most likely logarithm where the heading's factor is one."""
    with_heading: float
    """By how much it grows with the logarithm of the heading's factor."""
    spread: float
    """Sigma of the logarithm about that."""


# One filter in the autopilot makes heading, tilt and position, so where one is bad the others are. Between the two
# autopilots that were measured the heading is nine times worse, the tilt nine times, the drift five times.
_FACTORS = (
    _Factor(1.15, 0.0, 1.1),  # heading
    _Factor(-0.8, 1.0, 0.6),  # tilt
    _Factor(0.1, 0.7, 0.4),  # smooth position error
    _Factor(-0.3, 0.2, 0.5),  # white position error
    _Factor(0.0, 0.0, 0.4),  # pixel
    _Factor(0.0, 0.0, 0.4),  # size
)
_REACH = math.log(20.0)
"""Natural logarithm of the largest factor."""


def fit_noise(flight: FlightSightings) -> NoiseModel:
    """The noise model, its sigmas scaled to what the flight shows; correlation times and biases stay.

    Where the flight does not determine a position the stated model comes back, since there is nothing to compare with.

    Args:
        flight: the sightings with the stated noise model. Sigmas of single sightings keep their ratios: scale them with
            `rescaled`.
    """
    factors = _FACTORS
    stated = flight.noise
    flight = replace(flight, noise=tamed_noise(stated), prior=tamed_prior(flight.prior))
    seen = observe(flight)
    if len(seen.t_s) < 3:
        return stated
    # From between the good and the bad, so that neither looks like a flight full of wrong sightings.
    log_factors = _expected(factors, factors[0].middle)
    rate = _PATTERN_RATE / max(float(seen.t_s[-1]), 1e-3)
    try:
        for _ in range(_ROUNDS):
            current = rescaled(flight, _scaled(flight.noise, log_factors, rate))
            model, minimum = most_probable(current, observe(current))
            log_factors = _fitted(_likelihood(flight, seen, model, minimum), log_factors, factors)
    except (EstimateRefused, NotPositiveDefinite, np.linalg.LinAlgError):
        return stated
    return _scaled(flight.noise, log_factors, rate)


def no_better(fitted: NoiseModel, stated: NoiseModel) -> NoiseModel:
    """The fitted model, its pose no better than stated.

    A few seconds may be too short for a slow wander to show itself, so a quiet flight proves nothing, but a restless
    one does. How well the target is seen shows in every frame and may be better than stated.

    Args:
        fitted: from `fit_noise`.
        stated: what the aircraft says of itself.
    """
    return replace(
        fitted,
        position_sigma_m=max(fitted.position_sigma_m, stated.position_sigma_m),
        position_walk_m_per_sqrt_s=max(fitted.position_walk_m_per_sqrt_s, stated.position_walk_m_per_sqrt_s),
        heading_sigma_rad=max(fitted.heading_sigma_rad, stated.heading_sigma_rad),
        tilt_sigma_rad=max(fitted.tilt_sigma_rad, stated.tilt_sigma_rad),
    )


def with_fitted_noise(flight: FlightSightings, *, steadied: bool) -> FlightSightings:
    """The flight under the noise that it supports, ready to be estimated.

    Poses by the background come with how well they are known, and the estimate averages over what that may be wrong
    by. An autopilot's own may err ten times as much as another's, which is looked for first.

    Args:
        flight: the sightings with the stated noise.
        steadied: whether the poses come from the background.
    """
    return flight if steadied else rescaled(flight, no_better(fit_noise(flight), flight.noise))


def rescaled(flight: FlightSightings, noise: NoiseModel) -> FlightSightings:
    """The flight under another noise model, its sightings' own sigmas scaled as the model's are."""
    pixel = _ratio(noise.pixel_sigma_px, flight.noise.pixel_sigma_px)
    size = _ratio(noise.size_sigma, flight.noise.size_sigma)
    return replace(flight, noise=noise, sightings=tuple(_rescaled(s, pixel, size) for s in flight.sightings))


def _rescaled(sighting: Sighting, pixel: float, size: float) -> Sighting:
    if sighting.pixel_sigma_px is None and sighting.size_sigma is None:
        return sighting
    return replace(
        sighting,
        pixel_sigma_px=None if sighting.pixel_sigma_px is None else pixel * sighting.pixel_sigma_px,
        size_sigma=None if sighting.size_sigma is None else size * sighting.size_sigma,
    )


def _ratio(new: float, old: float) -> float:
    return new / old if old > 0.0 else 1.0


def _scaled(noise: NoiseModel, log_factors: Vector, rate_rad_s: float) -> NoiseModel:
    """The noise model at the factors; smooth errors become first-order ones of the same power at `rate_rad_s`."""
    heading, tilt, place, white, pixel, size = (math.exp(log_factor) for log_factor in log_factors)
    smooth_heading = heading * noise.heading_sigma_rad
    wander = first_order_sigma(smooth_heading, HEADING_TAU_S, noise.heading_correlation_s, rate_rad_s)
    # What the first-order process does not carry of the variance is slower than the pattern: a bias to it.
    slow = max(smooth_heading**2 - wander**2, 0.0)
    return replace(
        noise,
        heading_sigma_rad=wander,
        heading_bias_sigma_rad=math.hypot(noise.heading_bias_sigma_rad, math.sqrt(slow)),
        tilt_sigma_rad=tilt * noise.tilt_sigma_rad,
        tilt_correlation_s=TILT_TAU_S,
        position_walk_m_per_sqrt_s=random_walk_intensity(
            place * noise.position_walk_m_per_sqrt_s, POSITION_TAU_S, rate_rad_s
        ),
        position_sigma_m=white * noise.position_sigma_m,
        pixel_sigma_px=pixel * noise.pixel_sigma_px,
        size_sigma=size * noise.size_sigma,
    )


def _expected(factors: Sequence[_Factor], log_heading: float) -> Vector:
    """Most likely logarithms of the factors beforehand, given the heading's."""
    return np.array([factor.middle + factor.with_heading * log_heading for factor in factors])


def _likelihood(flight: FlightSightings, stated: Observations, model: JointModel, minimum: Minimum) -> SmoothLikelihood:
    """Of the factors of the stated noise, on sightings thinned to what a dense matrix can bear."""
    rows = np.flatnonzero(np.isin(stated.index, model.seen.index))
    kept = np.zeros(len(stated.t_s), dtype=bool)
    kept[rows] = True
    plain = JointModel(stated.only(kept), flight.noise, flight.prior)
    state = plain.adopt(model, minimum.at.state, np.arange(plain.count))
    state = State(np.zeros_like(state.chain), state.border)
    at = plain.linearise(state)
    if at is None:
        raise NotPositiveDefinite("the target is behind the camera")
    stride = max(1, -(-plain.count // _MOST))
    return SmoothLikelihood(plain, at, np.arange(0, plain.count, stride))


def _fitted(likelihood: SmoothLikelihood, now: Vector, factors: Sequence[_Factor]) -> Vector:
    """Logarithms of the factors with the largest posterior, one after another, a few times around."""
    spreads = np.array([factor.spread for factor in factors])

    def posterior(log_factors: Vector) -> float:
        surprise = (log_factors - _expected(factors, float(log_factors[0]))) / spreads
        return likelihood(log_factors) + float(surprise @ surprise)

    best = now.copy()
    value = posterior(best)
    reach = 0.7
    for _ in range(_SWEEPS):
        for place in range(len(factors)):
            value = _along(posterior, best, place, reach, value)
        reach *= 0.5
    return best + _uncertainty(posterior, best, value, spreads)


def _uncertainty(posterior: Callable[[Vector], float], best: Vector, value: float, spreads: Vector) -> Vector:
    """Variances of the logarithms.

    A covariance is to hold on average over what the factors may be: the mean of f^2 over a log-normal posterior is that
    of its mode times exp(2 variance).
    """
    variances = np.empty(len(best))
    for place in range(len(best)):
        offset = np.zeros(len(best))
        offset[place] = _REACH_OF_CURVATURE
        curvature = posterior(best + offset) - 2.0 * value + posterior(best - offset)
        variances[place] = 2.0 * _REACH_OF_CURVATURE**2 / curvature if curvature > 0.0 else math.inf
    return np.asarray(np.minimum(variances, spreads**2))


def _along(likelihood: Callable[[Vector], float], best: Vector, place: int, reach: float, value: float) -> float:
    """Move one factor downhill in strides, then to the vertex of the parabola; returns the new value."""
    here = float(best[place])

    def at(log_factor: float) -> float:
        trial = best.copy()
        trial[place] = log_factor
        return likelihood(trial)

    left, right = at(here - reach), at(here + reach)
    while min(left, right) < value and abs(here) < _REACH:
        if left < right:
            here, value, right, left = here - reach, left, value, at(here - 2.0 * reach)
        else:
            here, value, left, right = here + reach, right, value, at(here + 2.0 * reach)
    curvature = left - 2.0 * value + right
    vertex = here + 0.5 * reach * (left - right) / curvature if curvature > 1e-9 else here
    reached = at(vertex)
    if reached < value:
        here, value = vertex, reached
    best[place] = here
    return value
