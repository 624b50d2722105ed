"""The joint model of the target and of the camera's true path and attitude: residuals, Jacobians, normal equations.

What is unknown (all of it estimated at once; folding the camera's errors into a measurement covariance instead is
biased):

- border: target position p at the first sighting (m, relative to the first reported camera position), velocity / its
  prior sigma, log size, heading bias / its sigma, tilt bias / its sigma;
- chain, per sighting: heading and tilt wander / sigma (Gauss-Markov), the reported position's random walk / its
  intensity (3), its white error / sigma (3), and where needed the log-size error of a sighting without a height, and
  the target's deviation from constant velocity / sqrt(psd) (east, its rate, north, its rate).

With a = heading error, b = tilt error, e = position error, reported = true + error:

    d = p + v t + deviation - (reported camera position - e)
    q = Rx(b) camera_from_world Rz(a) d            (target in true camera axes; reported R = Rz(a) true Rx(b))
    x = qx / qz,  y = qy / qz,  log h = s - log qz

Where the prior says so, two more measurements of the border (both linear in it):

    ground + centre above ground = p_up,   log(known height) = log size

Everything Markov enters through tridiagonal precisions, so the normal equations are an arrow (`arrow.py`). Unknowns
are in units of their own prior sigma, so a sigma of zero simply removes their effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.estimate.arrow import Factored, factor
from mission.estimate.markov import gauss_markov, random_walk, white_noise_acceleration
from mission.estimate.observations import LEAST_GROUND_SIGMA_M, LEAST_SIZE_SIGMA, Observations
from mission.records import Matrix, NoiseModel, TargetPrior, Vector

P, V, SIZE, HEADING, TILT = slice(0, 3), slice(3, 6), 6, 7, 8
"""Places in the border."""
BORDER = 9
WANDER, WALK, WHITE = slice(0, 2), slice(2, 5), slice(5, 8)
"""Places in a block of the chain."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Values of all unknowns, in the units of the module's docstring."""

    chain: Matrix
    """(n, b)."""
    border: Vector
    """(9,)."""


@dataclass(frozen=True, slots=True, eq=False)
class BorderPrior:
    """What is known of the border beforehand: a normal distribution in its own units."""

    mean: Vector
    """(9,)."""
    information: Matrix
    """(9, 9), zero for what nothing is known of."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Residuals at a state, and their derivatives."""

    state: State
    cost: float
    """Twice the negative log posterior, without its constants: chi-square."""
    residual: Matrix
    """(n, 3), in sigmas: x, y, log height."""
    chain_jacobian: Matrix
    """(n, 3, b), of the residual by the sighting's own block."""
    border_jacobian: Matrix
    """(n, 3, 9)."""
    weighted: Matrix
    """(n, 3), the residual times the measurement noise's precision."""
    prior_pull: Matrix
    """(n, b), the chain times its prior's precision."""


