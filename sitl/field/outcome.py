"""A field flight's answer held to the truth."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from mission.camera.model import CameraModel
from mission.errors import DetectionError, EstimateRefused
from mission.estimate import ESTIMATORS
from mission.estimate.noise_fit import with_fitted_noise
from mission.pose.buffer import Pose
from mission.records import FlightSightings, TargetPrior, Vector
from mission.track import Tracker
from sitl.field.case import FieldCase
from sitl.field.flight import FieldFlight, FieldFollowed, follow
from sitl.simulation.score import ELLIPSE_95

_BODY_MIDDLE_M = 0.9
"""What a map's single ray takes for the height of a person's middle over flat ground."""
_MIDDLE_QUARTER = 0.5
"""The middle quarter of a picture's area: half of its width and half of its height."""


@dataclass(frozen=True, slots=True)
class FieldOutcome:
    """One flight. Errors are NaN where there is no answer."""

    seed: int
    height_m: float
    slant_m: float
    walks: str
    noise: str
    tells: str
    bias_deg: float
    """True, of the gimbal's yaw: its own, and the compass's where it is from the nose."""
    height_px: float = math.nan
    """Median apparent height of the person."""
    tracked_share: float = 0.0
    centred_share: float = 0.0
    """Of the pattern's frames, those with the person in the middle quarter."""
    steadied: bool = False
    slant_error: float = math.nan
    """Relative, of the last place's distance from the lens, beside the lens's own position error."""
    nees: float = math.nan
    """Of the last horizontal position, 2 degrees of freedom, beside the lens's own position error."""
    place_error_m: float = math.nan
    """Horizontal, on the earth: with the lens's own position error."""
    sigma_m: float = math.nan
    north_error_deg: float = math.nan
    """Of the heading bias that the flight found."""
    north_sigma_deg: float = math.nan
    single_ray_error: float = math.nan
    """Relative slant error of one ray on flat ground, from the first sighting with the gimbal's own attitude."""
    seconds: float = 0.0
    said: str = ""

    @property
    def answered(self) -> bool:
        """Whether there is an answer."""
        return math.isfinite(self.nees)

    @property
    def inside(self) -> bool:
        """Whether the 95 % ellipse holds the truth."""
        return self.nees <= ELLIPSE_95


def fly_case(case: FieldCase) -> FieldOutcome:
    """Fly, estimate and score one case."""
    begun_s = time.monotonic()
    flight = FieldFlight(case)
    basis = FieldOutcome(
        case.seed, case.height_m, case.slant_m, case.walks or "stands", case.noise, case.gimbal.tells, math.nan
    )
    try:
        followed = follow(flight, Tracker())
        outcome = _answered(flight, followed, basis)
    except (DetectionError, EstimateRefused) as error:
        outcome = replace(basis, said=error.cause)
    return replace(outcome, seconds=time.monotonic() - begun_s)


def _answered(flight: FieldFlight, followed: FieldFollowed, basis: FieldOutcome) -> FieldOutcome:
    offset_s = 0.0 if followed.offset is None else followed.offset.offset_s
    noise = followed.pose_noise(flight.noise)
    frames = max(1, len(followed.centred))
    bias = _bias_rad(flight)
    basis = replace(
        basis,
        bias_deg=math.degrees(bias),
        height_px=float(np.median(followed.heights_px)) if followed.heights_px else math.nan,
        tracked_share=followed.tracked / frames,
        centred_share=sum(one <= _MIDDLE_QUARTER for one in followed.centred) / frames,
    )

    def pose_at(t_s: float) -> Pose | None:
        return flight.pose_at(t_s)

    steadied = followed.record.steadied(pose_at, offset_s, noise)
    basis = replace(basis, steadied=steadied.reason is None, said=steadied.note())
    if steadied.reason is None:
        north_deg = math.degrees(steadied.north_rad - bias), math.degrees(steadied.north_sigma_rad)
        basis = replace(basis, north_error_deg=north_deg[0], north_sigma_deg=north_deg[1])
    reported = followed.record.sightings(flight.origin, pose_at, offset_s, noise, TargetPrior())
    stated = followed.record.sightings(flight.origin, pose_at, offset_s, noise, TargetPrior(), steadied)
    found = with_fitted_noise(stated, steadied=steadied.reason is None)
    ray = _single_ray(flight, reported, offset_s - flight.case.offset_s) if reported.sightings else math.nan
    basis = replace(basis, single_ray_error=ray)
    try:
        answer = ESTIMATORS["batch"].estimate(found)
    except EstimateRefused as refused:
        return replace(basis, said=refused.cause)
    last = found.sightings[-1]
    late_s = offset_s - flight.case.offset_s
    lens, target = flight.true_camera(last.t_s + late_s).position_enu_m, flight.target(answer.t_s + late_s)
    shift = lens - np.array(last.position_enu_m)
    error = answer.position_enu_m + shift - target
    covariance = answer.covariance
    assert covariance is not None
    return replace(
        basis,
        slant_error=float(np.linalg.norm(answer.position_enu_m + shift - lens) / np.linalg.norm(target - lens) - 1.0),
        nees=float(error[:2] @ np.linalg.solve(covariance[:2, :2], error[:2])),
        place_error_m=float(np.linalg.norm((answer.position_enu_m - target)[:2])),
        sigma_m=math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1])),
    )


def _bias_rad(flight: FieldFlight) -> float:
    """By how much the lens's reported heading is off, clockwise, in the middle of the pattern."""
    off = []
    for t_s in np.linspace(0.1, flight.duration_s - 0.3, 9).tolist():
        told = flight.gimbal.at(t_s)
        if told is not None:
            off.append(math.remainder(_azimuth(told) - _azimuth(flight.gimbal.true_at(t_s)), 2.0 * math.pi))
    return float(np.median(off)) if off else math.nan


def _azimuth(world_from_gimbal_wxyz: Vector) -> float:
    w, x, y, z = world_from_gimbal_wxyz.tolist()
    return math.atan2(w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z))


def _single_ray(flight: FieldFlight, reported: FlightSightings, late_s: float) -> float:
    """Relative slant error of the last sighting's ray on flat ground."""
    last = reported.sightings[-1]
    ray = Rotation.from_quat(last.world_from_camera_wxyz, scalar_first=True).apply(
        CameraModel(flight.camera.intrinsics).ray(np.array(last.pixel))
    )
    if ray[2] >= -1e-3:
        return math.inf
    slant = (last.position_enu_m[2] - _BODY_MIDDLE_M) / -ray[2] * float(np.linalg.norm(ray))
    t_s = last.t_s + late_s
    true = float(np.linalg.norm(flight.target(t_s) - flight.true_camera(t_s).position_enu_m))
    return float(slant / true - 1.0)
