"""Where to start the minimisation: the cost of the range, with everything else solved linearly, on a grid of ranges.

For a hypothesised depth at the first sighting the bearings are linear in position and velocity (the pseudo-linear
equations: (row_x - x row_z) d = 0, Nardone & Aidala), and so is the log size around that depth. All ranges are
solved at once. The grid's local minima are the starts: the true one, and the mirrored or too-near ones that a single
start can end in. Wrong sightings are found here first, while nothing depends on them yet, by iteratively reweighted
least squares.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.errors import EstimateRefused
from mission.estimate.observations import Observations
from mission.records import Matrix, NoiseModel, TargetPrior, Vector

_RANGES = np.geomspace(0.12, 250.0, 14)
"""Depths tried, as multiples of the camera's travel."""
_GROSS = 4.5
"""A sighting that is off by this many sigmas of everything together is wrong."""
_ROBUST = 3.0
"""Sigmas at which the reweighting begins to doubt."""
_REWEIGHTINGS = 12
_LARGEST_RATIO = 1.5
"""Natural logarithm of how far a height may be from the middle one in a start."""
_MOST = 3
"""Local minima that are looked at."""
_NEIGHBOURS = 4
"""On either side, of the running median: wrong sightings in a row are told from right ones up to this many."""


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A place to start from, and its (approximate) cost."""

    position_m: Vector
    velocity_m_s: Vector
    log_size: float
    cost: float
    misfit: Vector
    """(n,), squared, of each sighting's place in the picture, in units of everything that may turn or shift it."""
    miss: Matrix
    """(2, n), of each sighting's place in the picture, tangents."""


@dataclass(frozen=True, slots=True, eq=False)
class Starts:
    """Starts, best first, and which sightings are grossly wrong."""

    starts: tuple[Start, ...]
    right: NDArray[np.bool_]
    """(n,)."""
    sized: NDArray[np.bool_]
    """(n,), which sightings' heights are not glitches."""


def find_starts(seen: Observations, noise: NoiseModel, prior: TargetPrior) -> Starts:
    """Starts for the minimisation, best first.

    Args:
        seen: the observations.
        noise: the noise model, used for rough weights only.
        prior: the target's prior.

    Raises:
        EstimateRefused: the camera did not move, or no range puts the target in front of it.
    """
    travel = float(np.linalg.norm(np.ptp(seen.camera_m, axis=0)))
    if not travel > 1e-6:
        raise EstimateRefused("The camera did not move, so there is no parallax", "Fly a lateral pattern.")
    grid = _RangeProfile(seen, noise, prior, _RANGES * travel)
    steady = np.ones(len(seen.t_s), dtype=bool)
    starts = grid.fitted(steady)
    jumps = grid.jumps(starts[0])
    if jumps.any() and int((~jumps).sum()) >= 3:
        steady = ~jumps
        starts = grid.fitted(steady)
    right = steady & (starts[0].misfit < _GROSS**2)
    if (right == steady).all():
        return Starts(starts, right, grid.usual_size)
    for _ in range(_REWEIGHTINGS):
        # Geman & McClure's weights: far sightings lose their say.
        grid.solve(steady / np.square(1.0 + grid.misfit / _ROBUST**2))
    grid.cost = np.minimum(grid.misfit, _GROSS**2)[:, steady].sum(axis=1) + grid.others
    near = steady & (grid.misfit[int(np.argmin(grid.cost))] < _GROSS**2)
    right = steady & (grid.minima(near.astype(float))[0].misfit < _GROSS**2)
    if int(right.sum()) < 3:
        return Starts(starts, steady, grid.usual_size)
    return Starts(grid.fitted(right), right, grid.usual_size)


