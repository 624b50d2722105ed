"""An answer beside the truth.

An answer is in the aircraft's own frame: its reported position may be metres off as a whole (GNSS), in which case the
answer is too, and no camera could tell. So the errors here are relative to the camera: the estimated vector from where
the camera was reported to be at the first sighting, against the true vector from where it was. The offset of the whole
is given beside them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mission.errors import AnswerError
from mission.geodesy import geodetic_to_enu
from mission.records import GeodeticOrigin, Matrix, Vector
from sitl.aircraft.truth import TruthRing
from sitl.people.world import World
from sitl.scenario.schema import Scenario

ELLIPSE_95 = -2.0 * math.log(0.05)
"""The 95th percentile of the chi-square distribution with two degrees of freedom."""


@dataclass(frozen=True, slots=True)
class Score:
    """Errors of one answer; positions in metres, horizontal unless said otherwise."""

    depth_m: float
    depth_truth_m: float
    depth_error_pct: float
    """Equation (9) of the paper, at the first sighting."""
    position_error_m: float
    """At the last sighting, relative to the camera's own position error."""
    position_error_pct: float
    """Equation (10) of the paper: at the first sighting, in percent of the true depth."""
    height_error_m: float
    velocity_error_m_s: float
    nees: float
    """Squared error of the final horizontal position in units of its covariance (2 degrees of freedom)."""
    inside_95: bool
    """Whether the 95 % ellipse of the final position contains the truth."""
    sigma_m: float
    """Semi-major axis (1 sigma) of the final position's ellipse."""
    site_offset_m: float
    """How far off the reported camera position was at the first sighting."""
    truth_enu_m: tuple[float, float, float]
    """The target at the last sighting, around the scenario's home."""
    truth_velocity_enu_m_s: tuple[float, float, float]
    earth_error_m: float | None = None
    """How far the place on the earth that was told is from the true one, at the last sighting; the aircraft's own
    position error is in it. None for an answer in a local frame."""
    ce90_m: float | None = None
    """What was told with it: the circle that holds the true place in 90 % of flights."""


def score(
    scenario: Scenario,
    ring: TruthRing,
    answer: Mapping[str, object],
    first_camera_enu_m: Vector,
    origin: GeodeticOrigin,
) -> Score:
    """Compare an answer with the truth.

    Args:
        scenario: what was flown; its first person is the target.
        ring: the true flight.
        answer: the output record of the sightings format.
        first_camera_enu_m: reported camera position of the first sighting, shape (3,), around `origin`.
        origin: of the answer's frame.

    Raises:
        AnswerError: the answer holds at a time of which no truth is known.
    """
    first = _table(answer["first"])
    first_s, last_s = _number(first["t_s"]), _number(answer["t_s"])
    world = World(scenario)
    started_s, scene_s = ring.mark(0), ring.mark(1)
    camera = _true_camera(scenario, ring, first_s)
    target_first = world.person_centroid(0, first_s, started_s, scene_s)
    target_last = world.person_centroid(0, last_s, started_s, scene_s)
    velocity = world.person_velocity(0, last_s, started_s, scene_s)

    depth_truth = float(np.linalg.norm((target_first - camera)[:2]))
    depth = _number(answer["depth_m"])
    error_first = (_vector(first["position_enu_m"]) - first_camera_enu_m) - (target_first - camera)
    error_last = (_vector(answer["position_enu_m"]) - first_camera_enu_m) - (target_last - camera)
    covariance = np.array(answer["covariance"], dtype=np.float64)[:2, :2]
    nees = float(error_last[:2] @ np.linalg.solve(covariance, error_last[:2]))
    shift = geodetic_to_enu(origin.lat_deg, origin.lon_deg, scenario.home.alt_m, scenario.home.origin)
    return Score(
        depth_m=depth,
        depth_truth_m=depth_truth,
        depth_error_pct=100.0 * abs(depth - depth_truth) / depth_truth,
        position_error_m=float(np.linalg.norm(error_last[:2])),
        position_error_pct=100.0 * float(np.linalg.norm(error_first[:2])) / depth_truth,
        height_error_m=float(error_last[2]),
        velocity_error_m_s=float(np.linalg.norm((_vector(answer["velocity_enu_m_s"]) - velocity)[:2])),
        nees=nees,
        inside_95=nees <= ELLIPSE_95,
        sigma_m=float(np.sqrt(np.linalg.eigvalsh(covariance)[-1])),
        site_offset_m=float(np.linalg.norm((first_camera_enu_m + shift - camera)[:2])),
        truth_enu_m=_triple(target_last),
        truth_velocity_enu_m_s=_triple(velocity),
    )


def earth_error_m(scenario: Scenario, found: Score, lat_deg: float, lon_deg: float) -> float:
    """Horizontal distance from a place on the earth (WGS84 degrees) to the true one, m."""
    home = scenario.home
    told = geodetic_to_enu(lat_deg, lon_deg, home.alt_m, home.origin)
    return float(np.linalg.norm(told[:2] - np.array(found.truth_enu_m[:2])))


def truth_track(
    scenario: Scenario, ring: TruthRing, first_s: float, last_s: float, first_camera_enu_m: Vector
) -> Matrix:
    """Where the target really was, in the frame of the answer.

    Args:
        scenario: what was flown; its first person is the target.
        ring: the true flight.
        first_s: time of the first sighting.
        last_s: time of the last one.
        first_camera_enu_m: reported camera position of the first sighting, shape (3,): the answer's frame is moved
            so that this is where the camera truly was.

    Returns:
        Rows of time, east, north, up; shape (n, 4).
    """
    world = World(scenario)
    shift = first_camera_enu_m - _true_camera(scenario, ring, first_s)
    times = np.linspace(first_s, last_s, 60)
    places = [world.person_centroid(0, float(t_s), ring.mark(0), ring.mark(1)) + shift for t_s in times]
    return np.column_stack([times, places])


def _true_camera(scenario: Scenario, ring: TruthRing, t_s: float) -> Vector:
    truth = ring.at(t_s)
    if truth is None:
        raise AnswerError(f"the truth of {t_s:.1f} s is not known", "The answer and the simulator disagree about time.")
    body = Rotation.from_quat(truth.world_from_body_wxyz, scalar_first=True)
    return np.asarray(truth.position_enu_m + body.apply(np.array(scenario.camera.position_body_m)))


def _table(value: object) -> Mapping[str, object]:
    if not isinstance(value, dict):
        raise AnswerError("the answer has no first position", "The method batch gives one.")
    return value


def _number(value: object) -> float:
    if not isinstance(value, int | float):
        raise AnswerError(f"the answer holds {value!r} where a number is expected")
    return float(value)


def _vector(value: object) -> Vector:
    return np.array(value, dtype=np.float64)


def _triple(vector: Vector) -> tuple[float, float, float]:
    east, north, up = vector.tolist()
    return east, north, up
