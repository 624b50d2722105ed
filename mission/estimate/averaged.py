"""The evidence of a flight averaged: range, motion, pose and noise, to one mean and covariance of the target.

Stages: a coarse grid of ranges over all hypotheses; how far the sightings' own noise is from what is stated (bearing
across, up, and size: each the maximum of the evidence times a log-normal prior); then a fine grid where the evidence is,
over three levels of the pose's errors. The mean and covariance are those of the whole mixture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mission.estimate.marginal import Evidence, Factors, MarginalModel
from mission.estimate.motion_hypotheses import MotionKind
from mission.estimate.range_model import COLUMNS, RISE, SIDE, SIZE, SPEED, Linearised
from mission.estimate.target_covariance import TargetMoments
from mission.records import Matrix, Vector

_NEAREST, _FARTHEST = 0.2, 80.0
"""Ranges looked at, as multiples of the camera's travel."""
_NEAREST_M = 0.3
_COARSE, _FINE = 18, 20
_WIDE = 9.0
"""How far below the best the log evidence of a range may be to be looked at."""
_UNLIKELY = 7.0
"""The same of a hypothesis."""
_REFINEMENTS = 4
_NEGLIGIBLE = 1e-5
_TRIED = np.log([0.4, 0.55, 0.75, 1.0, 1.35, 1.8, 2.5, 3.5])
"""Logarithms of factors of the stated noise."""
_NOISE_SPREAD = 0.5
"""Prior sigma of such a logarithm."""
_HONESTY_SPREAD, _OWN_SPREAD, _FITTED_SPREAD = 0.4, 0.35, 0.16
"""A header that understates one noise understates others: sigma of the logarithm that all its noises share, of each
one's own, and of what the sightings tell of the bearing's and the size's."""
_POSES = ((-1.2, 0.23), (0.0, 0.54), (1.2, 0.23))
"""Nodes and weights that keep mean and variance of a normal distribution (in sigmas)."""


@dataclass(frozen=True, slots=True, eq=False)
class Averaged:
    """What the sightings say of the target, everything else averaged out."""

    moments: TargetMoments
    bounded: bool
    """Whether the evidence falls off at both ends of the ranges looked at."""
    nearest_m: float
    farthest_m: float
    """About the 2-sigma limits of the range."""
    motions: dict[MotionKind, float]
    """Posterior probabilities of the kinds of motion."""
    factors: Factors
    """Of the stated noise."""
    log_height: tuple[float, float]
    """Mean and sigma of the logarithm of the target's height."""
    heights: dict[str, float]
    """Posterior probabilities of the kinds of height prior."""


def averaged(model: MarginalModel) -> Averaged:
    """Average over everything.

    Raises:
        numpy.linalg.LinAlgError: the sightings determine nothing.
    """
    travel = float(np.linalg.norm(np.ptp(model.camera_m, axis=0)))
    ranges = np.geomspace(max(_NEAREST * travel, _NEAREST_M), max(_FARTHEST * travel, 10.0 * _NEAREST_M), _COARSE)
    everything = np.arange(len(model.hypotheses))
    lines = model.linearised(ranges)
    rough = model.evidence(lines, Factors(), everything)
    factors, poses = _noise(model, lines, rough)
    coarse = _over_poses(model, lines, factors, poses, everything)
    by_range = _summed(coarse, (0, 2, 3))
    inside = np.flatnonzero(by_range > by_range.max() - _WIDE)
    bounded = bool(inside[0] > 0 and inside[-1] < len(ranges) - 1)
    by_motion = _summed(coarse, (0, 1, 3))
    likely = np.flatnonzero(by_motion > by_motion.max() - _UNLIKELY)
    for _ in range(_REFINEMENTS):
        low, high = ranges[max(inside[0] - 1, 0)], ranges[min(inside[-1] + 1, len(ranges) - 1)]
        ranges = np.geomspace(low, high, _FINE)
        lines = model.linearised(ranges)
        fine = _over_poses(model, lines, factors, poses, likely)
        by_range = _summed(fine, (0, 2, 3))
        inside = np.flatnonzero(by_range > by_range.max() - _WIDE)
        if len(inside) >= _FINE // 2 - 1:
            break
    weights = np.exp(fine - fine.max())
    weights /= weights.sum()
    means, covariances, kept, sizes = [], [], [], []
    for node, (factor, _) in enumerate(poses):
        found = model.evidence(lines, replace(factors, pose=factor), likely)
        for r, h, v in np.argwhere(weights[node] > _NEGLIGIBLE):
            mean, covariance = _target(model, lines, found, int(r), int(h), int(v), int(likely[h]))
            means.append(mean)
            covariances.append(covariance)
            kept.append(weights[node, r, h, v])
            sizes.append((found.design[r, h, v, SIZE], found.covariance[r, h, v, SIZE, SIZE]))
    share = np.array(kept) / np.sum(kept)
    mean = share @ np.array(means)
    spread = np.array(means) - mean
    covariance = np.einsum("k,kij->ij", share, np.array(covariances)) + (spread * share[:, None]).T @ spread
    size, variance = np.array(sizes).T
    log_height = float(share @ size)
    log_height_sigma = math.sqrt(float(share @ (variance + np.square(size - log_height))))
    near = ranges[by_range > by_range.max() - 2.0]
    motions: dict[MotionKind, float] = {}
    for place, chance in zip(likely, weights.sum(axis=(0, 1, 3)), strict=True):
        kind = model.hypotheses[int(place)].kind
        motions[kind] = motions.get(kind, 0.0) + float(chance)
    heights: dict[str, float] = {}
    for (_, _, size_prior), chance in zip(model.variants, weights.sum(axis=(0, 1, 2)), strict=True):
        heights[size_prior.kind] = heights.get(size_prior.kind, 0.0) + float(chance)
    return Averaged(
        TargetMoments(mean, covariance),
        bounded,
        float(near[0]),
        float(near[-1]),
        motions,
        factors,
        (log_height, log_height_sigma),
        heights,
    )


