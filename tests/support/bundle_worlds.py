"""Made-up worlds: points, a camera that flies past them, and what an autopilot would say of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mission.bundle.gauss_markov import GaussMarkov
from mission.bundle.projection import Cameras, Rows
from mission.bundle.telemetry_prior import ErrorLevels, TelemetryPrior
from mission.records import Matrix, NoiseModel, Vector

FOCAL_PX = 516.0
ROUGH = NoiseModel(
    position_walk_m_per_sqrt_s=0.09, heading_sigma_rad=0.035, tilt_sigma_rad=0.019, tilt_bias_sigma_rad=0.019
)
NORTHWARD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""World_from_camera of a level camera that looks north."""


@dataclass(frozen=True)
class Flight:
    """True cameras, reported ones, and where points were seen."""

    true: Cameras
    reports: TelemetryPrior
    rows: Rows

    @property
    def levels(self) -> ErrorLevels:
        return ErrorLevels.stated(ROUGH)


def street(rng: np.random.Generator, count: int = 120) -> Matrix:
    """Points (count, 3) on the ground and on things at 5 to 40 m, north of the origin."""
    north = rng.uniform(4.0, 40.0, count)
    east = rng.uniform(-0.7, 0.7, count) * north
    return np.stack([east, north, np.where(rng.uniform(size=count) < 0.5, 0.0, rng.uniform(0.0, 8.0, count))], axis=1)


def wall(rng: np.random.Generator, count: int = 120) -> Matrix:
    """Points on one plane 10 m to the north."""
    return np.stack([rng.uniform(-7.0, 7.0, count), np.full(count, 10.0), rng.uniform(0.0, 5.0, count)], axis=1)


def horizon(rng: np.random.Generator, count: int = 120) -> Matrix:
    """Points so far away that metres do not matter."""
    points = street(rng, count) + np.array([0.0, 0.0, 1.0])
    return np.asarray(1e6 * points / np.linalg.norm(points, axis=1, keepdims=True))


def fly(
    points: Matrix,
    rng: np.random.Generator,
    *,
    out_m: float = 3.0,
    turn_rad: float = 0.3,
    pixel_sigma_px: float = 0.2,
    errors: bool = True,
    frames: int = 25,
) -> Flight:
    """Six seconds west and back at 1.6 m, turning to and fro, with an autopilot whose estimates wander.

    Args:
        points: (m, 3) of the world.
        rng: the noise.
        out_m: how far to the side.
        turn_rad: how far the heading turns on the way.
        pixel_sigma_px: of the points in the picture.
        errors: whether the autopilot errs at all.
        frames: pictures taken.
    """
    t_s = np.linspace(0.0, 6.0, frames)
    way = 0.5 * (1.0 - np.cos(2.0 * np.pi * t_s / 6.0))
    position = np.stack([-out_m * way, 0.03 * np.sin(t_s), 1.6 + 0.05 * np.sin(1.3 * t_s)], axis=1)
    roll = 0.1 * np.cos(2.0 * np.pi * t_s / 6.0)
    true_rotation = (
        Rotation.from_rotvec(np.outer(-turn_rad * way, [0.0, 0.0, 1.0]))
        * Rotation.from_matrix(NORTHWARD)
        * Rotation.from_rotvec(np.outer(roll, [0.0, 0.0, 1.0]))
    )
    size = 1.0 if errors else 0.0
    wandered = np.stack(
        [_drawn(wander.scaled(size), t_s, rng) for wander in (GaussMarkov(0.019, 5.5, 1), GaussMarkov(0.009, 6.0, 1))]
        + [_drawn(GaussMarkov(0.038, 1.8).scaled(size), t_s, rng)],
        axis=1,
    ) + size * rng.normal(size=3) * [0.017, 0.017, 0.026]
    off = np.stack(
        [_drawn(GaussMarkov(sigma * size, tau), t_s, rng) for sigma, tau in ((0.15, 1.5), (0.15, 1.5), (0.07, 0.7))],
        axis=1,
    )
    off = off + size * 0.3 * rng.normal(size=3)
    true = cameras(t_s, true_rotation.as_matrix(), position)
    reported = cameras(t_s, (Rotation.from_rotvec(wandered) * true_rotation).as_matrix(), position + off)
    way_m = position - position[0]
    return Flight(true, TelemetryPrior(reported, way_m), seen(points, true, rng, pixel_sigma_px))


def cameras(t_s: Vector, rotation: NDArray[np.float64], position: Matrix) -> Cameras:
    """Cameras without a rolling shutter, so that their rates do not matter."""
    return Cameras(t_s, rotation, position, np.zeros_like(position), np.zeros_like(position))


def seen(points: Matrix, true: Cameras, rng: np.random.Generator, pixel_sigma_px: float) -> Rows:
    """Where the points are in the pictures in which they are inside."""
    frame, point, measured = [], [], []
    for number in range(len(true.t_s)):
        y = (points - true.position_m[number]) @ true.rotation[number]
        ideal = y[:, :2] / np.maximum(y[:, 2:], 0.1)
        inside = np.flatnonzero((y[:, 2] > 0.5) & (np.abs(ideal[:, 0]) < 0.7) & (np.abs(ideal[:, 1]) < 0.5))
        frame.append(np.full(len(inside), number))
        point.append(inside)
        measured.append(ideal[inside] + rng.normal(size=(len(inside), 2)) * pixel_sigma_px / FOCAL_PX)
    rows = Rows(np.concatenate(frame), np.concatenate(point), np.concatenate(measured), np.zeros(sum(map(len, frame))))
    often = np.bincount(rows.point, minlength=len(points)) >= 4
    kept = rows.only(often[rows.point])
    return Rows(kept.frame, (np.cumsum(often) - 1)[kept.point], kept.measured, kept.delay_s)


def _drawn(wander: GaussMarkov, t_s: Vector, rng: np.random.Generator) -> Vector:
    if wander.sigma == 0.0:
        return np.zeros(len(t_s))
    return rng.multivariate_normal(np.zeros(len(t_s)), wander.covariance(t_s), method="cholesky")
