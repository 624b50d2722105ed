"""The gimbal is kept on the target where it is ours; else the nose is turned, by the target's azimuth alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
import pytest

from mission.camera import Camera
from mission.camera.model import CameraModel
from mission.pose.buffer import Pose, world_from_body
from mission.procedure.pointing import Pointing, TargetTracker
from mission.records import Box, Frame, Vector
from mission.sighting import world_from_camera
from mission.track import Track
from mission.vehicle.drone import Drone

CAMERA = replace(Camera.from_field_of_view(640, 480, 1.1), gimbal="mavlink")
TARGET = np.array([20.0, 30.0, 0.9])
UP_M = 20.0


@dataclass
class Gimbal:
    """Goes at once where it is told, but for an error of its own."""

    ours: bool = True
    lost: str = ""
    off_rad: float = 0.0
    azimuth: float = 0.3
    elevation: float = -0.3

    def take(self) -> str:
        return ""

    def release(self) -> None: ...

    def point(self, azimuth_rad: float, elevation_rad: float) -> None:
        self.azimuth, self.elevation = azimuth_rad + self.off_rad, elevation_rad


@dataclass
class Carrier:
    gimbal: Gimbal
    aimed: list[float] = field(default_factory=list)
    nose: float = 1.0

    def pose_at(self, t_s: float) -> Pose | None:
        turned = world_from_body(0.0, self.gimbal.elevation, self.gimbal.azimuth)
        body = world_from_body(0.2, 0.1, self.nose)
        place = np.array([2.0 * math.sin(0.2 * t_s), 0.0, UP_M])
        return Pose(t_s, place, np.zeros(3), body, np.eye(3), np.eye(3), turned)

    def aim(self, heading_rad: float) -> None:
        self.aimed.append(heading_rad)


@dataclass
class Seeing:
    """Sees the target where it truly is."""

    carrier: Carrier

    def update(self, frame: Frame, *_: object) -> Track:
        pose = self.carrier.pose_at(frame.t_s)
        assert pose is not None
        x, y = pixel(pose).tolist()
        return Track(
            frame.index, frame.t_s, "tracking", Box(x - 8.0, y - 20.0, 16.0, 40.0), (x, y), 1.0, 40.0, 0.04, 1.0
        )


def pixel(pose: Pose) -> Vector:
    ray = world_from_camera(pose, CAMERA).inv().apply(TARGET - pose.position_enu_m)
    return np.asarray(CameraModel(CAMERA.intrinsics).project(ray))


def flown(gimbal: Gimbal, seconds: float = 8.0) -> tuple[Carrier, float]:
    """The carrier, and how far off the middle the target is at the end, pixels."""
    carrier = Carrier(gimbal)
    pointing = Pointing(cast(Drone, carrier), CAMERA, cast(TargetTracker, Seeing(carrier)), cautious=False)
    image = np.zeros((480, 640, 3), np.uint8)
    for k in range(round(15 * seconds)):
        pointing.follow(Frame(image, k / 15.0, k))
        pointing.steer(k / 15.0)
    pose = carrier.pose_at(seconds)
    assert pose is not None
    return carrier, float(np.linalg.norm(pixel(pose) - [320.0, 240.0]))


def test_the_target_is_brought_to_the_middle_in_both_axes() -> None:
    carrier, off_px = flown(Gimbal())
    assert off_px < 12.0
    assert carrier.aimed == []


def test_an_idea_of_north_of_its_own_is_trimmed_away() -> None:
    _, off_px = flown(Gimbal(off_rad=math.radians(15.0)), 14.0)
    assert off_px < 15.0


@pytest.mark.parametrize("lost", ["component 190 of system 255 took the gimbal"])
def test_a_gimbal_that_is_not_ours_is_not_pointed(lost: str) -> None:
    gimbal = Gimbal(ours=False, lost=lost)
    carrier, _ = flown(gimbal)
    assert (gimbal.azimuth, gimbal.elevation) == (0.3, -0.3)
    assert math.degrees(carrier.aimed[-1]) == pytest.approx(math.degrees(math.atan2(20.0, 30.0)), abs=6.0)
