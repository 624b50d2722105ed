"""Simulated flights at sighting level: a pattern, a walk, and every error that the sightings format names.

The errors follow the format to the letter: pixel, size and attitude errors are stationary first-order Gauss-Markov
processes, the reported position carries white noise and a random walk that starts at zero, heading and tilt carry a
bias each. Every random number comes from the generator that is passed in.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mission.records import (
    CameraIntrinsics,
    FlightSightings,
    GeodeticOrigin,
    NoiseModel,
    Sighting,
    TargetPrior,
    Vector,
)
from sitl.people.drawn_walk import Motion

PAPER_CAMERA = CameraIntrinsics(640, 480, 516.5, 516.5, 320.0, 240.0)
"""Kim & Yow's rig: 320 px at atan(57 / 92)."""
PAPER_BASELINES_M = (0.0, 0.0, 0.475, 0.5175, 0.7575, 0.9125, 1.005, 1.0875, 1.2675, 1.465, 1.8925)
"""Table II: from the previous position, one image each 0.5 s."""
ORIGIN = GeodeticOrigin(37.2276, 126.8405, 30.0)

# The camera looks along +north when turned by nothing: columns are the camera's x, y, z in the world.
_NORTH_FROM_CAMERA = Rotation.from_matrix(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]))


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """The camera's path: times (n,), and positions to the left of, ahead of and above the start (n, 3)."""

    name: str
    t_s: Vector
    left_ahead_up_m: Vector
    heading_on_target: bool = True


def out_and_back(rate_hz: float = 10.0, length_m: float = 3.0, duration_s: float = 6.0) -> Pattern:
    """Out to the left by `length_m` and back again."""
    t = np.arange(0.0, duration_s + 0.5 / rate_hz, 1.0 / rate_hz)
    return _lateral("out-and-back", t, 0.5 * length_m * (1.0 - np.cos(2.0 * math.pi * t / duration_s)))


def s_pattern(rate_hz: float = 10.0, length_m: float = 3.0, duration_s: float = 8.0) -> Pattern:
    """Left, right and back."""
    t = np.arange(0.0, duration_s + 0.5 / rate_hz, 1.0 / rate_hz)
    return _lateral("S", t, length_m * np.sin(2.0 * math.pi * t / duration_s))


def paper_pattern() -> Pattern:
    """The paper's eleven images, flown to the left with a fixed heading."""
    return replace(
        _lateral("paper one-way", 0.5 * np.arange(11.0), np.cumsum(PAPER_BASELINES_M)), heading_on_target=False
    )


def _lateral(name: str, t_s: Vector, left_m: Vector) -> Pattern:
    return Pattern(name, t_s, np.column_stack((left_m, np.zeros_like(left_m), np.zeros_like(left_m))))


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """Where the target is: relative to the camera's start, in the axes (right, ahead, up) of the first heading."""

    depth_m: float
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lateral_m: float = 0.0
    above_camera_m: float = -0.6
    height_m: float = 1.75


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedFlight:
    """What an estimator gets, and what it should find."""

    flight: FlightSightings
    target_m: Vector
    """(n, 3), ENU, at each sighting."""
    velocity_m_s: Vector
    """(n, 3)."""
    camera_m: Vector
    """(n, 3), the true path."""
    wrong: NDArray[np.bool_]
    """(n,), whether the sighting is somebody else."""

    @property
    def depth_m(self) -> float:
        """True horizontal distance from the first camera position to the target at the first sighting."""
        return float(np.hypot(*(self.target_m[0] - self.camera_m[0])[:2]))


