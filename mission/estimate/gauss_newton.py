"""Gauss-Newton on the joint model with step halving, and a quasi-Newton end.

Near the minimum the residuals' own curvature decides how fast Gauss-Newton converges: with noisy reported positions
and many sightings each step leaves a third of the last one's error, and each costs a factorisation. So once a step
promises little, the last factors stay and L-BFGS goes on from them (Nocedal & Wright, Numerical Optimization,
algorithm 7.4, with the factored Gauss-Newton Hessian as H_0): a gradient and a solution by substitution each, a
quarter of the work, and the pairs of steps and gradients learn the curvature that Gauss-Newton leaves out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.arrow import Factored
from mission.estimate.joint_model import JointModel, Linearised, State
from mission.records import Matrix, Vector

CONVERGED = 5e-3
"""Stop where the next step promises to lower chi-square by less than this."""
MAX_STEPS = 40
_NEAR_ENOUGH = 0.25
"""A step within this share of the parabola's vertex is not improved."""
_NEARLY = 0.5
"""After a step that promised less than this the factors are good enough to stay: the state moves by 0.7 sigma at most
in all directions together, and the information with it by about a hundredth."""
_LAST_STEPS = 8
"""L-BFGS steps before the factors are made anew."""


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """The most probable state, and the normal equations there."""

    at: Linearised
    factored: Factored
    steps: int
    converged: bool


def minimise(
    model: JointModel, start: State | Linearised, *, max_steps: int = MAX_STEPS, tolerance: float = CONVERGED
) -> Minimum:
    """The nearest local minimum of the joint model's cost.

    Args:
        model: residuals and normal equations.
        start: where to start.
        max_steps: Gauss-Newton steps at most.
        tolerance: stop when the next step promises less decrease of chi-square.

    Raises:
        EstimateRefused: the start is behind the camera.
        NotPositiveDefinite: something is not observable.
    """
    at = start if isinstance(start, Linearised) else model.linearise(start)
    if at is None:
        raise EstimateRefused(
            "the target would be behind the camera", "Check the camera's mounting and the order of the quaternion."
        )
    steps, before = 0, math.inf
    while True:
        factored, chain_rhs, border_rhs = model.normal_equations(at)
        chain_step, border_step = factored.solve(chain_rhs, border_rhs)
        promised = float(chain_rhs @ chain_step + border_rhs @ border_step)
        moved = _line_search(model, at, chain_step.reshape(at.state.chain.shape), border_step, promised)
        steps += 1
        if moved is None:
            return Minimum(at, factored, steps, converged=promised < 200.0 * tolerance)
        at = moved
        # Convergence is linear at worst, so the next step would promise about promised^2 / before.
        if promised < _NEARLY and promised * promised < tolerance * before < math.inf:
            return Minimum(at, factored, steps, converged=True)
        if promised < _NEARLY:
            at, promised = _ended(model, at, factored, tolerance)
            if promised < tolerance:
                return Minimum(at, factored, steps, converged=True)
        before = promised
        if steps >= max_steps:
            return Minimum(at, factored, steps, converged=False)


def _ended(model: JointModel, at: Linearised, factored: Factored, tolerance: float) -> tuple[Linearised, float]:
    """L-BFGS from the factors of the last Gauss-Newton step: where it leads, and what a further step promises."""
    moves: list[Vector] = []
    changes: list[Vector] = []
    gradient = _gradient(model, at)
    for _ in range(_LAST_STEPS):
        size = at.state.chain.size
        step = _quasi_newton_step(gradient, factored, size, moves, changes)
        promised = float(-gradient @ step)
        if promised < tolerance:
            break
        state = State(at.state.chain + step[:size].reshape(at.state.chain.shape), at.state.border + step[size:])
        found = model.linearise(state)
        if found is None or found.cost > at.cost:
            break
        before, gradient = gradient, _gradient(model, found)
        at = found
        change = gradient - before
        if step @ change > 0.0:  # where not, there is no positive curvature to learn
            moves.append(step)
            changes.append(change)
    return at, promised


def _quasi_newton_step(
    gradient: Vector, factored: Factored, size: int, moves: list[Vector], changes: list[Vector]
) -> Vector:
    """Minus the inverse Hessian times the gradient, by the two-loop recursion over pairs of steps and gradients."""
    left = gradient.copy()
    shares = []
    for move, change in zip(reversed(moves), reversed(changes), strict=True):
        shares.append(float(move @ left) / float(move @ change))
        left -= shares[-1] * change
    step = np.concatenate(factored.solve(left[:size], left[size:]))
    for move, change, share in zip(moves, changes, reversed(shares), strict=True):
        step += (share - float(change @ step) / float(move @ change)) * move
    return -step


def _gradient(model: JointModel, at: Linearised) -> Vector:
    """Half the gradient of the cost by chain and border, (n * b + 9,)."""
    return np.concatenate(model.gradient(at))


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
