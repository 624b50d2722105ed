"""Carry an estimate on from sidestep to sidestep: repeated passes narrow the ellipse, a gap widens it.

What one pass leaves is the normal distribution of position, velocity, log size, heading bias and tilt bias at its last
sighting. It is moved to the first sighting of the next pass as a target with white-noise acceleration moves,

    p' = p + v dt,   v' = v,   Q = q [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]] per horizontal axis,

and there it takes the prior's place in the same joint model that a single pass is estimated with. (Bar-Shalom, Li &
Kirubarajan, Estimation with Applications to Tracking and Navigation, 6.2.2; an iterated Kalman smoother, pass by pass.)

Where the reported position walks, two things are to be kept apart: a pass places the target relative to where the
camera was reported to be at the pass's first sighting, and the next pass's reports have walked since. So the position
that is carried is the one relative to the reports at the last sighting, p + (the walk there), and the walk goes on in
the gap.
The biases stay what they are: a heading that is 2 degrees off is 2 degrees off in each pass, so a pass more does not
average it out, and both passes know it. The size may change by what a posture changes it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.arrow import NotPositiveDefinite
from mission.estimate.constant_velocity import most_probable
from mission.estimate.gauss_newton import Minimum
from mission.estimate.joint_model import BORDER, HEADING, SIZE, TILT, WALK, BorderPrior, JointModel
from mission.estimate.observations import observe, tamed_noise, tamed_prior
from mission.estimate.posterior import to_estimate
from mission.estimate.target_covariance import first_camera
from mission.records import Estimate, FlightSightings, Matrix, NoiseModel, Vector

BETWEEN_PSD_M2_S3 = 0.02
"""How a walking person's velocity wanders while nobody looks, unless the prior says more: 0.14 m/s in a second."""
POSTURE_SIGMA = 0.01
"""Of the logarithm of the apparent height, from pass to pass: another step of the gait, head up or down."""
_UNKNOWN = 1e4
"""Variance of what nothing is known of."""
_LEAST = 1e-10
"""Variance below which a number is certain."""


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """What is known of the target, and of the camera's biases, at a time."""

    t_s: float
    mean: Vector
    """(9,): position ENU (m, relative to the reports of this time), velocity (m/s), log size (m), heading bias, tilt
    bias (rad)."""
    covariance: Matrix
    """(9, 9)."""

    def at(self, t_s: float, psd_m2_s3: float, walk_m_per_sqrt_s: float = 0.0) -> Carried:
        """The same, later: wider by the target's freedom and by the reported position's random walk.

        Args:
            t_s: when, not before `self.t_s`.
            psd_m2_s3: white-noise acceleration per horizontal axis.
            walk_m_per_sqrt_s: of the reported position, per axis.
        """
        dt = max(t_s - self.t_s, 0.0)
        move = np.eye(BORDER)
        move[:3, 3:6] = dt * np.eye(3)
        grown = np.zeros((BORDER, BORDER))
        for axis in range(2):
            grown[axis, axis] = psd_m2_s3 * dt**3 / 3.0
            grown[axis, axis + 3] = grown[axis + 3, axis] = psd_m2_s3 * dt**2 / 2.0
            grown[axis + 3, axis + 3] = psd_m2_s3 * dt
        grown[:3, :3] += walk_m_per_sqrt_s**2 * dt * np.eye(3)
        grown[SIZE, SIZE] = POSTURE_SIGMA**2 if dt > 0.0 else 0.0
        return Carried(t_s, move @ self.mean, move @ self.covariance @ move.T + grown)


def carry_on(flight: FlightSightings, carried: Carried | None = None) -> tuple[Estimate, Carried]:
    """Estimate one pass with what the passes before it left, and what to take along to the next.

    Args:
        flight: the sightings of this pass, in the same local frame and on the same clock as the ones before.
        carried: what `carry_on` gave for the pass before, or None for the first pass.

    Returns:
        The estimate, and what is known at its last sighting.

    Raises:
        EstimateRefused: the sightings and what was carried cannot support a position.
    """
    seen = observe(flight)
    if len(seen.t_s) < 3:
        raise EstimateRefused(
            f"{len(seen.t_s)} usable sightings are too few", "Keep the target in view for three sightings or more."
        )
    flight = replace(flight, noise=tamed_noise(flight.noise), prior=tamed_prior(flight.prior))
    prior = None
    if carried is not None:
        psd = max(flight.prior.acceleration_psd_m2_s3, BETWEEN_PSD_M2_S3)
        before = carried.at(seen.start_s, psd, flight.noise.position_walk_m_per_sqrt_s)
        prior = _as_prior(before, seen.reference_m, _units(flight))
    try:
        with np.errstate(all="ignore"):
            model, minimum = most_probable(flight, seen, prior)
            return to_estimate(flight, model, minimum), _left(flight, model, minimum)
    except (NotPositiveDefinite, np.linalg.LinAlgError):
        raise EstimateRefused(
            "The sightings do not determine a position", "Fly further sideways, and keep the target in view."
        ) from None


