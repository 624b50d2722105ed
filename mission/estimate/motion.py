"""Which motion the sightings support: a standing target, constant velocity, or a manoeuvre.

All three are nested in one: constant velocity with a prior of the velocity, and with an acceleration that may be
added. So their evidences follow from the one minimum that was found, without solving again:

- standing against constant velocity: Savage-Dickey, the posterior density of the velocity at zero over the prior's
  (Dickey 1971);
- a manoeuvre against constant velocity: with g the gradient of the log likelihood by a constant acceleration and I its
  information, everything else eliminated, the evidence gained by a prior N(0, s^2) of the acceleration is
  g' (I + 1 / s^2)^-1 g / 2 - log det(1 + s^2 I) / 2 (Laplace; exact for linear models).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from mission.estimate.gauss_newton import Minimum
from mission.estimate.joint_model import JointModel, P, V

ACCELERATION_SIGMA_M_S2 = 0.1
"""Prior of a manoeuvre: half a metre per second more or less in five seconds."""
_LEAST_SPEED_SIGMA = 1e-3


@dataclass(frozen=True, slots=True)
class MotionProbabilities:
    """Probabilities of the three motion models, equally likely beforehand."""

    stationary: float
    constant_velocity: float
    manoeuvring: float

    def __str__(self) -> str:
        """The three, the best supported one first."""
        named = {
            "standing": self.stationary,
            "constant velocity": self.constant_velocity,
            "manoeuvring": self.manoeuvring,
        }
        best = max(named, key=lambda name: named[name])
        shares = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in named.items())
        return f"the sightings support {best} ({shares})"


def compare_motions(model: JointModel, minimum: Minimum) -> MotionProbabilities | None:
    """Probabilities of the motion models, or None where the prior already decides between them.

    Args:
        model: of constant velocity.
        minimum: its minimum.

    Raises:
        NotPositiveDefinite: the information is singular.
    """
    if model.manoeuvres or model.speed_sigma.min() < _LEAST_SPEED_SIGMA:
        return None
    velocity = minimum.at.state.border[V]  # in units of the prior's sigma
    covariance = minimum.factored.border_covariance()[V, V]
    standing = -0.5 * (velocity @ np.linalg.solve(covariance, velocity) + np.linalg.slogdet(covariance)[1])
    evidence = np.array([standing, 0.0, _manoeuvre_evidence(model, minimum)])
    weights = np.exp(evidence - evidence.max())
    weights /= weights.sum()
    return MotionProbabilities(float(weights[0]), float(weights[1]), float(weights[2]))


def _manoeuvre_evidence(model: JointModel, minimum: Minimum) -> float:
    """Logarithm of the evidence of a constant horizontal acceleration over that of none."""
    at, factored = minimum.at, minimum.factored
    columns = at.border_jacobian[:, :, P][:, :, :2] * (0.5 * np.square(model.seen.t_s))[:, None, None]
    weighted = model.weighted(columns)
    gradient = -np.einsum("nka,nk->a", weighted, at.residual)
    flat, weighted_flat = columns.reshape(-1, 2), weighted.reshape(-1, 2)
    by_chain = np.matmul(np.swapaxes(at.chain_jacobian, 1, 2), weighted).reshape(-1, 2)
    half, _ = lapack.dtbtrs(factored.band, by_chain, uplo="L")
    by_border = at.border_jacobian.reshape(flat.shape[0], -1).T @ weighted_flat - factored.coupling.T @ half
    solved, _ = lapack.dpotrs(factored.schur, by_border, lower=1)
    information = flat.T @ weighted_flat - half.T @ half - by_border.T @ solved
    variance = ACCELERATION_SIGMA_M_S2**2
    gained = gradient @ np.linalg.solve(information + np.eye(2) / variance, gradient)
    return 0.5 * float(gained - np.linalg.slogdet(np.eye(2) + variance * information)[1])
