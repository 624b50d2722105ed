"""Mean and covariance of a target whose range is known poorly, and therefore lopsidedly.

Where the range's sigma is not small beside the range, more of the probability lies beyond the best range than before
it, and the inverse information at the minimum is too small an ellipse in the wrong place. So the range (along the
line of sight of the first sighting) is walked through on both sides of the minimum, everything else minimised at
each step, and the mean and covariance are those of the mixture of the conditional normal distributions, weighted by
the profile likelihood exp(-cost / 2) and a prior that is uniform in the logarithm of the range (Jeffreys' prior of a
scale; the grid is too).

The determinant that Laplace's approximation would add to the weights is left out on purpose: the camera's true path
is an incidental parameter without a prior (errors in variables), and integrating over it with a flat one is
inconsistent (Neyman & Scott 1948): it would push every range out, the further the worse the reported path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.estimate.arrow import Factored
from mission.estimate.gauss_newton import Minimum
from mission.estimate.joint_model import JointModel, Linearised, P, State
from mission.estimate.target_covariance import TargetMoments, target_moments
from mission.records import Vector

_STEP = 0.6
"""Between neighbouring ranges, in sigmas of the log range."""
_LARGEST_STEP = 0.15
_DEPTH = 12.0
"""How much chi-square may rise before the walk ends."""
_MOST = 40
"""Ranges looked at on either side."""


@dataclass(frozen=True, slots=True, eq=False)
class RangeProfile:
    """What the walk found."""

    moments: TargetMoments
    """Of the mixture."""
    bounded: bool
    """Whether chi-square rose by `_DEPTH` on both sides, so that there is a range at all."""
    nearest_m: float
    """Range at which chi-square has risen by 4 on the near side (2 sigmas), about."""


def profile_range(model: JointModel, minimum: Minimum) -> RangeProfile:
    """Walk the range through on both sides of the minimum.

    Raises:
        NotPositiveDefinite: the information vanished on the way.
    """
    place = minimum.at.state.border[P]
    best = float(np.linalg.norm(place))
    sight = place / best
    centre = target_moments(model, minimum.at.state, minimum.factored)
    relative = float(np.sqrt(sight @ centre.covariance[:3, :3] @ sight)) / best
    step = min(_STEP * relative, _LARGEST_STEP)
    near = _walk(model, minimum, sight, best, -step)
    far = _walk(model, minimum, sight, best, step)
    nodes = [*reversed(near), _node(model, minimum, sight, best), *far]
    cost = np.array([node.cost for node in nodes])
    ranges = np.array([node.range_m for node in nodes])
    weights = np.exp(-0.5 * (cost - cost.min()))
    weights /= weights.sum()
    likely = ranges[cost - cost.min() < 4.0]
    return RangeProfile(
        _mixture([node.moments for node in nodes], weights),
        bounded=bool(cost[0] - cost.min() >= _DEPTH and cost[-1] - cost.min() >= _DEPTH),
        nearest_m=float(likely.min()),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Node:
    range_m: float
    cost: float
    moments: TargetMoments
    """Given the range."""


def _walk(model: JointModel, minimum: Minimum, sight: Vector, best: float, step: float) -> list[_Node]:
    """Ranges from the minimum outwards, each one Gauss-Newton step away from where the last one ended."""
    nodes: list[_Node] = []
    at = minimum.at
    equations = model.normal_equations(at)
    for number in range(1, _MOST + 1):
        wanted = best * float(np.exp(number * step))
        held = _held(model, at, equations, sight, wanted)
        if held is None:
            break
        at, equations = held, model.normal_equations(held)
        nodes.append(_node(model, Minimum(at, equations[0], 0, converged=True), sight, wanted))
        if at.cost - minimum.at.cost > _DEPTH:
            break
    return nodes


def _held(
    model: JointModel, at: Linearised, equations: tuple[Factored, Vector, Vector], sight: Vector, wanted: float
) -> Linearised | None:
    """One Gauss-Newton step with the range held at `wanted` (a linear constraint, so a multiplier does it)."""
    factored, chain, border = equations
    free_chain, free_border = factored.solve(chain, border)
    unit = np.zeros(len(border))
    unit[P] = sight
    held_chain, held_border = factored.solve(np.zeros_like(chain), unit)
    multiplier = (wanted - sight @ (at.state.border[P] + free_border[P])) / (sight @ held_border[P])
    step = (free_chain + multiplier * held_chain).reshape(at.state.chain.shape)
    return model.linearise(State(at.state.chain + step, at.state.border + free_border + multiplier * held_border))


def _node(model: JointModel, minimum: Minimum, sight: Vector, range_m: float) -> _Node:
    """The moments given the range: what the range explains is taken out of the covariance."""
    moments = target_moments(model, minimum.at.state, minimum.factored)
    along = np.zeros(len(moments.mean))
    along[:3] = sight
    shared = moments.covariance @ along
    covariance = moments.covariance - np.outer(shared, shared) / (along @ shared)
    return _Node(range_m, minimum.at.cost, TargetMoments(moments.mean, covariance))


def _mixture(parts: list[TargetMoments], weights: Vector) -> TargetMoments:
    means = np.array([part.mean for part in parts])
    mean = weights @ means
    spread = means - mean
    covariance = np.einsum("k,kij->ij", weights, np.array([part.covariance for part in parts]))
    return TargetMoments(mean, covariance + (spread * weights[:, None]).T @ spread)
