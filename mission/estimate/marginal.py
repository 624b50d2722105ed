"""Marginal likelihood of a flight's sightings over the range and everything else: what the default estimator averages.

Given the range at the first sighting (`range_model.py`), a motion hypothesis (`motion_hypotheses.py`) and how bad the
pose is, all other unknowns are linear and normal, so that they are integrated out exactly:

    y = X b + U L e + errors,   errors ~ N(0, S),   e ~ N(0, I),   b ~ N(b0, P^-1)
    -2 log p(y) = y' S~^-1 y - ... + log det S + log det (I + L' U' S^-1 U L) + log det (X' S~^-1 X + P) - log det P

(Rasmussen & Williams 2.7). A mode of the joint density would put the target too near, since all deviations from a
steady walk are smaller there; the determinants are what they cost (46 % at 0.1 m2/s3). The deviation is written in the
few modes that carry it, so that one Cholesky decomposition per range and pose serves all hypotheses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from mission.estimate.camera_path import smoothed_path
from mission.estimate.kernels import exponential, integrated_random_walk
from mission.estimate.knots import Knots, knots
from mission.estimate.motion_hypotheses import SPEEDS, Hypothesis, motion_hypotheses, posture_modes
from mission.estimate.observations import LEAST_GROUND_SIGMA_M, Observations
from mission.estimate.range_model import COLUMNS, HEADING, RISE, SIZE, SPEED, TILT, Linearised, RangeModel
from mission.estimate.size_prior import SizePrior
from mission.records import Matrix, NoiseModel, TargetPrior, Vector

_MODES = 10
_MOST_MODES = 18
_MODE_S = 0.6
"""One mode for each of this many seconds, ten at least."""
_VERTICAL_PSD = 2e-4
"""Of the vertical velocity's random walk, m2/s3: kerbs, slopes."""
_LEAN_RAD, _LEAN_S = 0.03, 1.0
"""People lean, which changes the height seen from above by its tangent."""
_SMOOTHED = 2
"""Sightings on either side in the running median."""
_FLAT = 1e-9
_COMPASS_SHARE: Final = 0.6
_COMPASS_FACTOR: Final = 2.5
_COMPASS_RAD: Final = math.radians(5.0)
"""A heading's bias stays unseen, and compasses are off by more than is said of them. More likely than the stated sigma
is a larger one, by what compasses usually are off, but not more than so many times the stated."""
_LEAST_BIAS_RAD = 1e-6
_LEAST_SPEED_M_S = 1e-3
_VARIED: Final = (2, 3, SIZE, HEADING)
"""Unknowns of the design whose prior has variants: speed east and north, log height, heading bias."""


@dataclass(frozen=True, slots=True)
class Factors:
    """What the stated sigmas are multiplied by: bearing across and up, size, pose, and the pose's constant biases."""

    across: float = 1.0
    up: float = 1.0
    size: float = 1.0
    pose: float = 1.0
    bias: float = 1.0


