"""A camera on a gimbal looks where the gimbal looks, and is carried where the aircraft carries it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mission.bundle import BundleSolution
from mission.bundle.solution import not_adjusted
from mission.camera import Camera, Mounting, read_camera, write_camera
from mission.errors import CalibrationInputError, SettingsError
from mission.pose.buffer import Pose, world_from_body
from mission.records import NoiseModel
from mission.sighting import camera_position, cameras_at, level_mounting, world_from_camera
from mission.vehicle.make import make_drone

FIXED = Camera.from_field_of_view(640, 480, 1.1, Mounting.tilted(0.0, (0.2, 0.0, 0.1)))
GIMBALLED = replace(FIXED, gimbal="mavlink", gimbal_age_s=0.05)


def pose(roll_deg: float, gimbal: tuple[float, float, float] | None) -> Pose:
    body = world_from_body(math.radians(roll_deg), 0.0, math.radians(30.0))
    turned = None if gimbal is None else world_from_body(*np.radians(gimbal))
    return Pose(0.0, np.zeros(3), np.zeros(3), body, np.eye(3), np.eye(3), turned)


def test_the_aircraft_s_bank_does_not_enter() -> None:
    looks = [world_from_camera(pose(roll, (0.0, -30.0, 110.0)), GIMBALLED) for roll in (-20.0, 0.0, 20.0)]
    for look in looks:
        east, north, up = look.apply([0.0, 0.0, 1.0])
        assert math.degrees(math.atan2(east, north)) == pytest.approx(110.0)
        assert math.degrees(math.asin(up)) == pytest.approx(-30.0)


def test_the_lever_arm_turns_with_the_aircraft() -> None:
    place = camera_position(pose(90.0, (0.0, 0.0, 0.0)), GIMBALLED)
    forward = np.array([math.sin(math.radians(30.0)), math.cos(math.radians(30.0)), 0.0])
    right = np.array([forward[1], -forward[0], 0.0])
    assert place == pytest.approx(0.2 * forward - 0.1 * right, abs=1e-9)


def test_a_fixed_camera_is_as_before() -> None:
    one = pose(12.0, (0.0, -30.0, 110.0))
    body = Rotation.from_quat(one.world_from_body_wxyz, scalar_first=True)
    expected = body * FIXED.mounting.body_from_camera
    assert (world_from_camera(one, FIXED).inv() * expected).magnitude() == pytest.approx(0.0, abs=1e-9)


def test_no_attitude_of_the_gimbal_is_never_the_aircraft_s() -> None:
    with pytest.raises(ValueError, match="does not tell the gimbal"):
        cameras_at([pose(0.0, (0.0, 0.0, 0.0)), pose(0.0, None)], GIMBALLED)


def test_the_tilt_of_the_moment_stands_for_a_mounting() -> None:
    assert math.degrees(level_mounting(pose(9.0, (0.0, -35.0, 80.0)), GIMBALLED).tilt_down_rad) == pytest.approx(35.0)
    assert level_mounting(pose(9.0, None), FIXED) is FIXED.mounting


def test_the_camera_file_keeps_it(tmp_path: Path) -> None:
    file = tmp_path / "camera.toml"
    write_camera(file, GIMBALLED)
    read = read_camera(file)
    assert (read.gimbal, read.gimbal_age_s) == ("mavlink", 0.05)


def test_a_tilt_beside_a_gimbal_is_a_mistake(tmp_path: Path) -> None:
    file = tmp_path / "camera.toml"
    write_camera(file, replace(GIMBALLED, mounting=Mounting.tilted(math.radians(20.0))))
    with pytest.raises(CalibrationInputError, match="looks where the gimbal looks"):
        read_camera(file)


def test_an_ardrone_has_no_gimbal() -> None:
    with pytest.raises(SettingsError, match="camera is fixed"):
        make_drone("ardrone://127.0.0.1", camera=GIMBALLED)


def test_north_is_told_where_the_flight_tells_it() -> None:
    base = not_adjusted(NoiseModel(), "")
    found = replace(base, reason=None, north_rad=math.radians(6.0), north_sigma_rad=math.radians(0.5), poses=())
    assert isinstance(found, BundleSolution)
    assert "+6.0 degrees off (+-0.5)" in replace(found, still_share=1.0).note()
    assert "degrees off" not in replace(found, north_rad=math.radians(1.0)).note()