def simulate(
    pattern: Pattern,
    walk: Walk,
    rng: np.random.Generator,
    *,
    noise: NoiseModel | None = None,
    prior: TargetPrior | None = None,
    camera: CameraIntrinsics = PAPER_CAMERA,
    heading_rad: float | None = None,
    pitch_down_rad: float = 0.0,
    start_enu_m: tuple[float, float, float] = (0.0, 0.0, 1.5),
    wrong_share: float = 0.0,
    sizes: Callable[[int], bool] = lambda _: True,
    told: NoiseModel | None = None,
    step_psd_m2_s3: Vector | None = None,
    walked: Motion | None = None,
    reported_off_m: Vector | None = None,
    heading_off_rad: float = 0.0,
    name: str = "simulated",
) -> SimulatedFlight:
    """One flight.

    Args:
        pattern: the camera's path.
        walk: the target's start and velocity; with the prior's white-noise acceleration its velocity wanders.
        rng: all randomness.
        noise: the errors that are made; the format's defaults when omitted.
        prior: the target's prior as it stands in the flight.
        camera: intrinsics.
        heading_rad: first heading, clockwise from north; a random one when omitted.
        pitch_down_rad: how far the camera looks down.
        start_enu_m: where the camera is at first.
        wrong_share: share of sightings that are somebody else, 40 to 200 px off.
        sizes: whether the i-th sighting has a size.
        told: the noise model that the flight claims, when it is not the one that is made.
        step_psd_m2_s3: white-noise acceleration of the target in each step (n - 1,), when it is not the prior's.
        walked: how the target walks, in the axes (right, ahead) of the first heading, in place of `walk`'s velocity;
            who crouches is lower, and so is their centre.
        reported_off_m: added to the reported positions (n, 3), beside the errors of `noise`.
        heading_off_rad: added to the reported headings (to the left), beside the errors of `noise`.
        name: the flight's id.
    """
    noise, prior = noise or NoiseModel(), prior or TargetPrior()
    t, n = pattern.t_s, len(pattern.t_s)
    heading = rng.uniform(-math.pi, math.pi) if heading_rad is None else heading_rad
    world_from_start = Rotation.from_euler("z", -heading)
    camera_m = np.asarray(start_enu_m) + world_from_start.apply(pattern.left_ahead_up_m * (-1.0, 1.0, 1.0))
    steps_psd = np.full(n - 1, prior.acceleration_psd_m2_s3) if step_psd_m2_s3 is None else step_psd_m2_s3
    velocity, wander = _velocity(walk, steps_psd, t, rng) if walked is None else _as_walked(walk, walked, t)
    stature = np.ones(n) if walked is None else walked.stature
    target_start = np.array([walk.lateral_m, walk.depth_m, walk.above_camera_m])
    target_m = np.asarray(start_enu_m) + world_from_start.apply(target_start + wander)

    # The true attitude: on the target (or fixed), tilted down, with the roll that a lateral flight takes.
    line = target_m - camera_m
    headings = np.arctan2(line[:, 0], line[:, 1]) if pattern.heading_on_target else np.full(n, heading)
    roll = 0.05 * np.sin(0.9 * t + rng.uniform(0.0, 6.0))
    world_from_true = (
        Rotation.from_euler("z", -headings[:, None])
        * _NORTH_FROM_CAMERA
        * Rotation.from_euler("x", np.full((n, 1), -pitch_down_rad))
        * Rotation.from_euler("z", roll[:, None])
    )
    heading_bias = heading_off_rad + noise.heading_bias_sigma_rad * rng.standard_normal()
    heading_error = heading_bias + noise.heading_sigma_rad * gauss_markov(t, noise.heading_correlation_s, rng)
    tilt_error = noise.tilt_bias_sigma_rad * rng.standard_normal() + noise.tilt_sigma_rad * gauss_markov(
        t, noise.tilt_correlation_s, rng
    )
    turned = Rotation.from_euler("z", heading_error[:, None])
    reported = turned * world_from_true * Rotation.from_euler("x", tilt_error[:, None])
    steps = np.sqrt(np.diff(t, prepend=t[0]))[:, None] * rng.standard_normal((n, 3))
    reported_m = (
        camera_m
        + noise.position_walk_m_per_sqrt_s * np.cumsum(steps, axis=0)
        + noise.position_sigma_m * rng.standard_normal((n, 3))
    )
    if reported_off_m is not None:
        reported_m = reported_m + reported_off_m
    seen = world_from_true.inv().apply(line)
    ideal = seen[:, :2] / seen[:, 2:]
    pixels = distorted(ideal, camera) + noise.pixel_sigma_px * np.column_stack(
        [gauss_markov(t, noise.pixel_correlation_s, rng) for _ in range(2)]
    )
    heights = (
        camera.fy
        * _upright_projection(seen, world_from_true, walk.height_m * stature)
        * np.exp(noise.size_sigma * gauss_markov(t, noise.size_correlation_s, rng))
    )
    wrong = rng.random(n) < wrong_share
    away = rng.uniform(0.0, 2.0 * math.pi, n)
    distance = np.where(wrong, rng.uniform(40.0, 200.0, n), 0.0)
    pixels = pixels + distance[:, None] * np.column_stack((np.cos(away), np.sin(away)))
    quaternions = reported.as_quat(scalar_first=True)
    sightings = tuple(
        Sighting(
            float(t[i]),
            (float(reported_m[i, 0]), float(reported_m[i, 1]), float(reported_m[i, 2])),
            (float(q[0]), float(q[1]), float(q[2]), float(q[3])),
            (float(pixels[i, 0]), float(pixels[i, 1])),
            float(heights[i]) if sizes(i) else None,
        )
        for i, q in enumerate(quaternions)
    )
    return SimulatedFlight(
        FlightSightings(name, ORIGIN, camera, sightings, told or noise, prior),
        target_m,
        world_from_start.apply(velocity),
        camera_m,
        wrong,
    )


