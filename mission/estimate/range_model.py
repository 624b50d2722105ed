"""The sightings as linear functions of everything unknown, for given ranges of the target at one of them.

For a given range the bearings place the target across the line of sight, and the apparent heights along it, so that
all that is left is close to linear (the pseudo-linear equations; Nardone & Aidala 1981). Around a nominal path d(t) of
the target relative to the camera,

    bearing across, up:  e1 u / e0 u,  e2 u / e0 u      (u the measured ray in the world; e0 = d / |d|, e1 horizontal)
    log apparent height: log |projection of an upright unit length at d|

are linearised in the target's place, in heading and tilt errors and in the size. The projection of an upright length
is what a person's height is in a picture, from whatever elevation they are seen (it falls with its cosine).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.estimate.knots import Knots
from mission.estimate.observations import Observations
from mission.records import Matrix, Vector

SIDE, RISE, SPEED, SIZE, HEADING, TILT = 0, 1, slice(2, 5), 5, 6, 7
"""Columns of the design: place across that line of sight (right, up; m), velocity (m/s), log height, biases."""
COLUMNS = 8
_SINKING_M = 0.6
"""By how much the centre sinks for each unit of the log height: half of what a body of 1.7 m loses when it crouches."""
_NUDGE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """At R ranges; rows are (knot, channel) in the order across, up, log height."""

    ranges_m: Vector
    """(R,)."""
    path_m: Matrix
    """(R, n, 3), the target relative to the camera, about which it is linear."""
    axes: Matrix
    """(R, 3, 3), rows e0, e1, e2 at the sighting whose range is given."""
    residual: Matrix
    """(R, 3 k), of the measurements as a linear function of the design's unknowns."""
    design: Matrix
    """(R, 3 k, 8)."""
    by_place: Matrix
    """(R, 3 k, 3), derivative by the target's place (ENU)."""
    by_heading: Matrix
    """(R, 3 k)."""
    by_tilt: Matrix
    """(R, 3 k)."""
    steepness: Matrix
    """(R, k), tangent of the elevation: how strongly leaning changes the apparent height."""
    by_posture: Matrix
    """(R, 3 k, P), by each change of posture: the log height changes, and the centre sinks with it."""


