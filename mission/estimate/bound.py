"""The Cramer-Rao bound of a planned or a flown pattern: how exact any unbiased estimate from it can be at best.

The Fisher information of the joint model (`joint_model.py`) at the truth, with the priors of the camera's errors and
of the velocity, and everything but the target eliminated (van Trees' Bayesian bound, evaluated at one target). The
same noise model as the estimator's, and the same code, so the two cannot drift apart. One evaluation costs about one
Gauss-Newton step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mission.errors import EstimateRefused
from mission.estimate.arrow import NotPositiveDefinite
from mission.estimate.joint_model import JointModel
from mission.estimate.observations import LEAST_PIXEL_SIGMA_PX, LEAST_SIZE_SIGMA, Observations
from mission.estimate.target_covariance import target_moments
from mission.records import CameraIntrinsics, Matrix, NoiseModel, TargetPrior, Vector

_HOPELESS = 100.0
"""A depth's sigma, in depths, at which rounding is all that holds it."""


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """The least covariance that an unbiased estimate can have."""

    depth_m: float
    """Horizontal distance from the first camera position to the target at the first sighting."""
    depth_sigma_m: float
    """1-sigma of it."""
    first_covariance: Matrix
    """(3, 3), position at the first sighting, m2."""
    covariance: Matrix
    """(6, 6), position and velocity at the last sighting."""

    @property
    def relative_depth_sigma(self) -> float:
        """1-sigma of the depth as a share of it."""
        return self.depth_sigma_m / self.depth_m


def bound(
    t_s: Vector,
    camera_m: Matrix,
    target_m: Vector,
    velocity_m_s: Vector,
    camera: CameraIntrinsics,
    noise: NoiseModel,
    prior: TargetPrior,
    *,
    world_from_camera_wxyz: Matrix | None = None,
    sized: bool = True,
) -> Bound:
    """The bound for one pattern and one target.

    Args:
        t_s: times of the sightings, (n,), ascending.
        camera_m: true camera positions, (n, 3), ENU.
        target_m: target position at the first sighting, (3,), ENU.
        velocity_m_s: its velocity, (3,), constant.
        camera: intrinsics (the bound does not depend on the distortion, which is taken as known).
        noise: the noise model.
        prior: the target's prior.
        world_from_camera_wxyz: true attitudes, (n, 4); when omitted the camera looks at the target, upright.
        sized: whether apparent heights are measured.

    Raises:
        EstimateRefused: the pattern does not determine the target, or it would be behind the camera.
    """
    t = np.asarray(t_s, dtype=float) - t_s[0]
    reference = np.asarray(camera_m[0], dtype=float)
    path = np.asarray(camera_m, dtype=float) - reference
    target = np.asarray(target_m, dtype=float) - reference
    line = target + np.outer(t, velocity_m_s) - path
    if world_from_camera_wxyz is None:
        camera_from_world = _looking_along(line)
    else:
        rotation = Rotation.from_quat(np.asarray(world_from_camera_wxyz, dtype=float), scalar_first=True)
        camera_from_world = np.swapaxes(rotation.as_matrix(), 1, 2)
    q = np.matmul(camera_from_world, line[:, :, None])[:, :, 0]
    if not np.all(q[:, 2] > 0.0):
        raise EstimateRefused("The target would be behind the camera", "Turn the camera to the target.")
    count = len(t)
    scale = np.zeros((count, 2, 2))
    sigma = max(noise.pixel_sigma_px, LEAST_PIXEL_SIGMA_PX)
    scale[:, 0, 0], scale[:, 1, 1] = camera.fx / sigma, camera.fy / sigma
    seen = Observations(
        np.arange(count),
        t,
        np.diff(t),
        path,
        camera_from_world,
        np.column_stack((q[:, :2] / q[:, 2:], -np.log(q[:, 2]))),
        scale,
        np.full(count, 1.0 / max(noise.size_sigma, LEAST_SIZE_SIGMA) if sized else 0.0),
        reference,
        float(t_s[0]),
    )
    model = JointModel(seen, noise, prior)
    state = model.start(target, np.asarray(velocity_m_s, dtype=float), 0.0)
    at = model.linearise(state)
    depth = float(np.hypot(target[0], target[1]))
    toward = target[:2] / depth
    refusal = EstimateRefused(
        "The pattern does not determine the target's position", "Fly further sideways, out and back."
    )
    if at is None:
        raise refusal
    try:
        moments = target_moments(model, state, model.normal_equations(at)[0])
    except NotPositiveDefinite:
        raise refusal from None
    sigma = float(np.sqrt(toward @ moments.first_covariance[:2, :2] @ toward))
    if not sigma < _HOPELESS * depth:
        raise refusal
    return Bound(depth, sigma, moments.first_covariance, moments.last_covariance)


def _looking_along(line: Matrix) -> Matrix:
    """camera_from_world (n, 3, 3) of an upright camera that looks along `line` (n, 3)."""
    forward = line / np.linalg.norm(line, axis=1, keepdims=True)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack((right, np.cross(forward, right), forward), axis=1)
