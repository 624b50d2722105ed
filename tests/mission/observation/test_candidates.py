"""Detections become tracks of one person each, and the path flown says what a track can tell."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.camera.camera import Camera
from mission.camera.model import CameraModel
from mission.camera.mounting import Mounting
from mission.observation.candidates import Candidate, Look, candidates
from mission.observation.worth import best_part
from mission.pose.buffer import Pose, PoseAt, world_from_body
from mission.records import Box, Detection, NoiseModel, TargetPrior, Vector
from mission.sighting import camera_position, world_from_camera

EAST = np.array([1.0, 0.0, 0.0])
CAMERA = Camera.from_field_of_view(640, 480, 1.1, Mounting.tilted(math.radians(10.0)))


def flight(velocity: tuple[float, float], turn_rad_s: float = 0.0) -> PoseAt:
    def pose_at(t_s: float) -> Pose | None:
        place = np.array([velocity[0] * t_s, velocity[1] * t_s, 3.0])
        turned = world_from_body(0.0, 0.0, turn_rad_s * t_s)
        return Pose(t_s, place, np.array([*velocity, 0.0]), turned, np.eye(3), np.eye(3) * 1e-4)

    return pose_at


def look(t_s: float, pose_at: PoseAt, *people: Vector) -> Look:
    found = []
    for place in people:
        pose = pose_at(t_s)
        assert pose is not None
        seen = world_from_camera(pose, CAMERA).inv().apply(place - camera_position(pose, CAMERA))
        if seen[2] < 0.5:
            continue
        x, y = CameraModel(CAMERA.intrinsics).project(seen).tolist()
        if 0 < x < 640 and 0 < y < 480:
            height = CAMERA.intrinsics.fy * 1.75 / seen[2]
            found.append(Detection(Box(x - 0.2 * height, y - 0.5 * height, 0.4 * height, height), 0.6))
    return Look(t_s, tuple(found))


def test_two_people_from_a_turning_moving_camera() -> None:
    pose_at = flight((1.0, 0.0), turn_rad_s=-0.06)
    one, two = np.array([-2.0, 12.0, 0.9]), np.array([3.0, 14.0, 0.9])
    looks = [look(t, pose_at, one + 0.4 * t * EAST, two - 0.4 * t * EAST) for t in np.arange(0.0, 6.0, 0.5)]
    found = candidates(looks, pose_at, CAMERA, 0.0)
    assert len(found) == 2
    assert [len(track.looks) for track in found] == [12, 12]
    assert [track.number for track in found] == [1, 2]


def test_one_look_is_nobody() -> None:
    pose_at = flight((0.0, 0.0))
    assert candidates([look(0.0, pose_at, np.array([0.0, 10.0, 0.9])), Look(0.5, ())], pose_at, CAMERA, 0.0) == []


def test_somebody_else_elsewhere_begins_another_track() -> None:
    pose_at = flight((0.0, 0.0))
    left, right = np.array([-4.0, 10.0, 0.9]), np.array([4.0, 10.0, 0.9])
    looks = [look(t, pose_at, left if t < 2.0 else right) for t in np.arange(0.0, 4.0, 0.5)]
    assert [track.last_s for track in candidates(looks, pose_at, CAMERA, 0.0)] == [1.5, 3.5]


def seen_along(pose_at: PoseAt) -> Candidate:
    looks = [look(t, pose_at, np.array([2.0, 12.0, 0.9])) for t in np.arange(0.0, 6.0, 0.5)]
    (track,) = candidates(looks, pose_at, CAMERA, 0.0)
    return track


def out_and_back(t_s: float) -> Pose | None:
    """3 m to the side and back within 6 s."""
    place = np.array([3.0 * math.sin(math.pi * t_s / 6.0), 0.0, 3.0])
    speed = np.array([0.5 * math.pi * math.cos(math.pi * t_s / 6.0), 0.0, 0.0])
    return Pose(t_s, place, speed, world_from_body(0.0, 0.0, 0.0), np.eye(3), np.eye(3) * 1e-4)


def test_out_and_back_tells_the_distance() -> None:
    part = best_part(seen_along(out_and_back), out_and_back, CAMERA, 0.0, NoiseModel(), TargetPrior())
    assert part.lateral == pytest.approx(0.25, abs=0.05)
    assert part.relative_sigma < 0.25


def test_a_slow_straight_pass_may_be_a_walk() -> None:
    """Who is passed at walking speed may as well be near and walk along: there is no turn that tells."""
    pose_at = flight((1.0, 0.0))
    part = best_part(seen_along(pose_at), pose_at, CAMERA, 0.0, NoiseModel(), TargetPrior())
    assert part.lateral == pytest.approx(0.5, abs=0.1)
    assert part.relative_sigma > 0.4


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.1, 0.6)])
def test_hovering_or_flying_straight_in_tells_little(velocity: tuple[float, float]) -> None:
    pose_at = flight(velocity)
    part = best_part(seen_along(pose_at), pose_at, CAMERA, 0.0, NoiseModel(), TargetPrior())
    assert part.lateral < 0.1
    assert part.relative_sigma > 0.3