@dataclass(frozen=True, slots=True)
class Variant:
    """One alternative of what is believed of speed, heading bias and height."""

    speed_factor: float
    heading_factor: float
    size: SizePrior
    share: float


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Of R ranges and H hypotheses, under the widest variant of the prior."""

    log: Matrix
    """(R, H), log marginal likelihood times the hypothesis' prior, up to a constant."""
    design: Matrix
    """(R, H, 8), mean of the design's unknowns."""
    covariance: Matrix
    """(R, H, 8, 8)."""
    modes: Matrix
    """(R, H, c, 9), by the design's unknowns and a constant: mean of e is `modes[..., 8] - modes[..., :8] @ design`."""
    inner: Matrix
    """(R, H, c, c), information of e given the design's unknowns."""


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Single points of range, hypothesis and variant."""

    log: Vector
    """(n,), log evidence."""
    place: NDArray[np.intp]
    """(n, 2), range and hypothesis."""
    variant: NDArray[np.intp]
    """(n,)."""
    design: Matrix
    """(n, 8)."""
    covariance: Matrix
    """(n, 8, 8)."""


_WIDEST: Final = Variant(SPEEDS[-1][0], _COMPASS_FACTOR, SizePrior.unknown(), 1.0)


def variants(sizes: Sequence[SizePrior], heading_bias_sigma_rad: float) -> tuple[Variant, ...]:
    """Every alternative of speed and heading bias with every one of the height."""
    usual = math.hypot(1.0, _COMPASS_RAD / max(heading_bias_sigma_rad, _LEAST_BIAS_RAD))
    compass = ((1.0, 1.0 - _COMPASS_SHARE), (min(usual, _COMPASS_FACTOR), _COMPASS_SHARE))
    return tuple(
        Variant(speed, heading, size, share * heading_share * size.share)
        for speed, share in SPEEDS
        for heading, heading_share in compass
        for size in sizes
    )


class MarginalModel:
    """One flight's evidence.

    Args:
        seen: its observations, three at least, the camera moving.
        noise: stated.
        prior: stated; its height counts in `variants`.
        asked_s: when the first of the two places is asked for, on the clock of `seen.t_s`.
    """

    def __init__(
        self,
        seen: Observations,
        noise: NoiseModel,
        prior: TargetPrior,
        asked_s: float = 0.0,
    ) -> None:
        self.seen, self.noise, self.prior = seen, noise, prior
        self.t_s = t = seen.t_s - asked_s
        self.first = min(int(np.searchsorted(t, 0.0)), len(t) - 1)
        """The sighting whose range is hypothesised."""
        self.knots: Knots = knots(seen, t)
        self.camera_m, path = smoothed_path(t, seen.camera_m, noise, self.knots)
        self.hypotheses: tuple[Hypothesis, ...] = motion_hypotheses(t, self.knots.bearing, prior)
        self._postures = posture_modes(t)
        self.geometry = RangeModel(seen, self.knots, self.camera_m, self._postures, t, self.first)
        self.end_s = float(t[-1])
        keep = np.ones((len(self.knots.t_s), 3), dtype=bool)
        keep[:, 2] = self.knots.sized
        self._keep = keep.reshape(-1)
        self._path = path
        averaged = self.knots.averaged
        self._heading = noise.heading_sigma_rad**2 * averaged(exponential(t, noise.heading_correlation_s))
        self._tilt = noise.tilt_sigma_rad**2 * averaged(exponential(t, noise.tilt_correlation_s))
        self._vertical = _VERTICAL_PSD * averaged(integrated_random_walk(t, t))
        pixel = exponential(t, noise.pixel_correlation_s)
        across = self.geometry.along / seen.scale[:, 0, 0]
        up = self.geometry.along / seen.scale[:, 1, 1]
        size = np.divide(1.0, seen.size_scale, out=np.zeros_like(seen.size_scale), where=seen.size_scale > 0.0)
        self._channels = (
            averaged(across[:, None] * pixel * across),
            averaged(up[:, None] * pixel * up),
            self.knots.size @ (size[:, None] * exponential(t, noise.size_correlation_s) * size) @ self.knots.size.T,
        )
        self._lean = _LEAN_RAD**2 * exponential(self.knots.t_s, _LEAN_S)
        self._modes, self._roots, self.end_modes, self.end_rest = self._mode_basis()

    def linearised(self, ranges_m: Vector) -> Linearised:
        """About the most probable path for each range (R,), for a walker who may well wander."""
        path = ranges_m[:, None, None] * (self._relative_range()[:, None] * self.geometry.rays)[None]
        for _ in range(2):
            path = self._improved(self.geometry.linearised(ranges_m, path))
        return self.geometry.linearised(ranges_m, path)

    def evidence(self, lines: Linearised, factors: Factors, wanted: NDArray[np.intp]) -> Evidence:
        """Of some hypotheses (indices `wanted`) at all ranges."""
        gram, log_det = self._whitened(lines, factors)
        return self._integrated(lines, gram, log_det, factors, wanted)

    def _whitened(self, lines: Linearised, factors: Factors) -> tuple[Matrix, Vector]:
        """Products S^-1 of modes, postures, design and residual with each other, (R, m, m), and log det S (R,)."""
        factor = np.linalg.cholesky(self._errors(lines, factors))
        columns = self._columns(lines)
        half = np.stack([lapack.dtrtrs(one.T, own, trans=1)[0] for one, own in zip(factor, columns, strict=True)])
        gram: Matrix = np.swapaxes(half, 1, 2) @ half
        return gram, 2.0 * np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)

    def _columns(self, lines: Linearised) -> Matrix:
        """(R, kept rows, modes east, modes north, postures, design, residual)."""
        place = lines.by_place[..., :2].reshape(len(lines.ranges_m), -1, 3, 2)
        modes = np.einsum("rkcj,km->rkcjm", place, self._modes)
        rows = 3 * len(self.knots.t_s)
        east, north = modes[..., 0, :], modes[..., 1, :]
        flat = (len(lines.ranges_m), rows, self._modes.shape[1])
        columns = (
            east.reshape(flat),
            north.reshape(flat),
            lines.by_posture,
            lines.design,
            lines.residual[:, :, None],
        )
        return np.concatenate(columns, axis=2)[:, self._keep]

    def _errors(self, lines: Linearised, factors: Factors) -> Matrix:
        """Covariance (R, kept rows, kept rows) of everything but the target's motion."""
        place = lines.by_place
        pose = (place @ np.swapaxes(place, 1, 2)) * _spread(self._path)
        pose += lines.by_heading[:, :, None] * lines.by_heading[:, None, :] * _spread(self._heading)
        pose += lines.by_tilt[:, :, None] * lines.by_tilt[:, None, :] * _spread(self._tilt)
        pose *= factors.pose**2
        pose += place[..., 2:] @ np.swapaxes(place[..., 2:], 1, 2) * _spread(self._vertical)
        across, up, size = self._channels
        pose[:, 0::3, 0::3] += factors.across**2 * across
        pose[:, 1::3, 1::3] += factors.up**2 * up
        lean = lines.steepness[:, :, None] * lines.steepness[:, None, :] * self._lean
        pose[:, 2::3, 2::3] += factors.size**2 * size + lean
        rows = np.arange(pose.shape[1])
        pose[:, rows, rows] += _FLAT
        return pose[:, self._keep][:, :, self._keep]

    def _integrated(
        self, lines: Linearised, gram: Matrix, log_det: Vector, factors: Factors, wanted: NDArray[np.intp]
    ) -> Evidence:
        rest = 2 * self._modes.shape[1] + len(self._postures)  # where the design begins
        roots = self._roots[wanted]
        transposed = np.swapaxes(roots, 1, 2)
        inner = transposed @ gram[:, None, :rest, :rest] @ roots
        loaded = transposed @ gram[:, None, :rest, rest:]
        places = np.arange(rest)
        inner[..., places, places] += 1.0
        solved = np.linalg.solve(inner, loaded)
        reduced = gram[:, None, rest:, rest:] - np.swapaxes(loaded, 2, 3) @ solved
        information, pull, constant = self._prior(lines, factors)
        posterior = reduced[..., :COLUMNS, :COLUMNS] + information[:, None]
        right = reduced[..., :COLUMNS, COLUMNS] + pull[:, None]
        covariance = np.linalg.inv(posterior)
        mean = np.asarray((covariance @ right[..., None])[..., 0], dtype=np.float64)
        log = np.array([self.hypotheses[int(which)].log_prior for which in wanted]) + constant[:, None]
        log = log - 0.5 * (log_det[:, None] + _log_det(inner) + _log_det(posterior))
        log = log - 0.5 * (reduced[..., COLUMNS, COLUMNS] - (right * mean).sum(axis=2))
        # The prior is uniform over directions and the logarithm of the range; across and up are in metres.
        log = log - 2.0 * np.log(lines.ranges_m)[:, None]
        finite = np.asarray(np.where(np.isfinite(log), log, -np.inf), dtype=np.float64)
        return Evidence(
            finite, mean, np.asarray(covariance, dtype=np.float64), np.asarray(solved, dtype=np.float64), inner
        )

    def nodes(self, found: Evidence, factors: Factors, wanted: Sequence[Variant], below: float) -> Nodes:
        """Some variants of the prior at the ranges and hypotheses whose evidence is at most `below` under the best."""
        place = np.argwhere(found.log > found.log.max() - below)
        mean = found.design[place[:, 0], place[:, 1]]
        covariance = found.covariance[place[:, 0], place[:, 1]]
        own = covariance[:, list(_VARIED)][:, :, list(_VARIED)]
        across = covariance[:, :, list(_VARIED)]
        base = self._precision(_WIDEST, factors)
        log, numbers, means, covariances = [], [], [], []
        for number, variant in enumerate(wanted):
            precision = self._precision(variant, factors)
            added = precision - base
            pull = np.zeros(len(_VARIED))
            pull[2] = variant.size.mean * precision[2]
            gradient = pull - added * mean[:, list(_VARIED)]
            mixed = np.eye(len(_VARIED)) + added[:, None] * own
            gain = across @ np.linalg.inv(mixed)
            gained = 0.5 * (gradient * (own @ np.linalg.solve(mixed, gradient[..., None]))[..., 0]).sum(axis=1)
            gained += mean[:, list(_VARIED)] @ pull - 0.5 * np.square(mean[:, list(_VARIED)]) @ added
            gained += 0.5 * np.log(precision / base).sum() - 0.5 * pull[2] * variant.size.mean
            gained -= 0.5 * np.linalg.slogdet(mixed)[1]
            log.append(found.log[place[:, 0], place[:, 1]] + gained + math.log(variant.share))
            numbers.append(np.full(len(place), number))
            means.append(mean + (gain @ gradient[..., None])[..., 0])
            covariances.append(covariance - gain @ (added[:, None] * np.swapaxes(across, 1, 2)))
        return Nodes(
            np.concatenate(log),
            np.tile(place, (len(wanted), 1)),
            np.concatenate(numbers),
            np.concatenate(means),
            np.concatenate(covariances),
        )

    def _precision(self, variant: Variant, factors: Factors) -> Vector:
        """Of speed east and north, log height and heading bias under a variant, (4,)."""
        speed = max(variant.speed_factor * self.prior.speed_sigma_m_s, _LEAST_SPEED_M_S)
        heading = variant.heading_factor * factors.bias * self.noise.heading_bias_sigma_rad
        return np.array((speed, speed, variant.size.sigma, max(heading, _LEAST_BIAS_RAD))) ** -2.0

    def _prior(self, lines: Linearised, factors: Factors) -> tuple[Matrix, Matrix, Vector]:
        """The widest variant's information (R, 8, 8), information times mean (R, 8), and log constant (R,)."""
        prior, ranges = self.prior, len(lines.ranges_m)
        diagonal = np.zeros(COLUMNS)
        diagonal[list(_VARIED)] = self._precision(_WIDEST, factors)
        diagonal[SPEED.stop - 1] = max(prior.vertical_speed_sigma_m_s, _LEAST_SPEED_M_S) ** -2.0
        diagonal[TILT] = max(factors.bias * self.noise.tilt_bias_sigma_rad, _LEAST_BIAS_RAD) ** -2.0
        information = np.tile(np.diag(diagonal), (ranges, 1, 1))
        pull = np.zeros((ranges, COLUMNS))
        constants = np.full(ranges, 0.5 * np.log(diagonal[diagonal > 0.0]).sum())
        if prior.ground_up_m is not None:
            sigma = max(prior.ground_sigma_m or 0.0, LEAST_GROUND_SIGMA_M)
            known = prior.ground_up_m + prior.centre_above_ground_m - float(self.seen.reference_m[2])
            known -= float(self.camera_m[self.first, 2])
            left = known - lines.ranges_m * lines.axes[:, 0, 2]
            rise = lines.axes[:, 2, 2]
            information[:, RISE, RISE] += (rise / sigma) ** 2
            pull[:, RISE] += rise * left / sigma**2
            constants = constants - 0.5 * (left / sigma) ** 2
        return information, pull, constants

    def _mode_basis(self) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """The deviation's modes and what they say of the end.

        Returns:
            Modes at the knots (k, m); each hypothesis' root in them and the posture's waves (H, c, c), c = 2 m + P; by
            these the nine numbers of `TargetMoments` (H, 9, c); and what they leave of their covariance (H, 9, 9).
        """
        places = np.array([h.place for h in self.hypotheses])
        scale = np.array([max(float(np.trace(p)), 1e-12) for p in places])
        shape = (places / scale[:, None, None]).mean(axis=0)
        values, vectors = np.linalg.eigh(shape)
        count = min(len(values), int(np.clip(float(np.ptp(self.t_s)) / _MODE_S, _MODES, _MOST_MODES)))
        basis = vectors[:, ::-1][:, :count]
        inside = np.einsum("im,hij,jn->hmn", basis, places, basis)
        end = basis[-2:]
        rest = _not_negative(places[:, -2:, -2:] - np.einsum("im,hmn,jn->hij", end, inside, end))
        axes, vectors_h = np.linalg.eigh(0.5 * (inside + np.swapaxes(inside, 1, 2)))
        root = vectors_h * np.sqrt(np.maximum(axes, 0.0))[:, None, :]
        size = 2 * count + len(self._postures)
        roots = np.zeros((len(places), size, size))
        roots[:, :count, :count] = root
        roots[:, count : 2 * count, count : 2 * count] = root
        waves = np.arange(2 * count, size)
        roots[:, waves, waves] = np.array([[float(h.posture)] for h in self.hypotheses])
        end_modes = np.zeros((9, size))
        end_rest = np.zeros((len(places), 9, 9))
        for axis in range(2):
            end_modes[[3 + axis, 6 + axis], axis * count : (axis + 1) * count] = end
            rows = np.array((3 + axis, 6 + axis))
            end_rest[:, rows[:, None], rows] = rest
        return basis[:-2], roots, end_modes @ roots, end_rest

    def _improved(self, lines: Linearised) -> Matrix:
        """The most probable path for each range under the hypothesis of a wandering walker, (R, n, 3)."""
        usual = min(3, len(self.hypotheses) - 1)
        gram, _ = self._whitened(lines, Factors())
        modes, postures = self._modes.shape[1], lines.by_posture.shape[2]
        rows = np.array([*range(2 * modes), *range(2 * modes + postures, gram.shape[1])])
        gram = gram[:, rows][:, :, rows]
        root = self._roots[usual][: 2 * modes, : 2 * modes]
        whole = np.zeros((2 * modes + COLUMNS, 2 * modes + COLUMNS))
        whole[: 2 * modes, : 2 * modes] = root
        whole[2 * modes :, 2 * modes :] = np.eye(COLUMNS)
        normal = whole.T @ gram[:, :-1, :-1] @ whole
        places = np.arange(2 * modes)
        normal[:, places, places] += 1.0
        information, _, _ = self._prior(lines, Factors())
        normal[:, 2 * modes :, 2 * modes :] += information
        found = (whole @ np.linalg.solve(normal, whole.T @ gram[:, :-1, -1:]))[..., 0]
        design = found[:, 2 * modes :]
        axes = lines.axes
        start = lines.ranges_m[:, None] * axes[:, 0] + design[:, :1] * axes[:, 1] + design[:, 1:2] * axes[:, 2]
        t = self.t_s
        target = start[:, None] + t[None, :, None] * design[:, None, SPEED]
        wander = np.stack((found[:, :modes] @ self._modes.T, found[:, modes : 2 * modes] @ self._modes.T), axis=2)
        for axis in range(2):
            for r in range(len(target)):
                target[r, :, axis] += np.interp(t, self.knots.t_s, wander[r, :, axis])
        return _held(target - (self.camera_m - self.camera_m[self.first]), lines, self.first)

    def _relative_range(self) -> Vector:
        """Distance over the hypothesised one, by the apparent heights (running median and mean of their logarithms)."""
        t, sized = self.t_s, self.seen.size_scale > 0.0
        if int(sized.sum()) < 5:
            return np.ones(len(t))
        heights = self.seen.measured[sized, 2]
        near = np.arange(len(heights))[:, None] + np.arange(-_SMOOTHED, _SMOOTHED + 1)
        near = near.clip(0, len(heights) - 1)
        smooth = np.median(heights[near], axis=1)[near].mean(axis=1)
        filled = np.interp(t, t[sized], smooth)
        return np.asarray(np.exp(np.clip(filled[self.first] - filled, -3.5, 3.5)))


