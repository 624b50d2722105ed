"""How likely a flight's residuals are under smooth errors of the pose: a dense restricted likelihood.

Real autopilots' position and heading errors are smooth: over a short lag L they change in proportion to L (a
second-order Gauss-Markov process, correlation (1 + L / tau) exp(-L / tau)), while a first-order process changes with
the root of L. A fit of first-order processes would look at the shortest lags, find next to nothing, and call a bad
pose good. So the level is fitted with the smooth process, and `first_order_*` give the first-order one with the same
power at the pattern's own frequency, which is where it disturbs the parallax.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from mission.estimate.arrow import NotPositiveDefinite
from mission.estimate.joint_model import HEADING, SIZE, TILT, WALK, WHITE, JointModel, Linearised, P, V
from mission.records import Matrix, Vector

HEADING_TAU_S = 1.6
POSITION_TAU_S = 1.3
TILT_TAU_S = 5.0
"""Of the smooth heading and position errors and of the first-order tilt error, as measured on two autopilots."""


class SmoothLikelihood:
    """-2 log restricted likelihood of six factors, the model linearised at its most probable state.

    The factors scale heading, tilt, position (its smooth sigma in units of the random walk's over one second), white
    position error, pixel and size.
    """

    def __init__(self, model: JointModel, at: Linearised, rows: NDArray[np.intp]) -> None:
        """Takes the sightings `rows` (indices) of the model."""
        seen, noise = model.seen, model.noise
        picked = rows
        t = seen.t_s[picked]
        own = at.chain_jacobian[picked]
        shared = at.border_jacobian[picked]
        explained = np.matmul(at.chain_jacobian, at.state.chain[:, :, None])[:, :, 0]
        y = (at.residual - explained - at.border_jacobian @ at.state.border)[picked]
        measured = np.ones((len(picked), 3), dtype=bool)
        measured[:, 2] = model.has_size[picked]
        flat = measured.reshape(-1)
        lag = np.abs(t[:, None] - t)

        def spread(kernel: Matrix, column: Matrix) -> Matrix:
            """Covariance (m, m) of one error process that enters the residuals (n, 3) by `column`."""
            full = column[:, :, None, None] * kernel[:, None, :, None] * column[None, None]
            return np.ascontiguousarray(full.reshape(3 * len(t), -1)[np.ix_(flat, flat)])

        places = own[:, :, WALK]
        position = smooth(lag, POSITION_TAU_S)
        channels = np.eye(3)
        pixel, size = _first_order(lag, noise.pixel_correlation_s), _first_order(lag, noise.size_correlation_s)
        everyone = np.ones((len(t), 1))
        parts = np.array(
            [
                spread(smooth(lag, HEADING_TAU_S), own[:, :, 0]),
                spread(_first_order(lag, TILT_TAU_S), own[:, :, 1]),
                sum(spread(position, places[:, :, axis]) for axis in range(3)),
                sum(spread(np.eye(len(t)), own[:, :, WHITE][:, :, axis]) for axis in range(3)),
                spread(pixel, everyone * channels[0]) + spread(pixel, everyone * channels[1]),
                spread(size, everyone * channels[2]),
            ]
        )
        self.parts = parts.reshape(len(parts), -1)
        known = shared[:, :, [V.start, V.start + 1, V.start + 2, HEADING, TILT]].reshape(-1, 5)[flat]
        self.fixed = known @ known.T
        unknown = [P.start, P.start + 1, P.start + 2, *([SIZE] if model.any_size else [])]
        self.unknown = np.column_stack([shared[:, :, unknown].reshape(-1, len(unknown))[flat], y.reshape(-1)[flat]])

    def __call__(self, log_factors: Vector) -> float:
        """At the logarithms (6,) of the factors.

        Raises:
            NotPositiveDefinite: the sightings do not determine the target.
        """
        covariance = (np.exp(2.0 * log_factors) @ self.parts).reshape(self.fixed.shape)
        covariance += self.fixed
        # Symmetric, so its transpose will do, which LAPACK takes as it is.
        factor, info = lapack.dpotrf(covariance.T, lower=1, overwrite_a=1)
        half, _ = lapack.dtrtrs(factor, self.unknown, lower=1)
        gram = half.T @ half
        information, failed = lapack.dpotrf(gram[:-1, :-1], lower=1)
        if info != 0 or failed != 0:
            raise NotPositiveDefinite("the noise level cannot be fitted")
        explained, _ = lapack.dtrtrs(information, gram[:-1, -1], lower=1)
        determinant = np.log(factor.diagonal()).sum() + np.log(information.diagonal()).sum()
        return float(gram[-1, -1] - np.sum(explained**2) + 2.0 * determinant)


def smooth(lag_s: Matrix, tau_s: float) -> Matrix:
    """Correlation of a second-order Gauss-Markov process over a lag."""
    ratio = lag_s / tau_s
    return np.asarray((1.0 + ratio) * np.exp(-ratio))


def first_order_sigma(smooth_sigma: float, tau_s: float, correlation_s: float, rate_rad_s: float) -> float:
    """Sigma of the first-order process with the same power spectral density as a smooth one at an angular rate.

    Smooth: 4 tau sigma^2 / (1 + (w tau)^2)^2; first order: 2 tau sigma^2 / (1 + (w tau)^2); white stays white.
    """
    if correlation_s <= 0.0:
        return smooth_sigma
    power = 4.0 * tau_s * smooth_sigma**2 / (1.0 + (rate_rad_s * tau_s) ** 2) ** 2
    return math.sqrt(power * (1.0 + (rate_rad_s * correlation_s) ** 2) / (2.0 * correlation_s))


def random_walk_intensity(smooth_sigma: float, tau_s: float, rate_rad_s: float) -> float:
    """Intensity (per root second) of the random walk with the same power spectral density, q^2 / w^2."""
    return 2.0 * math.sqrt(tau_s) * smooth_sigma * rate_rad_s / (1.0 + (rate_rad_s * tau_s) ** 2)


def _first_order(lag_s: Matrix, tau_s: float) -> Matrix:
    if tau_s <= 0.0:
        return np.asarray(lag_s == 0.0, dtype=float)
    return np.asarray(np.exp(-lag_s / tau_s))
