"""The evidence of a flight averaged: range, motion, pose and noise, to one mean and covariance of the target.

Stages: where the evidence is at all, by a few hypotheses on grids of ranges that become finer; how far the sightings'
own noise is from what is stated (bearing across, up, and size: each the maximum of the evidence times a log-normal
prior); then all hypotheses on a fine grid, over three levels of the pose's errors. The mean and covariance are those
of the whole mixture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mission.estimate.marginal import Evidence, Factors, MarginalModel, Nodes, Variant, variants
from mission.estimate.motion_hypotheses import MotionKind
from mission.estimate.range_model import COLUMNS, RISE, SIDE, SIZE, SPEED, Linearised
from mission.estimate.size_prior import SizePrior
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
_INTENSITIES_TRIED = 7
"""The first hypotheses, of which every other one, with a change of posture, finds where the evidence is at all."""
_REFINEMENTS = 7
_NEGLIGIBLE = 1e-5
_TRIED, _TRIED_AGAIN = np.log([0.45, 0.67, 1.0, 1.5, 2.25, 3.4]), np.log([0.8, 1.0, 1.25])
"""Logarithms of factors of the stated noise, first and about what was found then."""
_DISMISSED = 14.0
"""How far below the best a node's log evidence may be."""
_NOISE_SPREAD = 0.5
"""Prior sigma of such a logarithm."""
_HONESTY_SPREAD, _OWN_SPREAD, _FITTED_SPREAD = 0.4, 0.3, 0.16
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


def averaged(model: MarginalModel, priors: Sequence[Sequence[SizePrior]]) -> tuple[Averaged, ...]:
    """Average over everything, once for each set of alternatives of the target's height.

    Args:
        model: of the flight.
        priors: the sets; the first, which must not be narrower than the others, decides where is looked.

    Raises:
        numpy.linalg.LinAlgError: the sightings determine nothing.
    """
    travel = 2.0 * float(np.linalg.norm(model.camera_m - model.camera_m.mean(axis=0), axis=1).max())
    ranges = np.geomspace(max(_NEAREST * travel, _NEAREST_M), max(_FARTHEST * travel, 10.0 * _NEAREST_M), _COARSE)
    whole = ranges
    bias_rad = model.noise.heading_bias_sigma_rad
    wide = variants(priors[0], bias_rad)
    everything = np.arange(len(model.hypotheses))
    changing = [place for place, hypothesis in enumerate(model.hypotheses) if hypothesis.posture]
    first = np.array([*everything[:_INTENSITIES_TRIED:2], *changing])
    found = _resolved(model, whole, Factors(), first, wide)
    factors, poses = _noise(model, found.lines, found.evidence, first)
    # Other noise makes another width, so the search begins again, somewhat around what was found.
    usual = replace(factors, pose=poses[1][0])
    low, high = found.limits
    margin = math.sqrt(high / low)
    found = _resolved(model, np.geomspace(low / margin, high * margin, _FINE), usual, everything, wide)
    if found.at_edge:
        found = _resolved(model, whole, usual, everything, wide)
    bounded = not found.at_edge
    lines = found.lines
    by_motion = _summed(found.evidence.log, (0,))
    likely = np.flatnonzero(by_motion > by_motion.max() - _UNLIKELY)
    found_by_pose = [(model.evidence(lines, replace(factors, pose=pose), likely), share) for pose, share in poses]
    return tuple(
        _mixture(model, lines, found_by_pose, factors, variants(sizes, bias_rad), likely, bounded=bounded)
        for sizes in priors
    )


def _mixture(
    model: MarginalModel,
    lines: Linearised,
    found: Sequence[tuple[Evidence, float]],
    factors: Factors,
    wanted: Sequence[Variant],
    likely: NDArray[np.intp],
    *,
    bounded: bool,
) -> Averaged:
    """Mean and covariance over poses, ranges, hypotheses and variants."""
    ranges = lines.ranges_m
    parts = []
    for at, share in found:
        nodes = model.nodes(at, factors, wanted, _DISMISSED)
        parts.append((at, nodes, nodes.log + math.log(share)))
    top = max(float(log.max()) for _, _, log in parts)
    means, covariances, kept, sizes, motion, variant, places = [], [], [], [], [], [], []
    for at, nodes, log in parts:
        weight = np.exp(log - top)
        rows = np.flatnonzero(weight > _NEGLIGIBLE)
        mean, covariance = _targets(model, lines, at, nodes, rows, likely)
        means.append(mean)
        covariances.append(covariance)
        kept.append(weight[rows])
        sizes.append(np.column_stack((nodes.design[rows, SIZE], nodes.covariance[rows, SIZE, SIZE])))
        motion.append(likely[nodes.place[rows, 1]])
        variant.append(nodes.variant[rows])
        places.append(nodes.place[rows, 0])
    shares = np.concatenate(kept)
    shares /= shares.sum()
    target = np.concatenate(means)
    mean = shares @ target
    spread = target - mean
    covariance = np.einsum("k,kij->ij", shares, np.concatenate(covariances)) + (spread * shares[:, None]).T @ spread
    size, variance = np.concatenate(sizes).T
    log_height = float(shares @ size)
    log_height_sigma = math.sqrt(float(shares @ (variance + np.square(size - log_height))))
    by_range = np.bincount(np.concatenate(places), shares, len(ranges))
    near = ranges[by_range > 0.13 * by_range.max()]
    motions: dict[MotionKind, float] = {}
    for place, chance in enumerate(np.bincount(np.concatenate(motion), shares)):
        if chance > 0.0:
            kind = model.hypotheses[place].kind
            motions[kind] = motions.get(kind, 0.0) + float(chance)
    heights: dict[str, float] = {}
    for number, chance in enumerate(np.bincount(np.concatenate(variant), shares)):
        kind_of_height = wanted[number].size.kind
        heights[kind_of_height] = heights.get(kind_of_height, 0.0) + float(chance)
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