class JointModel:
    """Residuals and normal equations of one flight's observations under a noise model and a prior."""

    def __init__(self, seen: Observations, noise: NoiseModel, prior: TargetPrior) -> None:
        self.seen = seen
        self.noise = noise
        self.prior = prior
        self.count = len(seen.t_s)
        self.has_size = seen.size_scale > 0.0
        self.any_size = bool(self.has_size.any())
        self.fills_size = self.any_size and not bool(self.has_size.all())
        self.manoeuvres = prior.acceleration_psd_m2_s3 > 0.0
        self.size_place = 8
        self.deviation = 8 + self.fills_size
        self.block = self.deviation + (4 if self.manoeuvres else 0)
        self.speed_sigma = np.array((prior.speed_sigma_m_s, prior.speed_sigma_m_s, prior.vertical_speed_sigma_m_s))
        self._psd_root = math.sqrt(prior.acceleration_psd_m2_s3)
        self._wander = np.array((noise.heading_sigma_rad, noise.tilt_sigma_rad))
        self._bias = np.array((noise.heading_bias_sigma_rad, noise.tilt_bias_sigma_rad))
        self._speed_time = (seen.t_s[:, None] * self.speed_sigma)[:, None, :]
        self._own_mix, self._shared_mix = self._mixes()
        pixel = gauss_markov(seen.steps_s, noise.pixel_correlation_s)
        size = gauss_markov(seen.steps_s, noise.size_correlation_s)
        self.precision = np.column_stack((pixel.diagonal, pixel.diagonal, size.diagonal))
        self.precision_off = np.column_stack((pixel.off, pixel.off, size.off))
        self.prior_diagonal, self.prior_below = self._chain_prior()
        self._prior_own = np.einsum("nbb->nb", self.prior_diagonal).copy()
        self._prior_off = np.einsum("nbb->nb", self.prior_below).copy()
        self.border_prior = self._known_border()

    def over(self, seen: Observations) -> JointModel:
        """The same model over other sightings of the flight."""
        return JointModel(seen, self.noise, self.prior)

    @property
    def measurements(self) -> int:
        """How many numbers were measured."""
        return 2 * self.count + int(self.has_size.sum())

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the chi-square at the minimum: measured numbers less unknowns without a prior."""
        given = (self.prior.ground_up_m is not None) + (self.any_size and self.prior.height_m is not None)
        return self.measurements + given - (4 if self.any_size else 3)

    def start(self, position_m: Vector, velocity_m_s: Vector, log_size: float) -> State:
        """The state of a target at a place, with all errors zero."""
        border = np.zeros(BORDER)
        border[P] = position_m
        np.divide(velocity_m_s, self.speed_sigma, out=border[V], where=self.speed_sigma > 0.0)
        border[SIZE] = log_size
        return State(np.zeros((self.count, self.block)), border)

    def adopt(self, other: JointModel, state: State, rows: NDArray[np.intp]) -> State:
        """A state of another model of the same flight, for this one's sightings.

        Args:
            other: whose state it is.
            state: the state.
            rows: for each sighting of this model the other's sighting whose errors it takes, (n,).
        """
        chain = np.zeros((self.count, self.block))
        chain[:, : self.size_place] = state.chain[rows, : self.size_place]
        if self.manoeuvres and other.manoeuvres:
            chain[:, self.deviation :] = state.chain[rows, other.deviation :]
        return State(chain, state.border)

    def targets(self, state: State) -> Matrix:
        """Target positions (n, 3) at the sightings."""
        place: Matrix = self.seen.t_s[:, None] * (state.border[V] * self.speed_sigma)
        place += state.border[P]
        if self.manoeuvres:
            place[:, :2] += self._psd_root * state.chain[:, self.deviation :: 2]
        return place

    def linearise(self, state: State) -> Linearised | None:
        """Residuals and Jacobians, or None where the target would be behind the camera."""
        seen, noise, chain, border = self.seen, self.noise, state.chain, state.border
        angles = chain[:, WANDER] * self._wander + border[HEADING:] * self._bias
        cosine, sine = np.cos(angles), np.sin(angles)
        d = self.targets(state)
        d -= seen.camera_m
        d += noise.position_walk_m_per_sqrt_s * chain[:, WALK] + noise.position_sigma_m * chain[:, WHITE]
        # M = Rx(tilt) camera_from_world Rz(heading), so q = M d and dq/dd = M.
        m = self._turned(cosine, sine)
        q = np.matmul(m, d[:, :, None])[:, :, 0]
        z = q[:, 2]
        if not z.min() > 1e-6:
            return None
        inverse = 1.0 / z
        ideal = q[:, :2] * inverse[:, None]
        residual = np.empty((self.count, 3))
        residual[:, :2] = np.matmul(seen.scale, (seen.measured[:, :2] - ideal)[:, :, None])[:, :, 0]
        residual[:, 2] = seen.size_scale * (seen.measured[:, 2] - border[SIZE] + np.log(z))
        # K = d(residual) / dq.
        k = np.zeros((self.count, 3, 3))
        k[:, :2, :2] = seen.scale * -inverse[:, None, None]
        k[:, :2, 2] = -np.matmul(k[:, :2, :2], ideal[:, :, None])[:, :, 0]
        k[:, 2, 2] = seen.size_scale * inverse
        by_place = np.matmul(k, m)
        # By heading error, tilt error and place; everything else is one of these times a constant.
        basis = np.empty((self.count, 3, 5))
        basis[:, :, 0] = by_place[:, :, 1] * d[:, :1] - by_place[:, :, 0] * d[:, 1:2]
        basis[:, :, 1] = k[:, :, 2] * q[:, 1:2] - k[:, :, 1] * q[:, 2:]
        basis[:, :, 2:] = by_place
        flat = basis.reshape(-1, 5)
        own = (flat @ self._own_mix).reshape(self.count, 3, self.block)
        shared = (flat @ self._shared_mix).reshape(self.count, 3, BORDER)
        shared[:, :, V] = by_place * self._speed_time
        shared[:, 2, SIZE] = -seen.size_scale
        if self.fills_size:
            missing = ~self.has_size
            residual[missing, 2] = chain[missing, self.size_place]
            own[missing, 2, self.size_place] = 1.0
        weighted = self.weighted(residual[:, :, None])[:, :, 0]
        pull = self._prior_times(chain)
        surprise = border - self.border_prior.mean
        cost = float(np.vdot(residual, weighted) + np.vdot(chain, pull))
        cost += float(surprise @ self.border_prior.information @ surprise)
        return Linearised(state, cost, residual, own, shared, weighted, pull)

    def _turned(self, cosine: Matrix, sine: Matrix) -> Matrix:
        """Rx(tilt) camera_from_world Rz(heading), (n, 3, 3), of the (n, 2) cosines and sines of heading and tilt."""
        r = self.seen.camera_from_world
        ca, sa, cb, sb = cosine[:, :1], sine[:, :1], cosine[:, 1:], sine[:, 1:]
        m = np.empty_like(r)
        m[:, :, 0] = r[:, :, 0] * ca + r[:, :, 1] * sa
        m[:, :, 1] = r[:, :, 1] * ca - r[:, :, 0] * sa
        m[:, :, 2] = r[:, :, 2]
        second = m[:, 1] * cb - m[:, 2] * sb
        m[:, 2] = m[:, 1] * sb + m[:, 2] * cb
        m[:, 1] = second
        return m

    def _mixes(self) -> tuple[Matrix, Matrix]:
        """Derivatives of heading error, tilt error and place by a block of the chain (5, b) and the border (5, 9)."""
        noise, place = self.noise, np.eye(3)
        own, shared = np.zeros((5, self.block)), np.zeros((5, BORDER))
        own[0, 0], own[1, 1] = self._wander
        own[2:, WALK] = noise.position_walk_m_per_sqrt_s * place
        own[2:, WHITE] = noise.position_sigma_m * place
        if self.manoeuvres:
            own[2:, self.deviation :: 2] = self._psd_root * place[:, :2]
        shared[2:, P] = place
        shared[0, HEADING], shared[1, TILT] = self._bias
        return own, shared

    def weighted(self, rows: Matrix) -> Matrix:
        """The measurement noise's precision (tridiagonal in time) times rows (n, 3, k)."""
        product = self.precision[:, :, None] * rows
        product[1:] += self.precision_off[:, :, None] * rows[:-1]
        product[:-1] += self.precision_off[:, :, None] * rows[1:]
        return product

    def normal_equations(self, at: Linearised) -> tuple[Factored, Vector, Vector]:
        """Factored Gauss-Newton Hessian, and the negative half gradient by chain (n * b,) and border (9,).

        Raises:
            NotPositiveDefinite: something is not observable.
        """
        own, shared, count, size = at.chain_jacobian, at.border_jacobian, self.count, self.block
        transposed = np.swapaxes(own, 1, 2)
        diagonal = np.matmul(transposed * self.precision[:, None, :], own)
        diagonal += self.prior_diagonal
        below = np.matmul(transposed[1:] * self.precision_off[:, None, :], own[:-1])
        below += self.prior_below
        weighted = np.concatenate((self.weighted(shared), at.weighted[:, :, None]), axis=2)
        by_chain = np.matmul(transposed, weighted)
        by_border = shared.reshape(-1, BORDER).T @ weighted.reshape(-1, BORDER + 1)
        border = by_border[:, :BORDER] + self.border_prior.information
        coupling = by_chain[:, :, :BORDER].reshape(count * size, BORDER)
        chain_gradient = by_chain[:, :, BORDER] + at.prior_pull
        border_gradient = by_border[:, BORDER] + self.border_prior.information @ (
            at.state.border - self.border_prior.mean
        )
        return factor(diagonal, below, coupling, border), -chain_gradient.reshape(-1), -border_gradient

    def gradient(self, at: Linearised) -> tuple[Vector, Vector]:
        """Half the gradient of the cost by chain (n * b,) and border (9,)."""
        own = np.matmul(np.swapaxes(at.chain_jacobian, 1, 2), at.weighted[:, :, None])[:, :, 0]
        shared = at.border_jacobian.reshape(-1, BORDER).T @ at.weighted.reshape(-1)
        surprise = at.state.border - self.border_prior.mean
        return (own + at.prior_pull).reshape(-1), shared + self.border_prior.information @ surprise

    def _known_border(self) -> BorderPrior:
        """What is known of the border before the first sighting."""
        prior, mean = self.prior, np.zeros(BORDER)
        known = np.array((0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0 if self.any_size else 1.0, 1.0, 1.0))
        if prior.ground_up_m is not None:
            up = P.start + 2
            mean[up] = prior.ground_up_m + prior.centre_above_ground_m - self.seen.reference_m[2]
            known[up] = max(prior.ground_sigma_m or 0.0, LEAST_GROUND_SIGMA_M) ** -2
        if self.any_size and prior.height_m is not None:
            mean[SIZE] = math.log(prior.height_m)
            known[SIZE] = max((prior.height_sigma_m or 0.0) / prior.height_m, LEAST_SIZE_SIGMA) ** -2
        return BorderPrior(mean, np.diag(known))

    def _prior_times(self, chain: Matrix) -> Matrix:
        product: Matrix = self._prior_own * chain
        product[1:] += self._prior_off * chain[:-1]
        product[:-1] += self._prior_off * chain[1:]
        if self.manoeuvres:
            # Position and rate of the target's deviation are coupled, so their blocks are not diagonal.
            there = slice(self.deviation, None)
            mixed, off = self.prior_diagonal[:, there, there], self.prior_below[:, there, there]
            deviation = chain[:, there, None]
            product[:, there] = np.matmul(mixed, deviation)[:, :, 0]
            product[1:, there] += np.matmul(off, deviation[:-1])[:, :, 0]
            product[:-1, there] += np.matmul(np.swapaxes(off, 1, 2), deviation[1:])[:, :, 0]
        return product

    def _chain_prior(self) -> tuple[Matrix, Matrix]:
        steps, noise = self.seen.steps_s, self.noise
        diagonal = np.zeros((self.count, self.block, self.block))
        below = np.zeros((max(self.count - 1, 0), self.block, self.block))
        heading = gauss_markov(steps, noise.heading_correlation_s)
        tilt = gauss_markov(steps, noise.tilt_correlation_s)
        walk = random_walk(steps)
        for place, chain in enumerate((heading, tilt, walk, walk, walk)):
            diagonal[:, place, place] = chain.diagonal
            below[:, place, place] = chain.off
        for place in range(5, self.deviation):
            diagonal[:, place, place] = 1.0
        if self.fills_size:
            # The size error of a sighting without a height has no prior of its own: the size noise's chain is it.
            diagonal[~self.has_size, self.size_place, self.size_place] = 0.0
        if self.manoeuvres:
            blocks, lower = white_noise_acceleration(steps)
            for axis in (self.deviation, self.deviation + 2):
                diagonal[:, axis : axis + 2, axis : axis + 2] = blocks
                below[:, axis : axis + 2, axis : axis + 2] = lower
        return diagonal, below
