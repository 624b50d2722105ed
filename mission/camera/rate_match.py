"""Two curves of the same rotation, seen and reported, shifted in time against each other until they agree."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.ndimage import binary_dilation, gaussian_filter1d, median_filter
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from mission.camera.camera import Camera
from mission.camera.mounting import rotation
from mission.pose import Pose
from mission.records import Matrix, Vector

_GRID_S = 0.01
_SMOOTH_S = 0.04
"""Standard deviation of the smoothing of the reports: quicker than any turn of an aircraft that carries a camera."""
_STEP_S = 0.005
_ROUNDS = 3
_HUBER = 2.5
_LAGS = 4
"""Neighbouring pairs of frames share a piece of the aircraft's sway, so their residuals are correlated."""
_FLOOR_SIGMA_S = 0.002
_LONE = 5
"""Pairs, of which the median is what a lone outlier is told from."""
_WANDER_S = 1.8
"""Correlation time of a reported heading's wandering, as on a recorded flight."""
_WANDERS_RAD = (3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.06)
_PICTURE_SHARES = (0.25, 0.5, 1.0, 1.5)
_REPORT_SHARES = (0.1, 0.5)
"""Sizes of the three kinds of noise that are tried; two of them in units of what neighbouring residuals differ by."""
_USUAL_GAIN, _GAIN_SIGMA = 1.0, 0.05
"""A camera is calibrated to a few per cent; a heading that wanders may pretend more."""


@dataclass(frozen=True, slots=True, eq=False)
class ReportedRotation:
    """What the telemetry says about the camera's rotation, on a fine grid of times."""

    times_s: Vector
    angle_rad: Matrix
    """(N, 3): rotation about the camera's own axes, added up since the first time."""
    gaps: Vector
    """(N,): how many unknown steps there were up to here."""

    @classmethod
    def collect(
        cls, pose_at: Callable[[float], Pose | None], camera: Camera, from_s: float, to_s: float
    ) -> ReportedRotation:
        """Ask for the attitude all along a span of time."""
        times = np.arange(from_s, to_s + _GRID_S, _GRID_S)
        poses = [pose_at(float(t_s)) for t_s in times]
        known = np.array([pose is not None for pose in poses])
        steps = np.zeros((len(times), 3))
        if np.count_nonzero(known) > 1:
            body = Rotation.concatenate([rotation(pose.world_from_body_wxyz) for pose in poses if pose is not None])
            world_from_camera = body * camera.mounting.body_from_camera
            steps[np.flatnonzero(known)[1:]] = (world_from_camera[:-1].inv() * world_from_camera[1:]).as_rotvec()
        # The reports' own noise, interpolated, would make one offset look better than the next; a symmetric smoothing
        # takes it away and moves no edge. Seen through the smoothing, an unknown step spoils its surroundings too.
        angle = gaussian_filter1d(np.cumsum(steps, axis=0), _SMOOTH_S / _GRID_S, axis=0, mode="nearest", truncate=3.0)
        unknown = binary_dilation(~known, iterations=round(3.0 * _SMOOTH_S / _GRID_S))
        return cls(times, angle, np.cumsum(unknown).astype(float))

    def known(self, spans: Matrix) -> NDArray[np.bool_]:
        """Which time spans (N, 2) are covered without a gap."""
        first = np.searchsorted(self.times_s, spans[:, 0], side="right") - 1
        last = np.searchsorted(self.times_s, spans[:, 1])
        inside = (first >= 0) & (last < len(self.times_s))
        first, last = np.clip(first, 0, None), np.clip(last, None, len(self.times_s) - 1)
        covered: NDArray[np.bool_] = inside & (self.gaps[last] == self.gaps[first])
        return covered

    def turn(self, spans: Matrix) -> Matrix:
        """Rotation (N, 3) about the camera's axes in each time span (N, 2)."""
        return np.column_stack(
            [
                np.interp(spans[:, 1], self.times_s, angle) - np.interp(spans[:, 0], self.times_s, angle)
                for angle in self.angle_rad.T
            ]
        )


