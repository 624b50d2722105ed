"""Gauss-Newton on the joint model, with step halving."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mission.errors import EstimateRefused
from mission.estimate.arrow import Factored
from mission.estimate.joint_model import JointModel, Linearised, State
from mission.records import Matrix, Vector

CONVERGED = 1e-2
"""Stop after a step that promised to lower chi-square by less than this: the next would promise a hundredth of it."""
MAX_STEPS = 40
_NEAR_ENOUGH = 0.25
"""A step within this share of the parabola's vertex is not improved."""


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """The most probable state, and the normal equations there."""

    at: Linearised
    factored: Factored
    steps: int
    promised: float
    """By how much the last step promised to lower chi-square."""
    converged: bool


def minimise(
    model: JointModel,
    start: State | Linearised,
    *,
    max_steps: int = MAX_STEPS,
    tolerance: float = CONVERGED,
    before: float | None = None,
) -> Minimum:
    """The nearest local minimum of the joint model's cost.

    Args:
        model: residuals and normal equations.
        start: where to start.
        max_steps: Gauss-Newton steps at most.
        tolerance: stop when a step promises less decrease of chi-square.
        before: what the last step of the minimisation that is continued promised.

    Raises:
        EstimateRefused: the start is behind the camera.
        NotPositiveDefinite: something is not observable.
    """
    at = start if isinstance(start, Linearised) else model.linearise(start)
    if at is None:
        raise EstimateRefused(
            "the target would be behind the camera", "Check the camera's mounting and the order of the quaternion."
        )
    steps = 0
    while True:
        factored, chain_rhs, border_rhs = model.normal_equations(at)
        chain_step, border_step = factored.solve(chain_rhs, border_rhs)
        promised = float(chain_rhs @ chain_step + border_rhs @ border_step)
        moved = _line_search(model, at, chain_step.reshape(at.state.chain.shape), border_step, promised)
        steps += 1
        if moved is None:
            return Minimum(at, factored, steps, promised, converged=promised < 100.0 * tolerance)
        at = moved
        # Convergence is linear after the first step, so the next one would promise about promised^2 / before.
        expected = math.inf if before is None else promised * promised / before
        if promised < tolerance or expected < 0.5 * tolerance:
            return Minimum(at, factored, steps, promised, converged=True)
        before = None if steps == 1 and before is None else promised
        if steps >= max_steps:
            return Minimum(at, factored, steps, promised, converged=False)


def _line_search(
    model: JointModel, at: Linearised, chain_step: Matrix, border_step: Vector, promised: float
) -> Linearised | None:
    """The first of 1, 1/2, 1/4 ... of the step that does not raise the cost, improved by the parabola through it.

    Along the step the cost is cost - 2 promised s + k promised s^2, with k = 1 where Gauss-Newton is exact. Noisy
    paths and many sightings make k as large as 2, and full steps would then jump to and fro around the minimum.
    """

    def trial(share: float) -> Linearised | None:
        return model.linearise(State(at.state.chain + share * chain_step, at.state.border + share * border_step))

    share = 1.0
    for _ in range(12):
        found = trial(share)
        if found is not None and found.cost <= at.cost - 1e-4 * share * promised + 1e-9 * (1.0 + at.cost):
            break
        share *= 0.5
    else:
        return None
    if promised <= 0.0:
        return found
    curvature = (2.0 * share - (at.cost - found.cost) / promised) / share**2
    best = 1.0 / max(curvature, 0.5)
    if abs(best / share - 1.0) < _NEAR_ENOUGH:
        return found
    better = trial(best)
    return better if better is not None and better.cost < found.cost else found