def _as_walked(walk: Walk, walked: Motion, t_s: Vector) -> tuple[Vector, Vector]:
    """Velocity (n, 3) and way (n, 3) of a drawn walk: the centre sinks by half of what the height loses."""
    sunk = 0.5 * walk.height_m * (walked.stature - walked.stature[0])
    return (
        np.column_stack((walked.velocity_m_s, np.gradient(sunk, t_s))),
        np.column_stack((walked.way_m, sunk)),
    )


def _upright_projection(seen_m: Vector, world_from_camera: Rotation, height_m: Vector) -> Vector:
    """Length in tangents of the picture of upright bodies (n,) centred at places in camera axes (n, 3), (n,)."""
    up = np.column_stack((np.zeros((len(height_m), 2)), 0.5 * height_m))
    half = world_from_camera.inv().apply(up)
    above, below = seen_m + half, seen_m - half
    ends = above[:, :2] / above[:, 2:] - below[:, :2] / below[:, 2:]
    return np.asarray(np.linalg.norm(ends, axis=1))


def gauss_markov(t_s: Vector, correlation_s: float, rng: np.random.Generator) -> Vector:
    """A stationary first-order Gauss-Markov process of unit variance at the times `t_s`; white for 0 s."""
    shocks = rng.standard_normal(len(t_s))
    if correlation_s <= 0.0:
        return shocks
    rho = np.exp(-np.diff(t_s) / correlation_s)
    process = np.empty(len(t_s))
    process[0] = shocks[0]
    for i, r in enumerate(rho):
        process[i + 1] = r * process[i] + math.sqrt(1.0 - r * r) * shocks[i + 1]
    return process


def distorted(ideal: Vector, camera: CameraIntrinsics) -> Vector:
    """Pixels of ideal image coordinates (n, 2), by OpenCV's polynomial model."""
    k1, k2, p1, p2, k3 = camera.distortion
    x, y = ideal[:, 0], ideal[:, 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.column_stack((camera.fx * xd + camera.cx, camera.fy * yd + camera.cy))


def _velocity(walk: Walk, step_psd: Vector, t_s: Vector, rng: np.random.Generator) -> tuple[Vector, Vector]:
    """Velocity (n, 3) and way (n, 3) since the start, with exact white-noise acceleration on the horizontal axes."""
    n = len(t_s)
    velocity = np.tile(np.asarray(walk.velocity_m_s), (n, 1))
    way = np.outer(t_s - t_s[0], walk.velocity_m_s)
    if not step_psd.any():
        return velocity, way
    speed_change, path = np.zeros(2), np.zeros(2)
    for i in range(1, n):
        dt = t_s[i] - t_s[i - 1]
        first, second = rng.standard_normal((2, 2)) * math.sqrt(step_psd[i - 1])
        path = path + dt * speed_change + math.sqrt(dt**3 / 3.0) * first
        # Joint covariance [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]] by its Cholesky factor.
        speed_change = speed_change + math.sqrt(0.75 * dt) * first + math.sqrt(0.25 * dt) * second
        velocity[i, :2] += speed_change
        way[i, :2] += path
    return velocity, way
