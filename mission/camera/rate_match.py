"""Two curves of the same rotation, seen and reported, shifted in time against each other until they agree."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded
from scipy.ndimage import binary_dilation, gaussian_filter1d
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
_HUBER = 1.345
_LAGS = 4
"""Neighbouring pairs of frames share a piece of the aircraft's sway, so their residuals are correlated."""
_FLOOR_SIGMA_S = 0.002


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

    The noise of a turn between two frames has two parts: the picture's, new for every pair, and the attitude report's
    at either end, which the next pair has again with the other sign. So the covariance is tridiagonal; both variances
    are estimated from the residuals. Treating the turns as independent would throw away most of the information.

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
        self._joined = np.abs(spans[1:, 0] - spans[:-1, 1]) < 0.25 * self._duration_s[1:]
        self._weight: Vector = np.ones(len(seen))
        self._set_noise(1.0, 0.0)

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
        early = self._reported(self._spans - offset_s - _STEP_S)
        late = self._reported(self._spans - offset_s + _STEP_S)
        jacobian = np.column_stack([solution[0] * (early - late) / (2.0 * _STEP_S), self._design(offset_s)])
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

    def _cost(self, offset_s: float) -> float:
        residual, _ = self._residual(offset_s)
        return float(np.sum(self._whiten(residual) ** 2))

    def _residual(self, offset_s: float) -> tuple[Vector, Vector]:
        design = self._design(offset_s)
        solution, *_ = np.linalg.lstsq(self._whiten(design), self._whiten(self._seen), rcond=None)
        return self._seen - design @ solution, np.asarray(solution, dtype=np.float64)

    def _whiten(self, columns: Matrix) -> Matrix:
        return np.asarray(solve_banded((1, 0), self._factor, columns), dtype=float)

    def _learn_noise(self, offset_s: float) -> None:
        residual, _ = self._residual(offset_s)
        scale = max(1.4826 * float(np.median(np.abs(residual))), 1e-6)
        self._weight = _HUBER * scale / np.maximum(np.abs(residual), _HUBER * scale)
        clipped = self._weight * residual
        total = float(np.mean(clipped**2))
        shared = -float(np.mean((clipped[1:] * clipped[:-1])[self._joined])) if self._joined.any() else 0.0
        shared = min(max(shared, 0.0), 0.49 * total)
        self._set_noise(max(total - 2.0 * shared, 0.02 * total, 1e-12), shared)

    def _set_noise(self, picture: float, report: float) -> None:
        """Variances of the picture's turn (outliers get more) and of the reported attitude, rad^2."""
        banded = np.zeros((2, len(self._seen)))
        banded[0] = picture / self._weight**2 + 2.0 * report
        banded[1, :-1] = np.where(self._joined, -report, 0.0)
        self._factor = cholesky_banded(banded, lower=True)
