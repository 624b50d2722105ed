"""Scores of rendered flights: a perfect tracker on true poses makes no errors, wrong times and poses make theirs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mission.pose.buffer import Pose
from mission.procedure.flight_record import FlightRecord, Seen
from mission.timing.time_offset import TimeOffset
from mission.track import Track
from sitl.camera.view import view_person
from sitl.evaluation.rendered import Case, RenderedFlight
from sitl.evaluation.rendered.replay import Replay, Tracked
from sitl.evaluation.rendered.scenes import WALKED_S
from sitl.evaluation.rendered.score import estimate, rotation_error, score, sightings

LATE_S = 0.2


@pytest.fixture(scope="module")
def flight() -> RenderedFlight:
    return RenderedFlight(Case(seed=9, noise="none", distance_m=6.0, walk_deg=60.0, offset_s=LATE_S))


@pytest.fixture(scope="module")
def followed(flight: RenderedFlight) -> Replay:
    """A tracker that makes no mistakes, on frames that are never rendered."""
    record = FlightRecord("exact", flight.camera, interval_s=1e9)
    exact = Replay(record, TimeOffset(LATE_S, 0.001, 0.3, 1.0))
    for k in range(round(20.0 * flight.duration_s)):
        t_s = k / 20.0
        # Seen where its row is exposed, as a rolling shutter sees it.
        seen = view_person(flight.world, 0, flight.true_camera(t_s), flight.camera.intrinsics, t_s, -WALKED_S)
        assert seen is not None
        row_s = flight.camera.row_time_s(t_s, seen.pixel[1])
        seen = view_person(flight.world, 0, flight.true_camera(row_s), flight.camera.intrinsics, row_s, -WALKED_S)
        assert seen is not None
        height = flight.camera.intrinsics.fy * 1.75 / seen.depth_m
        track = Track(k, t_s + LATE_S, "tracking", seen.box, seen.pixel, 1.0, height, 0.03, 1.0)
        record.seen.append(Seen(t_s + LATE_S, track))
        exact.tracked.append(Tracked(t_s, track, seen))
    return exact


def _turned(pose: Pose | None, heading_rad: float) -> Pose | None:
    if pose is None:
        return None
    turn = Rotation.from_rotvec([0.0, 0.0, -heading_rad])
    body = turn * Rotation.from_quat(pose.world_from_body_wxyz, scalar_first=True)
    return replace(pose, world_from_body_wxyz=body.as_quat(scalar_first=True))


def test_a_perfect_tracker_on_true_poses_finds_the_person(flight: RenderedFlight, followed: Replay) -> None:
    found = sightings(flight, followed, flight.true_pose, LATE_S)
    answer = estimate(found)
    errors = score(flight, found, answer, 0.0)
    assert abs(errors.depth_error) < 0.02
    assert errors.position_error_m < 0.2
    assert errors.inside
    assert math.hypot(errors.bearing_error_m, errors.range_error_m) == pytest.approx(errors.position_error_m)


def test_a_target_elsewhere_is_an_error_along_and_across_the_line_of_sight(
    flight: RenderedFlight, followed: Replay
) -> None:
    found = sightings(flight, followed, flight.true_pose, LATE_S)
    answer = estimate(found)
    exact = score(flight, found, answer, 0.0)
    sight = flight.target(answer.t_s) - flight.true_camera(answer.t_s).position_enu_m
    sight[2] = 0.0
    sight /= np.linalg.norm(sight)
    beyond = replace(answer, position_enu_m=answer.position_enu_m + 3.0 * sight)
    right = replace(answer, position_enu_m=answer.position_enu_m + 3.0 * np.array([sight[1], -sight[0], 0.0]))
    assert score(flight, found, beyond, 0.0).range_error_m == pytest.approx(exact.range_error_m + 3.0)
    assert score(flight, found, right, 0.0).bearing_error_m == pytest.approx(exact.bearing_error_m + 3.0)
    assert not score(flight, found, beyond, 0.0).inside


def test_a_time_offset_that_is_not_known_widens_the_noise(flight: RenderedFlight, followed: Replay) -> None:
    unknown = replace(followed, offset=None)
    assert unknown.offset_s == 0.0
    assert unknown.pose_noise(flight.noise).heading_sigma_rad > 5.0 * flight.noise.heading_sigma_rad
    assert followed.offset is not None
    measured = followed.pose_noise(flight.noise).heading_sigma_rad
    assert flight.noise.heading_sigma_rad < measured < 1.1 * flight.noise.heading_sigma_rad
    worse = replace(followed, offset=replace(followed.offset, sigma_s=0.03))
    assert worse.pose_noise(flight.noise).heading_sigma_rad > measured


def test_a_constant_turn_is_no_error_relative_to_the_first_frame(flight: RenderedFlight, followed: Replay) -> None:
    turned = rotation_error(flight, followed, lambda t: _turned(flight.true_pose(t), 0.05), LATE_S)
    assert turned.heading_rad < 1e-9
    assert turned.tilt_rad < 1e-9


def test_a_drifting_compass_is_one(flight: RenderedFlight, followed: Replay) -> None:
    drifted = rotation_error(flight, followed, lambda t: _turned(flight.true_pose(t), 0.01 * t), LATE_S)
    assert drifted.heading_rad == pytest.approx(0.01 * flight.duration_s / math.sqrt(3.0), rel=0.05)
    assert drifted.tilt_rad < 1e-3


def test_a_wrong_time_offset_turns_the_camera_too(flight: RenderedFlight, followed: Replay) -> None:
    late = rotation_error(flight, followed, flight.true_pose, LATE_S - 0.1)
    assert late.heading_rad > math.radians(0.3)
