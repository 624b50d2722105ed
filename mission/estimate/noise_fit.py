"""The noise level that a flight's own sightings support: restricted maximum likelihood of a few scale factors.

Nobody tells the program how far an autopilot's pose wanders (0.2 deg and 0.05 m over a pattern on one, 2 deg and 0.3 m on
another) or how well a detector centres its boxes in today's light, and a covariance from the wrong level is a lie either way.
But the sightings show it: residuals that are too restless, or too quiet. At the most probable target, with y the residuals
without any error explained and J their derivatives,

    -2 log L(f) = min over all errors of chi-square + log det H(f) + log det of the measurement noise
                  + sum over factors of (log f / spread)^2

where f scales the sigmas of heading, tilt, position, pixel and size, H is the information of everything that is not
measured, and the last term is a log-normal prior that holds a factor where the flight is too short to show it. The target is
then found again with the new noise, since both depend on each other. Source: Patterson & Thompson (1971); the geometry stays
fixed within a round, so that the flat prior of the camera's path does no harm (see `range_profile.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.arrow import NotPositiveDefinite
from mission.estimate.batch import most_probable
from mission.estimate.gauss_newton import Minimum
from mission.estimate.joint_model import WALK, WHITE, JointModel, Linearised, State
from mission.estimate.observations import observe
from mission.records import FlightSightings, Matrix, NoiseModel, Sighting, Vector

_ROUNDS = 3
_SWEEPS = 3


@dataclass(frozen=True, slots=True)
class _Factor:
    """One scale factor: which fields of the noise model it scales, and what is believed of it beforehand."""

    fields: tuple[str, ...]
    middle: float
    """Most likely value beforehand."""
    spread: float
    """Sigma of its natural logarithm beforehand."""


_FACTORS = (
    _Factor(("heading_sigma_rad",), 2.0, 1.2),
    _Factor(("tilt_sigma_rad",), 1.5, 0.8),
    _Factor(("position_walk_m_per_sqrt_s",), 1.5, 0.8),
    _Factor(("position_sigma_m",), 1.0, 0.5),
    _Factor(("pixel_sigma_px",), 1.0, 0.4),
    _Factor(("size_sigma",), 1.0, 0.4),
)
_PIXEL, _SIZE = 4, 5
_REACH = math.log(20.0)
"""Natural logarithm of the largest factor."""


def fit_noise(flight: FlightSightings) -> NoiseModel:
    """The noise model, its sigmas scaled to what the flight shows; correlation times and biases stay.

    Where the flight does not determine a position the stated model comes back, since there is nothing to compare with.

    Args:
        flight: the sightings with the stated noise model. Sigmas of single sightings keep their ratios: scale them with
            `rescaled`.
    """
    seen = observe(flight)
    if len(seen.t_s) < 3:
        return flight.noise
    # From between the good and the bad, so that neither looks like a flight full of wrong sightings.
    log_factors = np.log([factor.middle for factor in _FACTORS])
    try:
        for _ in range(_ROUNDS):
            current = rescaled(flight, _scaled(flight.noise, log_factors))
            model, minimum = most_probable(current, observe(current))
            log_factors = _fitted(model, minimum, log_factors)
    except (EstimateRefused, NotPositiveDefinite, np.linalg.LinAlgError):
        return flight.noise
    return _scaled(flight.noise, log_factors)


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


def _scaled(noise: NoiseModel, log_factors: Vector) -> NoiseModel:
    return replace(
        noise,
        **{
            name: getattr(noise, name) * math.exp(log_factor)
            for factor, log_factor in zip(_FACTORS, log_factors, strict=True)
            for name in factor.fields
        },
    )


def _fitted(model: JointModel, minimum: Minimum, now: Vector) -> Vector:
    """Logarithms of the factors with the largest likelihood, one after another, a few times around."""
    likelihood = _Likelihood(model, minimum, now)
    best = now.copy()
    value = likelihood(best)
    reach = 0.7
    for _ in range(_SWEEPS):
        for place in range(len(_FACTORS)):
            value = _along(likelihood, best, place, reach, value)
        reach *= 0.5
    return best


def _along(likelihood: _Likelihood, best: Vector, place: int, reach: float, value: float) -> float:
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


class _Likelihood:
    """-2 log restricted likelihood of the factors, the model linearised once at the most probable state."""

    def __init__(self, model: JointModel, minimum: Minimum, now: Vector) -> None:
        at = minimum.at
        self.model, self.at, self.now = model, at, now
        own = np.matmul(at.chain_jacobian, at.state.chain[:, :, None])[:, :, 0]
        self.unexplained: Matrix = at.residual - own - at.border_jacobian @ at.state.border
        self.zero = State(np.zeros_like(at.state.chain), np.zeros_like(at.state.border))
        self.sizes = int(model.has_size.sum())

    def __call__(self, log_factors: Vector) -> float:
        relative = np.exp(log_factors - self.now)
        columns = np.ones(self.model.block)
        columns[0], columns[1] = relative[0], relative[1]
        columns[WALK], columns[WHITE] = relative[2], relative[3]
        rows = np.array((1.0 / relative[_PIXEL], 1.0 / relative[_PIXEL], 1.0 / relative[_SIZE]))
        own = self.at.chain_jacobian * rows[:, None] * columns
        if self.model.fills_size:
            # The size error of a sighting without a height is in sigmas already.
            own[:, :, self.model.size_place] = self.at.chain_jacobian[:, :, self.model.size_place]
        residual = self.unexplained * rows
        weighted = self.model.weighted(residual[:, :, None])[:, :, 0]
        linear = Linearised(
            self.zero, 0.0, residual, own, self.at.border_jacobian * rows[:, None], weighted, self.zero.chain
        )
        factored, chain, border = self.model.normal_equations(linear)
        step_chain, step_border = factored.solve(chain, border)
        chi2 = float(np.vdot(residual, weighted)) - float(chain @ step_chain + border @ step_border)
        measured = 4.0 * self.model.count * log_factors[_PIXEL] + 2.0 * self.sizes * log_factors[_SIZE]
        beforehand = sum(
            ((log_factor - math.log(factor.middle)) / factor.spread) ** 2
            for factor, log_factor in zip(_FACTORS, log_factors, strict=True)
        )
        return chi2 + factored.log_determinant + float(measured) + float(beforehand)