@dataclass(frozen=True, slots=True, eq=False)
class _Resolved:
    """A grid of ranges that is fine enough where the evidence is."""

    lines: Linearised
    evidence: Evidence
    """Of the hypotheses that were asked for."""
    limits: tuple[float, float]
    """Ranges (m) between which the evidence is."""
    at_edge: bool
    """Whether the evidence reaches an end of the first grid."""


def _resolved(
    model: MarginalModel, ranges: Vector, factors: Factors, wanted: NDArray[np.intp], priors: Sequence[Variant]
) -> _Resolved:
    """Refine a grid of ranges until the evidence of some hypotheses covers half of it."""
    at_edge = False
    for refinement in range(_REFINEMENTS):
        lines = model.linearised(ranges)
        found = model.evidence(lines, factors, wanted)
        inside = _inside(_by_range(model, found, factors, priors))
        low, high = max(int(inside[0]) - 1, 0), min(int(inside[-1]) + 1, len(ranges) - 1)
        at_edge = at_edge or (refinement == 0 and (inside[0] == 0 or inside[-1] == len(ranges) - 1))
        if len(inside) >= _FINE // 2 - 1 and (refinement > 0 or len(ranges) == _FINE):
            break
        if refinement < _REFINEMENTS - 1:
            ranges = np.geomspace(ranges[low], ranges[high], _FINE)
    return _Resolved(lines, found, (float(ranges[low]), float(ranges[high])), bool(at_edge))


def _by_range(model: MarginalModel, found: Evidence, factors: Factors, priors: Sequence[Variant]) -> Vector:
    """Log evidence of each range, all variants of the prior taken together."""
    nodes = model.nodes(found, factors, priors, _DISMISSED)
    weight = np.exp(nodes.log - nodes.log.max())
    return np.asarray(np.log(np.bincount(nodes.place[:, 0], weight, len(found.log)) + 1e-300))


def _inside(by_range: Vector) -> NDArray[np.intp]:
    """The ranges that matter."""
    return np.flatnonzero(by_range > by_range.max() - _WIDE)


def _noise(
    model: MarginalModel, lines: Linearised, rough: Evidence, tried: NDArray[np.intp]
) -> tuple[Factors, list[tuple[float, float]]]:
    """The factors of the stated noise, and the pose's factors with their probabilities."""
    best_range, best_motion = np.unravel_index(int(np.argmax(rough.log)), rough.log.shape)
    line = _only(lines, int(best_range))
    motion = tried[best_motion : best_motion + 1]
    factors = Factors()
    sized = bool(model.knots.sized.any())
    for steps in (_TRIED, _TRIED_AGAIN):
        for channel in ("across", "up", "size") if sized else ("across", "up"):
            logs = np.asarray(math.log(getattr(factors, channel)) + steps, dtype=np.float64)
            values = [
                float(model.evidence(line, replace(factors, **{channel: math.exp(log)}), motion).log[0, 0])
                - 0.5 * (log / _NOISE_SPREAD) ** 2
                for log in logs
            ]
            factors = replace(factors, **{channel: math.exp(_vertex(logs, np.array(values, dtype=np.float64)))})
    # The common factor of a header's honesty, from the two channels that only the tracker disturbs.
    told = [math.log(factors.up)] + ([math.log(factors.size)] if sized else [])
    channel_variance = _OWN_SPREAD**2 + _FITTED_SPREAD**2
    precision = _HONESTY_SPREAD**-2 + len(told) / channel_variance
    middle = sum(told) / channel_variance / precision
    sigma = math.sqrt(1.0 / precision + _OWN_SPREAD**2)
    factors = replace(factors, bias=math.exp(middle))
    return factors, [(math.exp(middle + sigma * node), share) for node, share in _POSES]


def _targets(
    model: MarginalModel,
    lines: Linearised,
    found: Evidence,
    nodes: Nodes,
    rows: NDArray[np.intp],
    likely: NDArray[np.intp],
) -> tuple[Matrix, Matrix]:
    """Means (m, 9) and covariances (m, 9, 9) of the target at some nodes, as in `TargetMoments`."""
    r, h = nodes.place[rows].T
    end, count = model.end_s, len(rows)
    axes, which = lines.axes[r], likely[h]
    spread = np.zeros((count, 9, COLUMNS))
    spread[:, 0:3, SIDE] = spread[:, 3:6, SIDE] = axes[:, 1]
    spread[:, 0:3, RISE] = spread[:, 3:6, RISE] = axes[:, 2]
    spread[:, 3:6, SPEED], spread[:, 6:9, SPEED] = end * np.eye(3), np.eye(3)
    wander = model.end_modes[which]
    loads = wander @ found.modes[r, h]
    both = spread - loads[..., :COLUMNS]
    mean = (both @ nodes.design[rows][..., None])[..., 0] + loads[..., COLUMNS]
    start = model.camera_m[model.first] + lines.ranges_m[r][:, None] * axes[:, 0]
    mean[:, :3] += start
    mean[:, 3:6] += start
    covariance = both @ nodes.covariance[rows] @ np.swapaxes(both, 1, 2) + model.end_rest[which]
    covariance += wander @ np.linalg.solve(found.inner[r, h], np.swapaxes(wander, 1, 2))
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