def _open_world(mean: Vector, about_m: Vector, noise: NoiseModel) -> Matrix:
    """What a path that may be stretched or turned as a whole does to what is carried (see `in_open_world`), (9, 9)."""
    arms = np.concatenate((mean[:3] - about_m, mean[3:6])).reshape(2, 3)
    stretch = np.zeros(BORDER)
    stretch[:6], stretch[SIZE] = arms.ravel(), 1.0  # what is farther away and looks the same is larger
    covariance = noise.position_scale_sigma**2 * np.outer(stretch, stretch)
    turns = (noise.world_tilt_sigma_rad, noise.world_tilt_sigma_rad, noise.world_heading_sigma_rad)
    for axis, sigma in zip(np.eye(3), turns, strict=True):
        turned = np.zeros(BORDER)
        turned[:6] = np.cross(axis, arms).ravel()
        covariance += sigma**2 * np.outer(turned, turned)
    return covariance


def _units(flight: FlightSightings) -> Vector:
    """What one unit of each border element is, (9,)."""
    noise: NoiseModel = flight.noise
    speed, vertical = flight.prior.speed_sigma_m_s, flight.prior.vertical_speed_sigma_m_s
    biases = (noise.heading_bias_sigma_rad, noise.tilt_bias_sigma_rad)
    return np.array((1.0, 1.0, 1.0, speed, speed, vertical, 1.0, *biases))


def _as_prior(known: Carried, reference_m: Vector, units: Vector) -> BorderPrior:
    """A carried state in the border's units; an element whose unit is zero has no effect and stays as it is."""
    scale = np.where(units > 0.0, units, 1.0)
    mean = known.mean.copy()
    mean[:3] -= reference_m
    covariance = known.covariance / np.outer(scale, scale)
    dead = np.flatnonzero(units <= 0.0)
    covariance[dead, :] = covariance[:, dead] = 0.0
    covariance[dead, dead] = 1.0
    mean[dead] = 0.0
    return BorderPrior(mean / scale, np.linalg.inv(covariance + _LEAST * np.eye(BORDER)))


def _left(flight: FlightSightings, model: JointModel, minimum: Minimum) -> Carried:
    """What the minimum says at the last sighting, the position relative to the reports there."""
    state, span = minimum.at.state, float(model.seen.t_s[-1])
    shared = np.eye(BORDER)  # by the border
    shared[:3, 3:6] = span * np.eye(3)
    shared *= _units(flight)
    own = np.zeros((BORDER, model.block))  # by the last block of the chain
    own[:3, WALK] = model.noise.position_walk_m_per_sqrt_s * np.eye(3)
    if model.manoeuvres:
        root = math.sqrt(model.prior.acceleration_psd_m2_s3)
        own[[0, 3, 1, 4], model.deviation + np.arange(4)] = root
    last = (model.count - 1) * model.block + np.arange(model.block)
    block, cross = minimum.factored.chain_covariance(last)
    mean = shared @ state.border + own @ state.chain[-1]
    mixed = own @ cross @ shared.T
    covariance = shared @ minimum.factored.border_covariance() @ shared.T + own @ block @ own.T + mixed + mixed.T
    if not model.any_size:
        covariance[SIZE, :] = covariance[:, SIZE] = 0.0
        covariance[SIZE, SIZE] = _UNKNOWN
    for place in (HEADING, TILT):
        covariance[place, place] = max(covariance[place, place], _LEAST)
    covariance += _open_world(mean, first_camera(model, state), model.noise)
    mean[:3] += model.seen.reference_m
    return Carried(model.seen.start_s + span, mean, covariance)
