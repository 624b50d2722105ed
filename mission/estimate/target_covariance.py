"""The target's mean and covariance from the factored normal equations, everything else eliminated."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mission.estimate.arrow import Factored
from mission.estimate.joint_model import WHITE, JointModel, P, State, V
from mission.records import Matrix, NoiseModel, Vector


@dataclass(frozen=True, slots=True, eq=False)
class TargetMoments:
    """Of nine numbers: position at the first sighting, then position and velocity at the last one.

    Positions relative to the model's reference.
    """

    mean: Vector
    """(9,)."""
    covariance: Matrix
    """(9, 9)."""

    @property
    def first_covariance(self) -> Matrix:
        """(3, 3), position at the first sighting."""
        return self.covariance[:3, :3]

    @property
    def last_covariance(self) -> Matrix:
        """(6, 6), position and velocity at the last sighting."""
        return self.covariance[3:, 3:]


def target_moments(model: JointModel, state: State, factored: Factored) -> TargetMoments:
    """Mean and covariance at a state.

    Raises:
        NotPositiveDefinite: the information is singular.
    """
    border = factored.border_covariance()
    unit = np.concatenate((np.ones(3), model.speed_sigma))
    start = border[:6, :6] * np.outer(unit, unit)
    span = float(model.seen.t_s[-1])
    spread = np.zeros((9, 6))  # of the nine numbers by position and velocity at the first sighting
    spread[[0, 1, 2, 3, 4, 5, 6, 7, 8], [0, 1, 2, 0, 1, 2, 3, 4, 5]] = 1.0
    spread[[3, 4, 5], [3, 4, 5]] = span
    velocity = state.border[V] * model.speed_sigma
    mean = np.concatenate((state.border[P], state.border[P] + span * velocity, velocity))
    covariance = spread @ start @ spread.T
    if model.manoeuvres:
        root = math.sqrt(model.prior.acceleration_psd_m2_s3)
        places = (model.count - 1) * model.block + model.deviation + np.arange(4)
        own, cross = factored.chain_covariance(places)
        wander = np.zeros((9, 4))
        wander[[3, 6, 4, 7], [0, 1, 2, 3]] = root
        mean = mean + wander @ state.chain[-1, model.deviation :]
        mixed = wander @ (cross[:, :6] * unit) @ spread.T
        covariance = covariance + wander @ own @ wander.T + mixed + mixed.T
    return TargetMoments(mean, 0.5 * (covariance + covariance.T))


def in_open_world(moments: TargetMoments, about_m: Vector, noise: NoiseModel) -> TargetMoments:
    """The moments where the camera's whole path, with its attitudes, may be too large or turned.

    Stretching or turning path and attitudes together about a place does the same to everything that is seen from it,
    and no sighting tells. So each adds one rank of covariance to the target's place and velocity: sigma^2 u u' with u
    the place relative to that point and the velocity for a stretch, an axis times these for a turn.

    Args:
        moments: in a world of the right size and direction.
        about_m: (3,), where the path stays, relative to the model's reference.
        noise: its `position_scale_sigma`, `world_heading_sigma_rad` and `world_tilt_sigma_rad`.
    """
    arms = (moments.mean - np.concatenate((about_m, about_m, np.zeros(3)))).reshape(3, 3)
    covariance = moments.covariance + noise.position_scale_sigma**2 * np.outer(arms, arms)
    turns = (noise.world_tilt_sigma_rad, noise.world_tilt_sigma_rad, noise.world_heading_sigma_rad)
    for axis, sigma in zip(np.eye(3), turns, strict=True):
        turned = np.cross(axis, arms)
        covariance = covariance + sigma**2 * np.outer(turned, turned)
    return TargetMoments(moments.mean, covariance)


def first_camera(model: JointModel, state: State) -> Vector:
    """The most probable true camera position at the first sighting, (3,), relative to the model's reference."""
    place: Vector = model.seen.camera_m[0] - model.noise.position_sigma_m * state.chain[0, WHITE]
    return place