def _not_negative(matrices: Matrix) -> Matrix:
    """The nearest positive semidefinite matrices: what few modes leave of a kink may come out a little below zero."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2))


def _log_det(matrices: Matrix) -> Matrix:
    """Of positive definite matrices (..., m, m)."""
    factor = np.linalg.cholesky(matrices)
    return np.asarray(2.0 * np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1))


def _held(path: Matrix, lines: Linearised, held: int) -> Matrix:
    """The improved path, the range of the sighting `held` kept, no step larger than a factor of two, never behind."""
    before = np.linalg.norm(lines.path_m, axis=2, keepdims=True)
    far = np.linalg.norm(path, axis=2, keepdims=True)
    ahead = np.einsum("rnj,rnj->rn", path, lines.path_m)[..., None] > 0.3 * before * before
    stepped = path / np.maximum(far, 1e-9) * (before * np.clip(far / before, 0.5, 2.0))
    path = np.where(ahead, stepped, lines.path_m)
    there = np.linalg.norm(path[:, held : held + 1], axis=2, keepdims=True)
    return np.asarray(path * (lines.ranges_m[:, None, None] / there))


def _spread(kernel: Matrix) -> Matrix:
    """A kernel (k, k) of the knots for the rows (3 k, 3 k)."""
    return np.repeat(np.repeat(kernel, 3, axis=0), 3, axis=1)