def _noise(model: MarginalModel, lines: Linearised, rough: Evidence) -> tuple[Factors, list[tuple[float, float]]]:
    """The factors of the stated noise, and the pose's factors with their probabilities."""
    best_range, best_motion, _ = np.unravel_index(int(np.argmax(rough.log)), rough.log.shape)
    line = _only(lines, int(best_range))
    motion = np.array([best_motion])
    factors = Factors()
    for _ in range(2):
        for channel in ("across", "up", "size"):
            values = [
                float(_summed(model.evidence(line, replace(factors, **{channel: math.exp(tried)}), motion).log, None))
                - 0.5 * (tried / _NOISE_SPREAD) ** 2
                for tried in _TRIED
            ]
            factors = replace(factors, **{channel: math.exp(_vertex(_TRIED, np.array(values)))})
    # The common factor of a header's honesty, from the two channels that only the tracker disturbs.
    told = [math.log(factors.up)] + ([math.log(factors.size)] if model.knots.sized.any() else [])
    channel_variance = _OWN_SPREAD**2 + _FITTED_SPREAD**2
    precision = _HONESTY_SPREAD**-2 + len(told) / channel_variance
    middle = sum(told) / channel_variance / precision
    sigma = math.sqrt(1.0 / precision + _OWN_SPREAD**2)
    return factors, [(math.exp(middle + sigma * node), share) for node, share in _POSES]


def _over_poses(
    model: MarginalModel, lines: Linearised, factors: Factors, poses: list[tuple[float, float]], wanted: Vector
) -> Matrix:
    """Log evidence (pose, range, hypothesis, variant)."""
    return np.stack(
        [
            model.evidence(lines, replace(factors, pose=factor), wanted).log + math.log(share)
            for factor, share in poses
        ]
    )


def _target(
    model: MarginalModel, lines: Linearised, found: Evidence, r: int, h: int, v: int, which: int
) -> tuple[Vector, Matrix]:
    """Mean (9,) and covariance (9, 9) of the target given one node, as in `TargetMoments`."""
    axes, span = lines.axes[r], model.span_s
    spread = np.zeros((9, COLUMNS))
    spread[0:3, SIDE] = spread[3:6, SIDE] = axes[1]
    spread[0:3, RISE] = spread[3:6, RISE] = axes[2]
    spread[3:6, SPEED], spread[6:9, SPEED] = span * np.eye(3), np.eye(3)
    modes = model.end.shape[1]
    wander = np.zeros((9, 2 * modes + 1))
    wander[[3, 6], :modes] = model.end
    wander[[4, 7], modes : 2 * modes] = model.end
    design, loads = found.design[r, h, v], found.modes[r, h]
    mean = spread @ design + wander @ (loads[:, COLUMNS] - loads[:, :COLUMNS] @ design)
    mean[:3] += lines.ranges_m[r] * axes[0]
    mean[3:6] += lines.ranges_m[r] * axes[0]
    both = spread - wander @ loads[:, :COLUMNS]
    covariance = both @ found.covariance[r, h, v] @ both.T + wander @ found.modes_covariance[r, h] @ wander.T
    rest = model.end_rest[which]
    for axis in (0, 1):
        rows = np.ix_((3 + axis, 6 + axis), (3 + axis, 6 + axis))
        covariance[rows] += rest
    return mean, covariance


def _only(lines: Linearised, r: int) -> Linearised:
    """One range of several."""
    one = slice(r, r + 1)
    return Linearised(*(getattr(lines, name)[one] for name in Linearised.__slots__))


def _summed(log: Matrix, axes: tuple[int, ...] | None) -> Vector:
    """Logarithm of the sum over some axes."""
    top = log.max()
    return np.asarray(top + np.log(np.exp(log - top).sum(axis=axes) + 1e-300))


def _vertex(x: Vector, values: Vector) -> float:
    """Where a parabola through the best value and its neighbours is highest."""
    best = int(np.argmax(values))
    if best in (0, len(x) - 1):
        return float(x[best])
    fit = np.polyfit(x[best - 1 : best + 2], values[best - 1 : best + 2], 2)
    return float(np.clip(-0.5 * fit[1] / fit[0], x[best - 1], x[best + 1]))
