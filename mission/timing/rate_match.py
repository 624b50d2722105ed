"""Two curves of the same rotation, seen and reported, shifted in time against each other until they agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, lapack
from scipy.ndimage import gaussian_filter1d, median_filter
from scipy.optimize import minimize_scalar
from scipy.special import erf

from mission.records import Matrix, Vector
from mission.timing.reported_rotation import SMOOTH_S

_GRID_S = 0.01
_ROUNDS = 3
_HUBER = 2.5
_LONE = 5
"""Pairs, of which the median is what a lone outlier is told from."""
_WANDER_S = 1.8
"""Correlation time of a reported heading's wandering, as on a recorded flight."""
_WANDERS_RAD = (1e-4, 3e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.015, 0.03, 0.06)
_WALKS = (1e-4, 3e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.016, 0.03)
"""Rad per root of a second."""
_PICTURE_SHARES = (0.25, 0.35, 0.5, 0.7, 1.0, 1.5)
_REPORT_SHARES = (0.1, 0.25, 0.5)
"""Sizes of the four kinds of noise that are tried; two of them in units of what neighbouring residuals differ by."""
_ORDER = (2, 3, 0, 1)
_SWEEPS = 2
_USUAL_GAIN, _GAIN_SIGMA = 1.0, 0.05
"""A camera is calibrated to a few per cent; a heading that wanders may pretend more."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """How two curves agree at an offset."""

    gain: float
    """Seen over reported."""
    correlation: float
    sigma_s: float
    """Standard deviation of the offset, from these curves alone."""


class RateMatch:
    """Generalised least squares of ``reported(shifted by the offset) = seen / gain + drift * duration + noise``.

    The picture's turn is the clean side of it: what wanders is in the reports. The other way round a wandering report
    would look like a turn that tells the offset, and the stated deviation would be several times too small.

    The noise of a turn between two frames has four parts: the picture's, new for every pair; the attitude report's
    at either end, which the next pair has again with the other sign; and the wandering of the reported angle, both as
    a heading wanders, a Gauss-Markov process of second order, and as a tilt does, of first order, which over so short
    a time is a random walk (Brown & Hwang, Introduction to Random Signals and Applied Kalman Filtering, 3.8). The
    wandering is slow, so where it is large the offset is taken from the beginnings and ends of turns and not from how
    their middles differ, which looks much the same as a shift. The sizes are those that make the residuals most likely.

    Args:
        spans: (N, 2) times of the two frames of each pair.
        seen: (N,) turn seen in the picture, rad.
        reported: the turn reported in given time spans, (N, 2) -> (N,).
    """

    def __init__(self, spans: Matrix, seen: Vector, reported: Callable[[Matrix], Vector]) -> None:
        self._spans = spans
        self._reported = reported
        self._duration_s = spans[:, 1] - spans[:, 0]
        self._design: Matrix = np.column_stack([seen, self._duration_s])
        self.extent_rad = float(np.ptp(np.concatenate([[0.0], np.cumsum(seen)])))
        """Of the movement seen."""
        joined = np.abs(spans[1:, 0] - spans[:-1, 1]) < 0.25 * self._duration_s[1:]
        neighbours = np.diag(joined.astype(float), 1)
        self._shared: Matrix = 2.0 * np.eye(len(seen)) - neighbours - neighbours.T
        between = np.hstack([-np.eye(len(seen)), np.eye(len(seen))])
        ends = spans.T.ravel()
        apart = np.abs(ends[:, None] - ends[None, :])
        lag = apart / _WANDER_S
        self._wander: Matrix = between @ ((1.0 + lag) * np.exp(-lag)) @ between.T
        # Half the variogram of a random walk is half the lag; the reports' smoothing rounds its corner.
        rounding = 2.0 * SMOOTH_S
        rounded = apart * erf(apart / rounding) + rounding / math.sqrt(math.pi) * np.exp(-np.square(apart / rounding))
        self._walk: Matrix = between @ (-0.5 * rounded) @ between.T
        self._bend = _bend(seen / self._duration_s, joined.tolist())
        self._weight: Vector = np.ones(len(seen))
        self._gain_weight = 0.0
        self._weigh(np.eye(len(seen)))

    def cost(self, offset_s: float) -> float:
        """Sum of the whitened squared residuals."""
        wanted = self._whiten(self._reported(self._spans - offset_s))
        solution = self._solution(wanted)
        known = self._gain_weight * (float(solution[0]) - _USUAL_GAIN)
        return float(np.sum((wanted - self._white_design @ solution) ** 2)) + known**2

    def turned_rad(self, offset_s: float) -> float:
        """Extent of the reported movement."""
        steps = self._reported(self._spans - offset_s)
        return float(np.ptp(np.concatenate([[0.0], np.cumsum(steps)])))

    def unsteady_rad(self, offset_s: float) -> float:
        """Extent of the reported movement beside a steady turn."""
        steps = self._reported(self._spans - offset_s)
        steady = float(steps @ self._duration_s / (self._duration_s @ self._duration_s)) * self._duration_s
        return float(np.ptp(np.concatenate([[0.0], np.cumsum(steps - steady)])))

    def agreement(self, offset_s: float) -> Agreement:
        """How well the curves agree, and how well they tell the offset."""
        residual, solution = self._residual(offset_s)
        jacobian = self._jacobian(float(solution[0]))
        white_jacobian, white_residual = self._whiten(jacobian), self._whiten(residual)
        bread = np.linalg.pinv(white_jacobian.T @ white_jacobian)
        variance = bread[0, 0] * float(white_residual @ white_residual) / max(len(residual) - jacobian.shape[1], 1)
        told = self._reported(self._spans - offset_s)
        spread = told - np.average(told, weights=self._weight)
        unexplained = float(np.sum(self._weight * residual**2)) / max(float(np.sum(self._weight * spread**2)), 1e-12)
        return Agreement(
            1.0 / max(float(solution[0]), 1e-6),
            math.sqrt(max(0.0, 1.0 - unexplained)),
            math.sqrt(max(float(variance), 0.0)),
        )

    def learn_noise(self, offset_s: float) -> None:
        """Tell the sizes of the noise, and outliers, from what is left at an offset."""
        residual, solution = self._residual(offset_s)
        columns = np.column_stack([residual, self._jacobian(float(solution[0]))])
        # What wanders is smooth: the differences of neighbours tell the rest.
        rough = np.diff(residual) / math.sqrt(2.0)
        scale = max(1.4826 * float(np.median(np.abs(rough))), 1e-5)
        lone = residual - median_filter(residual, _LONE, mode="nearest")
        limit = _HUBER * max(1.4826 * float(np.median(np.abs(lone))), scale)
        self._weight = limit / np.maximum(np.abs(lone), limit)
        kinds = _PICTURE_SHARES, _REPORT_SHARES, _WANDERS_RAD, _WALKS
        levels = [len(sizes) // 2 for sizes in kinds]
        best, factor, seen = math.inf, np.eye(len(residual)), set()
        for kind in _ORDER * _SWEEPS:  # one kind after the other; all combinations would take seconds
            for level in range(len(kinds[kind])):
                tried = [*levels[:kind], level, *levels[kind + 1 :]]
                if tuple(tried) in seen:
                    continue
                seen.add(tuple(tried))
                picture, report, wander, walk = (sizes[at] for sizes, at in zip(kinds, tried, strict=True))
                covariance = wander**2 * self._wander + walk**2 * self._walk + (report * scale) ** 2 * self._shared
                covariance += np.diag(np.square(picture * scale / self._weight))
                # Symmetric, so its transpose will do, which LAPACK takes as it is.
                root, info = lapack.dpotrf(covariance.T, lower=1, overwrite_a=1)
                if info != 0:
                    raise LinAlgError("the noise of the turns has no regular covariance")
                white, _ = lapack.dtrtrs(root, columns, lower=1)
                # Restricted likelihood: what was fitted to the same residuals has made them smaller.
                _, used = np.linalg.slogdet(white[:, 1:].T @ white[:, 1:])
                unlikely = float(white[:, 0] @ white[:, 0]) + 2.0 * float(np.log(np.diag(root)).sum()) + used
                if unlikely < best:
                    best, factor, levels = unlikely, root, tried
        self._gain_weight = 1.0 / _GAIN_SIGMA
        self._weigh(factor)

    def _jacobian(self, inverse_gain: float) -> Matrix:
        """(N, 3): how the reported turns change with the offset, the gain and the drift."""
        return np.column_stack([-inverse_gain * self._bend, self._design])

    def _residual(self, offset_s: float) -> tuple[Vector, Vector]:
        told = self._reported(self._spans - offset_s)
        solution = self._solution(self._whiten(told))
        return told - self._design @ solution, solution

    def _weigh(self, factor: Matrix) -> None:
        """Fit under a covariance of the noise from now on, of which this is the lower Cholesky factor."""
        self._factor = np.asfortranarray(factor)
        self._white_design: Matrix = self._whiten(self._design)
        # What is known of the gain beforehand, as one more row.
        known = np.array([[self._gain_weight, 0.0]])
        self._fit: Matrix = np.linalg.pinv(np.vstack([self._white_design, known]))

    def _solution(self, wanted: Vector) -> Vector:
        """One over the gain, and the drift, that explain the reported turns (N,), whitened, best."""
        return np.asarray(self._fit @ np.append(wanted, self._gain_weight * _USUAL_GAIN), dtype=np.float64)

    def _whiten(self, columns: Matrix) -> Matrix:
        white, _ = lapack.dtrtrs(self._factor, columns, lower=1)
        return np.asarray(white, dtype=np.float64).reshape(columns.shape)


def best_offset(matches: Sequence[RateMatch], low_s: float, high_s: float) -> float:
    """The offset that makes all curves agree best, between two bounds.

    Args:
        matches: of several axes; the offset is the same for all of them.
        low_s: smallest offset.
        high_s: largest offset.
    """
    candidates = np.arange(low_s, high_s + 1e-9, _GRID_S)
    # Costs of several axes can be added when their noise is known; at first the one that moved most is enough.
    weighed: Sequence[RateMatch] = (max(matches, key=lambda match: match.extent_rad),)
    offset_s = 0.0
    for _ in range(_ROUNDS):

        def cost(offset_s: float, weighed: Sequence[RateMatch] = weighed) -> float:
            return sum(match.cost(offset_s) for match in weighed)

        best = float(candidates[int(np.argmin([cost(float(candidate)) for candidate in candidates]))])
        found = minimize_scalar(
            cost, bounds=(best - _GRID_S, best + _GRID_S), method="bounded", options={"xatol": 1e-5}
        )
        offset_s = float(found.x)
        for match in matches:
            match.learn_noise(offset_s)
        weighed = matches
    return offset_s


def _bend(rate: Vector, joined: Sequence[bool]) -> Vector:
    """(N,): rate of turn at the end of each pair less that at its beginning, smoothed over a frame."""
    smooth = gaussian_filter1d(rate, 1.0, mode="nearest", truncate=2.0)
    beginning, end = smooth.copy(), smooth.copy()
    both, inner = 0.5 * (smooth[1:] + smooth[:-1]), np.asarray(joined, dtype=bool)
    beginning[1:][inner], end[:-1][inner] = both[inner], both[inner]
    return np.asarray(end - beginning, dtype=np.float64)
