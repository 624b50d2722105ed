"""Which part of a track can tell where its person is: the information that the flown path gives, before measuring.

The bound is that of `sidestep plan` (`mission.estimate.bound`), for somebody of ordinary size where they were detected
who may walk as people do, along the path that was really flown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mission.camera.camera import Camera
from mission.camera.model import CameraModel
from mission.errors import EstimateRefused
from mission.estimate.bound import bound
from mission.observation.candidates import Candidate
from mission.planning.aim import PRESUMED_HEIGHT_M
from mission.planning.bound import WALKING_PSD_M2_S3
from mission.pose.buffer import PoseAt
from mission.records import NoiseModel, TargetPrior, Vector
from mission.sighting import camera_position, world_from_camera

MOST_S = 16.0
"""Longest part that is measured: a walk is not a straight line for longer, and the estimate's work grows."""
LEAST_S = 2.0
_RATE_HZ = 5.0
_MARGIN_S = 0.5
_PIXEL_SIGMA = 1.5
_STEP_S = 2.0


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a track, video times, and how well the distance could be known from it."""

    from_s: float
    to_s: float
    relative_sigma: float
    """1-sigma of the horizontal distance over the distance, at best; infinite where it is not determined."""
    lateral: float
    """How far the camera went across the line of sight, over the distance."""


def best_part(
    candidate: Candidate, pose_at: PoseAt, camera: Camera, offset_s: float, noise: NoiseModel, prior: TargetPrior
) -> Part:
    """The part of a track that tells most.

    Args:
        candidate: with its detections.
        pose_at: the camera carrier's pose at a time of the log.
        camera: lens and mounting.
        offset_s: between video and log.
        noise: of the poses.
        prior: of the person.
    """
    first_s, last_s = candidate.first_s, candidate.last_s + _MARGIN_S
    starts = [first_s]
    if last_s - first_s > MOST_S:
        starts = list(np.arange(first_s, last_s - MOST_S + _STEP_S, _STEP_S))
    parts = [
        _part(candidate, start, min(start + MOST_S, last_s), pose_at, camera, offset_s, noise, prior)
        for start in starts
    ]
    return min(parts, key=lambda part: (part.relative_sigma, -part.lateral, part.from_s))


def _part(
    candidate: Candidate,
    from_s: float,
    to_s: float,
    pose_at: PoseAt,
    camera: Camera,
    offset_s: float,
    noise: NoiseModel,
    prior: TargetPrior,
) -> Part:
    nothing = Part(from_s, to_s, math.inf, 0.0)
    if to_s - from_s < LEAST_S:
        return nothing
    times = np.arange(from_s, to_s, 1.0 / _RATE_HZ)
    known = [(t_s, pose) for t_s in times.tolist() if (pose := pose_at(t_s - offset_s)) is not None]
    if len(known) < LEAST_S * _RATE_HZ:
        return nothing
    t_s = np.array([t for t, _ in known])
    path = np.array([camera_position(pose, camera) for _, pose in known])
    target = _place(candidate, from_s, to_s, pose_at, camera, offset_s)
    if target is None:
        return nothing
    sight = (target - path[0])[:2]
    distance = float(np.linalg.norm(sight))
    if distance < 0.5:
        return nothing
    across = (path[:, :2] - path[0, :2]) @ np.array([sight[1], -sight[0]]) / distance
    lateral = float(np.ptp(across)) / distance
    wander = TargetPrior(
        speed_sigma_m_s=prior.speed_sigma_m_s,
        vertical_speed_sigma_m_s=prior.vertical_speed_sigma_m_s,
        acceleration_psd_m2_s3=prior.acceleration_psd_m2_s3 or WALKING_PSD_M2_S3,
    )
    seen = NoiseModel(
        pixel_sigma_px=_PIXEL_SIGMA,
        position_walk_m_per_sqrt_s=noise.position_walk_m_per_sqrt_s,
        heading_bias_sigma_rad=noise.heading_bias_sigma_rad,
        tilt_bias_sigma_rad=noise.tilt_bias_sigma_rad,
    )
    try:
        told = bound(t_s, path, target, np.zeros(3), camera.intrinsics, seen, wander)
    except EstimateRefused:
        return Part(from_s, to_s, math.inf, lateral)
    return Part(from_s, to_s, told.relative_depth_sigma, lateral)


def _place(
    candidate: Candidate, from_s: float, to_s: float, pose_at: PoseAt, camera: Camera, offset_s: float
) -> Vector | None:
    """About where the person was: the median over the detections of a person of ordinary size."""
    lens = CameraModel(camera.intrinsics)
    places = []
    for t_s, one in candidate.looks:
        pose = pose_at(t_s - offset_s)
        if from_s - _MARGIN_S <= t_s <= to_s and pose is not None:
            ray = world_from_camera(pose, camera).apply(lens.ray(np.array(one.box.centre_px)))
            away = camera.intrinsics.fy * PRESUMED_HEIGHT_M / max(one.box.height_px, 1.0)
            places.append(camera_position(pose, camera) + away * ray)
    return np.median(places, axis=0) if places else None
