"""What the mission's estimate makes of a rendered flight, held to the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mission.bundle import BundleSolution
from mission.estimate import ESTIMATORS
from mission.estimate.noise_fit import with_fitted_noise
from mission.pose.buffer import Pose
from mission.records import Estimate, FlightSightings, TargetPrior, Vector
from mission.sighting import world_from_camera
from sitl.evaluation.rendered.flight import RenderedFlight
from sitl.evaluation.rendered.replay import Replay
from sitl.simulation.score import ELLIPSE_95

PoseAt = Callable[[float], Pose | None]


@dataclass(frozen=True, slots=True)
class FlightScore:
    """Errors of one answer, relative to the camera's own position error (`sitl.simulation.score`); horizontal."""

    depth_error: float
    """Relative and signed, at the first sighting."""
    position_error_m: float
    """At the last sighting."""
    bearing_error_m: float
    """That part of it which is across the line of sight."""
    range_error_m: float
    """And that along it."""
    nees: float
    """Of the last position, 2 degrees of freedom."""
    sigma_m: float
    """Largest semi-axis of the 1-sigma ellipse."""

    @property
    def inside(self) -> bool:
        """Whether the 95 % ellipse holds the truth."""
        return self.nees <= ELLIPSE_95


@dataclass(frozen=True, slots=True)
class RotationError:
    """How far poses turn away from the truth within a flight, relative to its first frame; rms, radians."""

    heading_rad: float
    tilt_rad: float
    """Of the axis, out of the horizontal ones, per axis."""


def sightings(
    flight: RenderedFlight, followed: Replay, pose_at: PoseAt, offset_s: float, steadied: BundleSolution | None = None
) -> FlightSightings:
    """The flight's sightings with the noise that they support, as `mission.procedure.locate` makes them.

    Args:
        flight: what was flown.
        followed: what the mission made of it.
        pose_at: the aircraft's pose.
        offset_s: of the video.
        steadied: the poses by the background; without it the aircraft's are taken.
    """
    noise = followed.pose_noise(flight.noise)
    stated = followed.record.sightings(flight.origin, pose_at, offset_s, noise, TargetPrior(), steadied)
    return with_fitted_noise(stated, steadied=steadied is not None and steadied.reason is None)


def estimate(found: FlightSightings) -> Estimate:
    """The mission's answer.

    Raises:
        EstimateRefused: what was seen supports no position.
    """
    return ESTIMATORS["batch"].estimate(found)


def score(flight: RenderedFlight, found: FlightSightings, answer: Estimate, offset_error_s: float) -> FlightScore:
    """Compare an answer with the truth.

    Args:
        flight: what was flown.
        found: what the answer was made from.
        answer: with covariance.
        offset_error_s: the offset taken, less the true one: the sightings' times are early by it.
    """
    first, last_s = found.sightings[0], answer.t_s + offset_error_s
    first_s = first.t_s + offset_error_s
    camera = flight.true_camera(first_s).position_enu_m
    shift = camera - np.array(first.position_enu_m)
    at_first, at_last = flight.target(first_s), flight.target(last_s)
    depth = float(np.linalg.norm((at_first - camera)[:2]))
    error = (answer.position_enu_m + shift - at_last)[:2]
    sight = (at_last - flight.true_camera(last_s).position_enu_m)[:2]
    sight = sight / np.linalg.norm(sight)
    covariance = answer.covariance
    assert covariance is not None
    return FlightScore(
        depth_error=answer.depth_m / depth - 1.0,
        position_error_m=float(np.linalg.norm(error)),
        bearing_error_m=float(error @ [sight[1], -sight[0]]),
        range_error_m=float(error @ sight),
        nees=float(error @ np.linalg.solve(covariance[:2, :2], error)),
        sigma_m=math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1])),
    )


def rotation_error(
    flight: RenderedFlight, followed: Replay, pose_at: PoseAt, offset_s: float, steadied: BundleSolution | None = None
) -> RotationError:
    """How well poses follow the camera's rotation over the pattern.

    Args:
        flight: what was flown.
        followed: its frames.
        pose_at: the aircraft's pose at a time of the telemetry's clock.
        offset_s: of the video, as it is taken to be.
        steadied: the poses by the background, where they shall be looked at instead.
    """
    by_frame = {} if steadied is None else {pose.t_s: pose for pose in steadied.poses}
    errors: list[Vector] = []
    first: Rotation | None = None
    for seen in followed.tracked:
        told: Rotation | None = None
        if by_frame:
            frame = by_frame.get(seen.track.t_s)
            told = None if frame is None else Rotation.from_matrix(frame.world_from_camera)
        else:
            pose = pose_at(seen.track.t_s - offset_s)
            told = None if pose is None else world_from_camera(pose, flight.camera)
        if told is None:
            continue
        error = told * Rotation.from_matrix(flight.true_camera(seen.capture_s).world_from_camera).inv()
        first = first or error
        errors.append((error * first.inv()).as_rotvec())
    if not errors:
        return RotationError(math.nan, math.nan)
    east, north, up = np.sqrt(np.mean(np.square(errors), axis=0)).tolist()
    return RotationError(up, math.sqrt(0.5 * (east**2 + north**2)))
