"""What can be expected of a pattern before it is flown: the Cramer-Rao bound for the worst that the target may do.

The heading is kept on the target, and the camera's tilt is the one that has it in the middle when the pattern starts;
frames in which a walking target has left the picture above or below count for nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from mission.errors import EstimateRefused
from mission.estimate.bound import bound
from mission.planning.aim import PRESUMED_HEIGHT_M
from mission.planning.pattern import lateral_path
from mission.records import CameraIntrinsics, Matrix, NoiseModel, TargetPrior, Vector
from mission.settings import PatternSettings

PEAK_SPEED, PEAK_ACCELERATION = 1.875, 10.0 / math.sqrt(3.0)
"""Of a minimum-jerk leg: over length / time, and over length / time^2."""
DIRECTIONS = 8
WALKING_PSD_M2_S3 = 0.006
"""How the velocity of a walking person wanders, in the middle of many: more baseline in less time is what helps."""
_SEARCH_RATE_HZ, _SEARCH_SIGHTINGS = 10.0, 120
"""While searching frames are left out: errors correlated over 0.3 s make them nearly worthless. Never too good."""
_NEAREST_M = 0.5
"""A target that is nearer than this, or out of the picture above or below, is not seen."""


@dataclass(frozen=True, slots=True)
class Outlook:
    """What is guessed of the target, and how it will be seen."""

    distance_m: float
    """Horizontal, from the pattern's start."""
    camera: CameraIntrinsics
    noise: NoiseModel = field(default_factory=NoiseModel)
    prior: TargetPrior = field(default_factory=TargetPrior)
    walk_m_s: float = 1.0
    rate_hz: float = 20.0
    """Sightings per second."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A pattern and what can be expected of it: 1-sigma of the horizontal distance at the first sighting."""

    pattern: PatternSettings
    time_s: float
    peak_speed_m_s: float
    standing_sigma_m: float
    worst_sigma_m: float
    """Over standing and walking in eight directions."""
    worst_walk_m_s: tuple[float, float]
    """The walk of the worst case: to the right, and away."""


class Judge:
    """Judges patterns by their worst case: the target stands, or walks in one of eight directions.

    Args:
        outlook: the target and how it is seen.
        height_m: of the camera above the target's ground.
    """

    def __init__(self, outlook: Outlook, height_m: float) -> None:
        told = outlook.prior.acceleration_psd_m2_s3
        wander = replace(outlook.prior, acceleration_psd_m2_s3=told if told > 0.0 else WALKING_PSD_M2_S3)
        self._outlook = replace(outlook, prior=wander)
        self._target_m = np.array([0.0, outlook.distance_m, 0.5 * PRESUMED_HEIGHT_M - height_m])
        self._half_view = math.atan(outlook.camera.height_px / (2.0 * outlook.camera.fy))
        self._walks = _walks(outlook.walk_m_s)
        self._order = list(range(len(self._walks)))
        """The walk that decided last comes first: it mostly decides again."""

    def worst(self, pattern: PatternSettings, limit_m: float) -> float:
        """Sigma of the worst case, from fewer frames; infinite as soon as one case exceeds the limit."""
        rate = self._outlook.rate_hz
        thinning = math.ceil(max(rate / _SEARCH_RATE_HZ, rate * duration_s(pattern) / _SEARCH_SIGHTINGS, 1.0))
        t_s, camera_m = sampled(pattern, rate / thinning)
        worst = 0.0
        for place, walk in enumerate(self._order):
            worst = max(worst, self._sigma(t_s, camera_m, walk))
            if not worst <= limit_m:
                self._order.insert(0, self._order.pop(place))
                return math.inf
        return worst

    def expected(self, pattern: PatternSettings) -> Plan | None:
        """What can be expected, from every frame; None where something is not determined."""
        t_s, camera_m = sampled(pattern, self._outlook.rate_hz)
        sigmas = [self._sigma(t_s, camera_m, walk) for walk in range(len(self._walks))]
        worst = int(np.argmax(sigmas))
        if not math.isfinite(sigmas[worst]):
            return None
        right, away = self._walks[worst].tolist()
        return Plan(pattern, duration_s(pattern), peak_speed_m_s(pattern), sigmas[0], sigmas[worst], (right, away))

    def _sigma(self, t_s: Vector, camera_m: Matrix, walk: int) -> float:
        """The bound for one walk; infinite where the pattern does not determine the target."""
        outlook = self._outlook
        velocity = np.append(self._walks[walk], 0.0)
        line = self._target_m + np.outer(t_s, velocity) - camera_m
        across = np.hypot(line[:, 0], line[:, 1])
        elevation = np.arctan2(line[:, 2], across)
        seen = (across > _NEAREST_M) & (np.abs(elevation - elevation[0]) < self._half_view)
        try:
            return bound(
                t_s[seen], camera_m[seen], self._target_m, velocity, outlook.camera, outlook.noise, outlook.prior
            ).depth_sigma_m
        except EstimateRefused:
            return math.inf


def sampled(pattern: PatternSettings, rate_hz: float) -> tuple[Vector, Matrix]:
    """Times (n,) and camera positions (n, 3; right, away, up) of the frames of a pattern, target straight ahead."""
    knots = lateral_path(pattern, 0.0).knots
    path = CubicHermiteSpline(
        [knot.t_s for knot in knots],
        [knot.offset_enu_m for knot in knots],
        [knot.velocity_enu_m_s for knot in knots],
    )
    t_s = np.arange(math.floor(knots[-1].t_s * rate_hz + 1e-9) + 1) / rate_hz
    return t_s, np.asarray(path(t_s), dtype=float)


def _walks(speed_m_s: float) -> Matrix:
    """Standing first, then the directions, (k, 2)."""
    if speed_m_s == 0.0:
        return np.zeros((1, 2))
    angles = 2.0 * math.pi / DIRECTIONS * np.arange(DIRECTIONS)
    return np.vstack((np.zeros(2), speed_m_s * np.column_stack((np.sin(angles), np.cos(angles)))))


def duration_s(pattern: PatternSettings) -> float:
    """Time that an out-and-back or S pattern takes."""
    lengths = 2.0 if pattern.kind == "out-and-back" else 2.0 + math.sqrt(2.0)
    return pattern.passes * lengths * pattern.leg_duration_s


def peak_speed_m_s(pattern: PatternSettings) -> float:
    """Largest speed of an out-and-back or S pattern."""
    steepest = 1.0 if pattern.kind == "out-and-back" else math.sqrt(2.0)
    return PEAK_SPEED * steepest * pattern.length_m / pattern.leg_duration_s