class RateMatch:
    """Generalised least squares of ``seen = gain * reported(shifted by the offset) + drift * duration + noise``.

    The noise of a turn between two frames has three parts: the picture's, new for every pair; the attitude report's
    at either end, which the next pair has again with the other sign; and the wandering of the reported heading, a
    Gauss-Markov process of second order as real autopilots have it (Brown & Hwang, Introduction to Random Signals and
    Applied Kalman Filtering, 3.8). The last one is smooth, so where it is large the offset is taken from the beginnings
    and ends of turns and not from how their middles differ, which looks much the same as a shift. The three sizes are
    those that make the residuals most likely.

    Args:
        spans: (N, 2) times of the two frames of each pair.
        seen: (N,) turn seen in the picture, rad.
        reported: the turn reported in given time spans, (N, 2) -> (N,).
    """

    def __init__(self, spans: Matrix, seen: Vector, reported: Callable[[Matrix], Vector]) -> None:
        self._spans = spans
        self._seen = seen
        self._reported = reported
        self._duration_s = spans[:, 1] - spans[:, 0]
        joined = np.abs(spans[1:, 0] - spans[:-1, 1]) < 0.25 * self._duration_s[1:]
        neighbours = np.diag(joined.astype(float), 1)
        self._shared: Matrix = 2.0 * np.eye(len(seen)) - neighbours - neighbours.T
        between = np.hstack([-np.eye(len(seen)), np.eye(len(seen))])
        ends = spans.T.ravel()
        lag = np.abs(ends[:, None] - ends[None, :]) / _WANDER_S
        self._wander: Matrix = between @ ((1.0 + lag) * np.exp(-lag)) @ between.T
        self._weight: Vector = np.ones(len(seen))
        self._factor: Matrix = np.eye(len(seen))
        self._gain_weight = 0.0

    def best_offset(self, low_s: float, high_s: float) -> float:
        """The offset of the least cost between two bounds."""
        candidates = np.arange(low_s, high_s + 1e-9, _GRID_S)
        offset_s = 0.0
        for _ in range(_ROUNDS):  # from the second on with the noise and the outliers known
            best = float(candidates[int(np.argmin([self._cost(float(candidate)) for candidate in candidates]))])
            found = minimize_scalar(
                self._cost, bounds=(best - _GRID_S, best + _GRID_S), method="bounded", options={"xatol": 1e-5}
            )
            offset_s = float(found.x)
            self._learn_noise(offset_s)
        return offset_s

    def turned_rad(self, offset_s: float) -> float:
        """Extent of the reported movement."""
        steps = self._reported(self._spans - offset_s)
        return float(np.ptp(np.concatenate([[0.0], np.cumsum(steps)])))

    def unsteady_rad(self, offset_s: float) -> float:
        """Extent of the reported movement beside a steady turn."""
        steps = self._reported(self._spans - offset_s)
        steady = float(steps @ self._duration_s / (self._duration_s @ self._duration_s)) * self._duration_s
        return float(np.ptp(np.concatenate([[0.0], np.cumsum(steps - steady)])))

    def quality(self, offset_s: float) -> tuple[float, float, float]:
        """Gain, correlation of the two curves, and the standard deviation of the offset, s (Newey-West)."""
        residual, solution = self._residual(offset_s)
        jacobian = self._fitted(offset_s, float(solution[0]))
        white_jacobian, white_residual = self._whiten(jacobian), self._whiten(residual)
        bread = np.linalg.pinv(white_jacobian.T @ white_jacobian)
        scores = white_residual[:, None] * white_jacobian
        plain = scores.T @ scores
        filling = plain
        for lag in range(1, _LAGS + 1):
            product = scores[lag:].T @ scores[:-lag]
            filling = filling + (1.0 - lag / (_LAGS + 1.0)) * (product + product.T)
        freedom = len(residual) / max(len(residual) - jacobian.shape[1], 1)
        modelled = bread[0, 0] * float(white_residual @ white_residual) / len(residual)
        variance = freedom * max(modelled, *(float((bread @ part @ bread)[0, 0]) for part in (plain, filling)))
        spread = self._seen - np.average(self._seen, weights=self._weight)
        unexplained = float(np.sum(self._weight * residual**2)) / max(float(np.sum(self._weight * spread**2)), 1e-12)
        return (
            float(solution[0]),
            math.sqrt(max(0.0, 1.0 - unexplained)),
            math.hypot(math.sqrt(variance), _FLOOR_SIGMA_S),
        )

    def _design(self, offset_s: float) -> Matrix:
        return np.column_stack([self._reported(self._spans - offset_s), self._duration_s])

    def _fitted(self, offset_s: float, gain: float) -> Matrix:
        """(N, 3): how the turns change with the offset, the gain and the drift."""
        early = self._reported(self._spans - offset_s - _STEP_S)
        late = self._reported(self._spans - offset_s + _STEP_S)
        return np.column_stack([gain * (early - late) / (2.0 * _STEP_S), self._design(offset_s)])

    def _cost(self, offset_s: float) -> float:
        residual, solution = self._residual(offset_s)
        known = self._gain_weight * (float(solution[0]) - _USUAL_GAIN)
        return float(np.sum(self._whiten(residual) ** 2)) + known**2

    def _residual(self, offset_s: float) -> tuple[Vector, Vector]:
        design = self._design(offset_s)
        columns, wanted = self._whiten(design), self._whiten(self._seen)
        # What is known of the gain beforehand, as one more row.
        known = np.array([[self._gain_weight, 0.0]])
        solution, *_ = np.linalg.lstsq(
            np.vstack([columns, known]), np.append(wanted, self._gain_weight * _USUAL_GAIN), rcond=None
        )
        return self._seen - design @ solution, np.asarray(solution, dtype=np.float64)

    def _whiten(self, columns: Matrix) -> Matrix:
        return np.asarray(solve_triangular(self._factor, columns, lower=True, check_finite=False), dtype=float)

    def _learn_noise(self, offset_s: float) -> None:
        residual, solution = self._residual(offset_s)
        fitted = self._fitted(offset_s, float(solution[0]))
        # What wanders is smooth: the differences of neighbours tell the rest.
        rough = np.diff(residual) / math.sqrt(2.0)
        scale = max(1.4826 * float(np.median(np.abs(rough))), 1e-5)
        lone = residual - median_filter(residual, _LONE, mode="nearest")
        limit = _HUBER * max(1.4826 * float(np.median(np.abs(lone))), scale)
        self._weight = limit / np.maximum(np.abs(lone), limit)
        best = math.inf
        for picture in _PICTURE_SHARES:
            for report in _REPORT_SHARES:
                for wander in _WANDERS_RAD:
                    covariance = wander**2 * self._wander + (report * scale) ** 2 * self._shared
                    covariance += np.diag(np.square(picture * scale / self._weight))
                    factor = cholesky(covariance, lower=True, check_finite=False)
                    white = solve_triangular(
                        factor, np.column_stack([residual, fitted]), lower=True, check_finite=False
                    )
                    # Restricted likelihood: what was fitted to the same residuals has made them smaller.
                    _, used = np.linalg.slogdet(white[:, 1:].T @ white[:, 1:])
                    unlikely = float(white[:, 0] @ white[:, 0]) + 2.0 * float(np.log(np.diag(factor)).sum()) + used
                    if unlikely < best:
                        best, self._factor = unlikely, factor
        self._gain_weight = 1.0 / _GAIN_SIGMA
