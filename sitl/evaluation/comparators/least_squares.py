"""SciPy's `least_squares` on the batch estimator's residuals: what a general solver makes of the same problem.

The residuals are those of `mission.estimate.joint_model`, whitened, with the priors as further residuals; the start is
the batch's own. Jacobians are numerical but their sparsity is told, as a user of SciPy would do it, and the unknowns
are scaled by the Jacobian's columns: without that the same minimum takes fifty times as long.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix, lil_matrix

from mission.errors import EstimateRefused
from mission.estimate.joint_model import BORDER, JointModel, P, State, V
from mission.estimate.observations import observe
from mission.estimate.starts import find_starts
from mission.estimate.target_covariance import first_camera
from mission.records import Estimate, FirstPosition, FlightSightings, Matrix, Vector


class LeastSquaresProblem:
    """The joint model as one vector of unknowns and one of residuals, for constant velocity and heights throughout."""

    def __init__(self, flight: FlightSightings) -> None:
        seen = observe(flight)
        self.model = JointModel(seen, flight.noise, flight.prior)
        if self.model.manoeuvres or self.model.fills_size:
            raise EstimateRefused("This comparison is for constant velocity and heights throughout")
        best = find_starts(seen, flight.noise, flight.prior).starts[0]
        start = self.model.start(best.position_m, best.velocity_m_s, best.log_size)
        self.start = np.concatenate((start.chain.reshape(-1), start.border))
        n, b = self.model.count, self.model.block
        self.rows = np.stack([_whitener(self.model.precision[:, c], self.model.precision_off[:, c]) for c in range(3)])
        diagonal = np.einsum("nbb->nb", self.model.prior_diagonal)
        off = np.einsum("nbb->nb", self.model.prior_below)
        self.priors = np.stack([_whitener(diagonal[:, place], off[:, place]) for place in range(b)])
        self.border_root = np.sqrt(np.diag(self.model.border_prior.information))
        pattern = lil_matrix((3 * n + n * b + BORDER, n * b + BORDER), dtype=int)
        for i in range(n):
            # The whiteners are upper bidiagonal: row i takes what belongs to sightings i and i + 1.
            both = range(i, min(i + 2, n))
            for row in range(3):
                pattern[row * n + i, i * b : (both[-1] + 1) * b] = 1
                pattern[row * n + i, n * b :] = 1
            for place in range(b):
                pattern[3 * n + place * n + i, [k * b + place for k in both]] = 1
        for place in range(BORDER):
            pattern[3 * n + n * b + place, n * b + place] = 1
        self.sparsity: csr_matrix = csr_matrix(pattern)

    def residuals(self, unknowns: Vector) -> Vector:
        """Whitened residuals of the sightings, of the chain's priors and of the border's."""
        n, b = self.model.count, self.model.block
        chain, border = unknowns[: n * b].reshape(n, b), unknowns[n * b :]
        at = self.model.linearise(State(chain, border))
        if at is None:
            return np.full(3 * n + n * b + BORDER, 1e6)
        seen = np.einsum("cij,jc->ci", self.rows, at.residual).reshape(-1)
        prior = np.einsum("pij,jp->pi", self.priors, chain).reshape(-1)
        return np.concatenate((seen, prior, self.border_root * border))

    def solve(self) -> State:
        """The minimum that SciPy finds."""
        found = least_squares(self.residuals, self.start, jac_sparsity=self.sparsity, method="trf", x_scale="jac")
        n, b = self.model.count, self.model.block
        return State(found.x[: n * b].reshape(n, b), found.x[n * b :])


@dataclass(frozen=True, slots=True)
class LeastSquares:
    """The solver as a method of its own; some 50 times slower than `batch`, and without a covariance."""

    name: str = "least_squares"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`."""
        problem = LeastSquaresProblem(flight)
        state = problem.solve()
        seen, sightings = problem.model.seen, flight.sightings
        place, velocity = state.border[P], state.border[V] * problem.model.speed_sigma
        return Estimate(
            id=flight.id,
            method=self.name,
            model="constant-velocity",
            t_s=sightings[-1].t_s,
            position_enu_m=seen.reference_m + problem.model.targets(state)[-1],
            velocity_enu_m_s=velocity,
            covariance=None,
            first=FirstPosition(sightings[0].t_s, seen.reference_m + place, np.full((3, 3), np.nan)),
            depth_m=float(np.hypot(*(place - first_camera(problem.model, state))[:2])),
            sightings=len(sightings),
            rejected=0,
            chi2=None,
            dof=None,
        )


def _whitener(diagonal: Vector, off: Vector) -> Matrix:
    """Upper bidiagonal U with U' U the tridiagonal precision, (n, n)."""
    full = np.diag(diagonal) + np.diag(off, -1) + np.diag(off, 1)
    return np.asarray(np.linalg.cholesky(full).T)