class RangeModel:
    """Geometry of one flight's sightings.

    Args:
        seen: the observations.
        knots: their averaging.
        camera_m: (n, 3), the camera's (smoothed) path.
        postures: (P, n), changes of the log height at the sightings.
        t_s: (n,), times of the sightings, zero where the target's place is asked for.
        first: the sighting whose range is given.
    """

    def __init__(
        self, seen: Observations, knots: Knots, camera_m: Matrix, postures: Matrix, t_s: Vector, first: int
    ) -> None:
        self._t = t_s
        self._first = first
        self._camera = camera_m
        self._camera_from_world = seen.camera_from_world
        tangents = np.column_stack((seen.measured[:, :2], np.ones(len(seen.t_s))))
        rays = np.einsum("nji,nj->ni", seen.camera_from_world, tangents)
        self.along = 1.0 / np.linalg.norm(rays, axis=1)
        """(n,), cosine of the angle between ray and optical axis."""
        self.rays: Matrix = rays * self.along[:, None]
        """(n, 3), measured, ENU, unit length."""
        self._log_height = seen.measured[:, 2]
        self._averages = np.stack((knots.bearing, knots.bearing, knots.size))
        self._right = seen.camera_from_world[:, 0]
        self._postures = np.einsum("ckn,pn->ckpn", self._averages, postures)

    def linearised(self, ranges_m: Vector, path_m: Matrix) -> Linearised:
        """Linearise about paths (R, n, 3) relative to the camera whose first ranges are `ranges_m` (R,)."""
        far = np.linalg.norm(path_m, axis=2, keepdims=True)
        ahead = path_m / far
        across = np.stack((ahead[..., 1], -ahead[..., 0], np.zeros_like(ahead[..., 0])), axis=-1)
        level = np.linalg.norm(across, axis=2, keepdims=True)
        across = across / np.maximum(level, 1e-9)
        upward = np.cross(across, ahead)
        along = np.einsum("rnc,nc->rn", ahead, self.rays)
        along = np.where(np.abs(along) > 0.05, along, 0.05)
        measured = np.stack(
            (
                np.einsum("rnc,nc->rn", across, self.rays) / along,
                np.einsum("rnc,nc->rn", upward, self.rays) / along,
                np.zeros_like(along),
            ),
            axis=-1,
        )
        height = self._log_projection(path_m)
        measured[..., 2] = self._log_height - height
        by_place = np.empty((*path_m.shape[:2], 3, 3))
        by_place[:, :, 0], by_place[:, :, 1] = across / far, upward / far
        step = _NUDGE * far[..., 0]
        for axis in range(3):
            nudged = path_m.copy()
            nudged[..., axis] += step
            by_place[:, :, 2, axis] = (self._log_projection(nudged) - height) / step
        # The target's place is start + what the design's unknowns make of it; the nominal path is where it is linear.
        first = self._first
        beyond = path_m + (self._camera - self._camera[first]) - (ranges_m[:, None] * ahead[:, first])[:, None]
        measured += np.einsum("rnij,rnj->rni", by_place, beyond)
        knots = self._averages.shape[1]
        count, rows = len(ranges_m), 3 * knots
        averaged = np.einsum("ckn,rncj->rkcj", self._averages, by_place, optimize=True)
        moving = np.einsum("ckn,rncj->rkcj", self._averages * self._t, by_place, optimize=True)
        heading = _turn_about(np.array([0.0, 0.0, 1.0]), ahead, across, upward)
        tilt = _turn_about(self._right, ahead, across, upward)
        heading_k = np.einsum("ckn,rnc->rkc", self._averages[:2], heading)
        tilt_k = np.einsum("ckn,rnc->rkc", self._averages[:2], tilt)
        design = np.zeros((count, knots, 3, COLUMNS))
        design[..., SIDE] = np.einsum("rkcj,rj->rkc", averaged, across[:, first])
        design[..., RISE] = np.einsum("rkcj,rj->rkc", averaged, upward[:, first])
        design[..., SPEED] = moving
        design[:, :, 2, SIZE] = 1.0
        design[:, :, :2, HEADING] = heading_k
        design[:, :, :2, TILT] = tilt_k
        sinking = _SINKING_M * by_place[..., 2]
        sinking[..., 2] += 1.0
        posture = np.einsum("ckpn,rnc->rkcp", self._postures, sinking, optimize=True)
        tangent = np.abs(ahead[..., 2]) / np.maximum(level[..., 0], 0.05)
        return Linearised(
            ranges_m,
            path_m,
            np.stack((ahead[:, first], across[:, first], upward[:, first]), axis=1),
            np.einsum("ckn,rnc->rkc", self._averages, measured).reshape(count, rows),
            design.reshape(count, rows, COLUMNS),
            averaged.reshape(count, rows, 3),
            design[..., HEADING].reshape(count, rows),
            design[..., TILT].reshape(count, rows),
            tangent @ self._averages[2].T,
            posture.reshape(count, rows, len(self._postures[0, 0])),
        )

    def _log_projection(self, path_m: Matrix) -> Matrix:
        """Logarithm of the length, in tangents, that an upright metre has in the picture, (R, n)."""
        q = np.einsum("nij,rnj->rni", self._camera_from_world, path_m)
        up = self._camera_from_world[:, :, 2]
        depth = np.where(np.abs(q[..., 2]) > 1e-6, q[..., 2], 1e-6)
        x = (up[:, 0] - q[..., 0] / depth * up[:, 2]) / depth
        y = (up[:, 1] - q[..., 1] / depth * up[:, 2]) / depth
        return np.asarray(0.5 * np.log(x * x + y * y + 1e-18))


def _turn_about(axis: Matrix, ahead: Matrix, across: Matrix, upward: Matrix) -> Matrix:
    """What a small turn about an axis ((3,) or (n, 3)) does to the bearings across and up, (R, n, 2)."""
    turned = np.cross(np.broadcast_to(axis, ahead.shape), ahead)
    return np.stack(((across * turned).sum(axis=2), (upward * turned).sum(axis=2)), axis=-1)