def meets_behind(seen: Observations, noise: NoiseModel, prior: TargetPrior) -> bool:
    """Whether the lines of sight, taken as whole lines, meet behind the camera."""
    travel = float(np.linalg.norm(np.ptp(seen.camera_m, axis=0)))
    lines = _RangeProfile(seen, noise, prior, np.array([10.0 * travel]))
    lines.firmness = 0.0
    lines.sized = False
    lines.solve(np.ones((1, len(seen.t_s))))
    depths = lines.unknowns[0, :6] @ lines.along.T - lines.depth_offset
    return bool(np.sort(depths)[len(depths) // 2] < 0.0)


class _RangeProfile:
    """Least squares for each hypothesised depth of the first sighting."""

    def __init__(self, seen: Observations, noise: NoiseModel, prior: TargetPrior, ranges: Vector) -> None:
        self.seen, self.ranges, t = seen, ranges, seen.t_s
        self.firmness = 1e3
        count = len(t)
        rows = seen.camera_from_world
        # Camera coordinates of the target are linear in its position and velocity.
        linear = np.concatenate((rows, rows * t[:, None, None]), axis=2)
        own = np.matmul(rows, seen.camera_m[:, :, None])[:, :, 0]
        self.linear, self.own = np.swapaxes(linear, 0, 1).reshape(3 * count, 6).T, own.T.reshape(-1)
        # Two rows per sighting that vanish on its line of sight, and one along the camera's axis.
        across = linear[:, :2] - seen.measured[:, :2, None] * linear[:, 2:]
        offset = own[:, :2] - seen.measured[:, :2] * own[:, 2:]
        self.across_gram = np.matmul(np.swapaxes(across, 1, 2), across).reshape(count, 36)
        self.across_right = np.matmul(np.swapaxes(across, 1, 2), offset[:, :, None])[:, :, 0]
        self.along, self.depth_offset = linear[:, 2], own[:, 2]
        self.along_gram = (self.along[:, :, None] * self.along[:, None, :]).reshape(count, 36)
        scale = seen.scale
        # Square of pixels per tangent over the pixel sigma.
        focal2 = np.abs(scale[:, 0, 0] * scale[:, 1, 1] - scale[:, 0, 1] * scale[:, 1, 0])
        span = max(float(t[-1]), 1e-3)
        step = span / max(count - 1, 1)
        self.noise, self.pixel2 = noise, 1.0 / focal2
        self.heading2, self.tilt2 = noise.heading_sigma_rad**2, noise.tilt_sigma_rad**2
        turn2 = self.heading2 * _shared(step, noise.heading_correlation_s, count)
        turn2 += self.tilt2 * _shared(step, noise.tilt_correlation_s, count)
        self.place2 = noise.position_sigma_m**2 + noise.position_walk_m_per_sqrt_s**2 * span / 4.0
        self.angle2 = _shared(step, noise.pixel_correlation_s, count) / focal2 + turn2
        self.size_target = 1.0 - seen.measured[:, 2]
        self.size_weight = seen.size_scale**2 / _shared(step, noise.size_correlation_s, count)
        # A height that is far from all others is a glitch.
        sized = seen.size_scale > 0.0
        middle = float(np.sort(seen.measured[sized, 2])[int(sized.sum()) // 2]) if sized.any() else 0.0
        self.usual_size: NDArray[np.bool_] = np.abs(seen.measured[:, 2] - middle) < _LARGEST_RATIO
        self.size_weight = np.where(self.usual_size, self.size_weight, 0.0)
        self.sized = bool(self.size_weight.any())
        speed = np.array((prior.speed_sigma_m_s, prior.speed_sigma_m_s, prior.vertical_speed_sigma_m_s))
        wander2 = prior.acceleration_psd_m2_s3 * span * np.array((1.0, 1.0, 0.0))
        self.speed_precision = 1.0 / np.maximum(speed**2 + wander2, 1e-12)
        self.depths: Matrix = np.maximum(ranges[:, None] + (own[0, 2] - own[:, 2]), 0.2 * ranges[:, None])
        self.unknowns: Matrix = np.zeros((len(ranges), 7))
        self.misfit: Matrix = np.zeros((len(ranges), count))
        self.miss: tuple[Matrix, Matrix] = (self.misfit, self.misfit)
        self.others: Vector = np.zeros(len(ranges))
        self.cost: Vector = np.zeros(len(ranges))

    def solve(self, weights: Matrix, rounds: int = 1) -> Vector:
        """Solve all ranges with weights (k, n) of the sightings; returns their cost, and leaves each one's misfit."""
        for _ in range(rounds):
            self._least_squares(weights)
        seen, unknowns = self.seen, self.unknowns
        q = (unknowns[:, :6] @ self.linear - self.own).reshape(len(self.ranges), 3, -1)
        z = q[:, 2]
        behind = z <= 0.02 * self.ranges[:, None]
        z = np.where(behind, 1.0, z)
        near = 1.0 / z
        miss_x, miss_y = seen.measured[:, 0] - q[:, 0] * near, seen.measured[:, 1] - q[:, 1] * near
        self.miss = miss_x, miss_y
        angle2 = (miss_x * miss_x + miss_y * miss_y) / (self.angle2 + self.place2 * near * near)
        self.misfit = np.where(behind, 1e6, angle2)
        self.others = np.square(unknowns[:, 3:6]) @ self.speed_precision
        if self.sized:
            size = seen.measured[:, 2] - unknowns[:, 6:7] + np.log(z)
            self.others = self.others + (weights * self.size_weight * np.where(behind, 10.0, size * size)).sum(axis=1)
        self.cost = (weights * self.misfit).sum(axis=1) + self.others
        return self.cost

    def fitted(self, right: NDArray[np.bool_]) -> tuple[Start, ...]:
        """The local minima, best first, of the sightings (n,) that are right."""
        weights = right.astype(float)
        self.solve(np.broadcast_to(weights, self.misfit.shape))
        return self.minima(weights)

    def jumps(self, start: Start) -> NDArray[np.bool_]:
        """Which sightings are far from what their neighbours say, (n,): somebody else for a moment.

        Where the attitude is restless a wrong sighting is within what it may wander over a flight, but it does not
        wander that far and back from one frame to the next (the running median; Hampel's identifier).
        """
        count = start.miss.shape[1]
        bend = start.miss[:, 1:-1] - 0.5 * (start.miss[:, :-2] + start.miss[:, 2:])
        # Before and after a jump the line bends by half of it at least; where it nowhere does there is none.
        if count <= 2 * _NEIGHBOURS or (bend * bend).sum(axis=0).max() < 0.5 * _GROSS**2 * self.pixel2.min():
            return np.zeros(count, dtype=bool)
        ends = np.arange(count).clip(_NEIGHBOURS, count - 1 - _NEIGHBOURS)
        around = ends[:, None] + np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1)
        off = start.miss - np.median(start.miss[:, around], axis=2)
        t = self.seen.t_s
        span = t[around[:, -1]] - t[around[:, 0]]
        turn2 = self.heading2 * _drift(span, self.noise.heading_correlation_s)
        turn2 += self.tilt2 * _drift(span, self.noise.tilt_correlation_s)
        near = self.along @ np.concatenate((start.position_m, start.velocity_m_s)) - self.depth_offset
        place2 = 2.0 * self.place2 / np.square(np.maximum(near, 1e-3))
        jumped: NDArray[np.bool_] = np.square(off).sum(axis=0) > _GROSS**2 * (2.0 * self.pixel2 + turn2 + place2)
        return jumped

    def minima(self, weights: Vector) -> tuple[Start, ...]:
        """The grid's local minima, best first.

        Each is solved again without its hypothesis, with weights (n,), and keeps the better of the two solutions.
        """
        padded = np.concatenate(([np.inf], self.cost, [np.inf]))
        places = np.flatnonzero((self.cost <= padded[:-2]) & (self.cost < padded[2:]))
        places = places[np.argsort(self.cost[places], kind="stable")][:_MOST]
        free = copy(self)
        free.ranges, free.depths, free.unknowns = self.ranges[places], self.depths[places], self.unknowns[places]
        free.firmness = 0.0
        free.solve(np.broadcast_to(weights, free.depths.shape), rounds=1)
        starts = []
        for i, k in enumerate(places):
            source, row = (free, i) if free.cost[i] < self.cost[k] else (self, int(k))
            found = source.unknowns[row]
            cost, misfit, miss = (
                float(source.cost[row]),
                source.misfit[row],
                np.stack([miss[row] for miss in source.miss]),
            )
            starts.append(Start(found[:3], found[3:6], float(found[6]), cost, misfit, miss))
        starts.sort(key=lambda start: start.cost)
        return tuple(starts)

    def _least_squares(self, weights: Matrix) -> None:
        angle = weights / (self.angle2 * self.depths * self.depths + self.place2)
        normal = np.zeros((len(self.ranges), 7, 7))
        right = np.zeros((len(self.ranges), 7))
        gram = angle @ self.across_gram
        right[:, :6] = angle @ self.across_right
        if self.sized:
            # along / depth - s = 1 + (camera's part) / depth - log depth - log height
            near = 1.0 / self.depths
            size = weights * self.size_weight
            relative = size * near
            gram += (relative * near) @ self.along_gram
            wanted = self.size_target + self.depth_offset * near - np.log(self.depths)
            right[:, :6] += (relative * wanted) @ self.along
            right[:, 6] = -(size * wanted).sum(axis=1)
            normal[:, 6, :6] = normal[:, :6, 6] = -(relative @ self.along)
            normal[:, 6, 6] = size.sum(axis=1)
        else:
            normal[:, 6, 6] = 1.0
        normal[:, :6, :6] = gram.reshape(-1, 6, 6)
        # The hypothesis: the depth at the first sighting, held a thousand times as firmly as anything else.
        firm = self.firmness * (normal[:, 0, 0] + normal[:, 1, 1] + normal[:, 2, 2] + 1e-12)
        axis = self.along[0, :3]
        normal[:, :3, :3] += firm[:, None, None] * (axis[:, None] * axis)
        right[:, :3] += (firm * (self.ranges + self.depth_offset[0]))[:, None] * axis
        normal.reshape(-1, 49)[:, _SPEEDS] += self.speed_precision
        self.unknowns = np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0], dtype=np.float64)
        depths: Matrix = self.unknowns[:, :6] @ self.along.T - self.depth_offset
        self.depths = np.maximum(depths, 0.2 * self.ranges[:, None])


_SPEEDS = slice(3 * 8, 6 * 8, 8)
"""The velocity's diagonal in a flattened (7, 7)."""


def _drift(span_s: Vector, correlation_s: float) -> Vector:
    """Variance of what a Gauss-Markov process of unit variance changes by over a span, both ways."""
    if correlation_s <= 0.0:
        return np.full(len(span_s), 2.0)
    drift: Vector = 2.0 * (1.0 - np.exp(-span_s / correlation_s))
    return drift


def _shared(step_s: float, correlation_s: float, count: int) -> float:
    """By how much correlated errors weigh more than white ones of the same sigma, over a whole flight."""
    if correlation_s <= 0.0:
        return 1.0
    rho = float(np.exp(-step_s / correlation_s))
    return min((1.0 + rho) / max(1.0 - rho, 1e-9), float(count))
