"""A synthetic flight over a textured panorama: known rotation, a walking patch, a swaying camera, a rolling shutter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from mission.camera import Camera, CameraModel
from mission.camera.mounting import rotation, wxyz
from mission.pose.buffer import Pose
from mission.records import Frame, Vector

_PX_PER_RAD = 500.0
_ENU_FROM_BODY_NORTH = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def world_from_body(heading: float, pitch: float, roll: float) -> Rotation:
    """Heading clockwise from north, nose up, right wing down."""
    turned = Rotation.from_euler("ZYX", [heading, pitch, roll])
    return Rotation.from_matrix(_ENU_FROM_BODY_NORTH @ turned.as_matrix())


@dataclass(frozen=True)
class Flight:
    """What a test flies: heading as a function of time, and what disturbs the measurement."""

    camera: Camera
    heading: Callable[[float], float]
    duration_s: float = 6.0
    fps: float = 20.0
    offset_s: float = 0.0
    sway_m_s: float = 0.3
    heading_noise_rad: float = 0.002
    pixel_noise: float = 4.0
    person: bool = True
    attitude_hz: float = 50.0
    seed: int = 0

    def attitude(self, t_s: float) -> Rotation:
        wobble = 0.03 * math.sin(2.0 * t_s + self.seed)
        return world_from_body(self.heading(t_s), 0.02 + 0.5 * wobble, wobble)

    def pose_at(self) -> Callable[[float], Pose | None]:
        rng = np.random.default_rng(self.seed + 1000)
        times = np.arange(-1.0, self.duration_s + 1.0, 1.0 / self.attitude_hz)
        times = times + rng.uniform(0.0, 0.3 / self.attitude_hz, len(times))
        noise = rng.normal(0.0, self.heading_noise_rad, (len(times), 3))
        reported = Rotation.concatenate(
            [Rotation.from_rotvec(n) * self.attitude(float(t)) for t, n in zip(times, noise, strict=True)]
        )
        between = Slerp(times, reported)

        def pose_at(t_s: float) -> Pose | None:
            if not times[0] <= t_s <= times[-1]:
                return None
            return level_pose(t_s, np.array(wxyz(between(t_s))))

        return pose_at

    def frames(self) -> Iterator[Frame]:
        rng = np.random.default_rng(self.seed)
        panorama = texture(self.seed % 3)
        lens = self.camera.intrinsics
        x, y = np.meshgrid(np.arange(lens.width_px) + 0.5, np.arange(lens.height_px) + 0.5)
        rays = CameraModel(lens).ray(np.column_stack([x.ravel(), y.ravel()]))
        body = rotation(self.camera.mounting.body_from_camera_wxyz)
        grain = rng.normal(0.0, self.pixel_noise, (lens.height_px, lens.width_px)).astype(np.float32)
        for index in range(int(self.duration_s * self.fps)):
            t_s = index / self.fps + rng.uniform(0.0, 0.004)
            early, late = (t_s + share * self.camera.readout_s for share in (-0.5, 0.5))
            first, last = (self.attitude(at) * body for at in (early, late))
            share = (y.ravel() / lens.height_px)[:, None]
            world = (1.0 - share) * first.apply(rays) + share * last.apply(rays)
            azimuth = np.arctan2(world[:, 0], world[:, 1])
            elevation = np.arctan2(world[:, 2], np.hypot(world[:, 0], world[:, 1]))
            # The ground, seen from 3 m up, moves by parallax; the horizon does not.
            nearness = np.clip(np.tan(-elevation) / 3.0, 0.0, 0.3)
            azimuth = azimuth - self.sway_m_s * math.sin(0.7 * t_s + self.seed) / 0.7 * nearness
            image = look(panorama, azimuth, elevation, (lens.height_px, lens.width_px))
            if self.person:
                where = 0.25 * math.sin(0.5 * t_s) + 0.1
                inside = (np.abs(azimuth - where) < 0.09) & (np.abs(elevation + 0.1) < 0.3)
                patch = look(panorama, azimuth - where + 2.0, elevation, (lens.height_px, lens.width_px))
                mask = inside.reshape(lens.height_px, lens.width_px)
                image[mask] = patch[mask]
            noisy = image + np.roll(grain, rng.integers(0, grain.size))[..., None]
            yield Frame(np.clip(noisy, 0, 255).astype(np.uint8), t_s + self.offset_s, index)


def level_pose(t_s: float, world_from_body_wxyz: Vector) -> Pose:
    return Pose(t_s, np.zeros(3), np.zeros(3), world_from_body_wxyz, np.eye(3) * 1e-4, np.eye(3) * 1e-6)


@cache
def texture(seed: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Blobs of several sizes all around the horizon."""
    rng = np.random.default_rng(seed)
    width, height = round(2.0 * math.pi * _PX_PER_RAD), round(2.0 * _PX_PER_RAD)
    total = np.zeros((height, width, 3), np.float32)
    for cell, strength in ((4, 25.0), (12, 40.0), (40, 40.0)):
        coarse = rng.normal(0.0, strength, (height // cell + 1, width // cell + 1, 3)).astype(np.float32)
        total += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(total + 120.0, 0, 255), dtype=np.uint8)


def look(
    panorama: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], azimuth: Vector, elevation: Vector, size: tuple[int, int]
) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    height = panorama.shape[0]
    u = (np.mod(azimuth, 2.0 * math.pi) * _PX_PER_RAD).astype(np.float32).reshape(size)
    v = (height / 2.0 - elevation * _PX_PER_RAD).astype(np.float32).reshape(size)
    seen = cv2.remap(panorama, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(seen, dtype=np.uint8)
