import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mission.camera import Mounting
from mission.pose.buffer import Pose
from mission.records import Box
from mission.sighting import azimuth_of, camera_position, roll_of, rotation_shift, sighting, world_from_camera
from mission.track import Track
from tests.support.fakes import CAMERA, ENU_FROM_NED


def pose(heading: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Pose:
    world_from_body = ENU_FROM_NED * Rotation.from_euler("ZYX", [heading, pitch, roll])
    return Pose(
        5.0,
        np.array([10.0, 20.0, 3.0]),
        np.zeros(3),
        world_from_body.as_quat(scalar_first=True),
        np.eye(3),
        np.eye(3),
    )


CENTRE = (320.0, 240.0)


def test_a_level_camera_on_a_drone_that_points_north_looks_north() -> None:
    np.testing.assert_allclose(world_from_camera(pose(), CAMERA).apply([0.0, 0.0, 1.0]), [0.0, 1.0, 0.0], atol=1e-12)


def test_the_pictures_right_is_east_when_looking_north_and_its_down_is_down() -> None:
    turn = world_from_camera(pose(), CAMERA)
    np.testing.assert_allclose(turn.apply([1.0, 0.0, 0.0]), [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(turn.apply([0.0, 1.0, 0.0]), [0.0, 0.0, -1.0], atol=1e-12)


def test_a_tilted_camera_looks_down_by_its_tilt() -> None:
    tilted = replace(CAMERA, mounting=Mounting.tilted(math.radians(30.0)))
    axis = world_from_camera(pose(), tilted).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(axis, [0.0, math.cos(math.radians(30)), -math.sin(math.radians(30))], atol=1e-12)


def test_the_camera_sits_where_it_is_mounted() -> None:
    nose = replace(CAMERA, mounting=Mounting.tilted(0.0, (0.2, 0.1, 0.05)))
    np.testing.assert_allclose(camera_position(pose(heading=math.pi / 2), nose), [10.2, 19.9, 2.95], atol=1e-12)


@given(st.floats(-3.1, 3.1))
def test_the_image_centre_of_a_level_camera_lies_at_the_heading(heading: float) -> None:
    assert math.cos(azimuth_of(CENTRE, pose(heading), CAMERA) - heading) == pytest.approx(1.0, abs=1e-12)


def test_a_pixel_to_the_right_lies_clockwise() -> None:
    right = (320.0 + 516.5 * math.tan(0.2), 240.0)
    assert azimuth_of(right, pose(0.5), CAMERA) == pytest.approx(0.7)


def test_turning_right_moves_the_picture_left() -> None:
    x, y = rotation_shift(CENTRE, pose(0.0), pose(0.1), CAMERA)
    assert x == pytest.approx(-516.5 * math.tan(0.1))
    assert y == pytest.approx(0.0, abs=1e-9)


def test_a_turn_that_puts_the_point_behind_the_camera_predicts_nothing() -> None:
    assert rotation_shift(CENTRE, pose(0.0), pose(2.0), CAMERA) == (0.0, 0.0)


def test_a_sighting_carries_the_cameras_pose_and_the_tracks_figures() -> None:
    track = Track(7, 5.0, "tracking", Box(300, 180, 40, 120), (321.5, 242.0), 1.2, 118.0, 0.03, 0.9)
    seen = sighting(track, 5.01, pose(), CAMERA)
    assert seen.t_s == 5.01
    assert seen.position_enu_m == pytest.approx((10.0, 20.0, 3.0))
    assert seen.pixel == (321.5, 242.0)
    assert (seen.height_px, seen.pixel_sigma_px, seen.size_sigma) == (118.0, 1.2, 0.03)
    assert np.linalg.norm(seen.world_from_camera_wxyz) == pytest.approx(1.0)


@given(st.floats(-0.6, 0.6), st.floats(-3.0, 3.0))
def test_the_cameras_roll_is_the_aircrafts_where_it_looks_ahead(roll: float, heading: float) -> None:
    assert roll_of(pose(heading, 0.0, roll), CAMERA) == pytest.approx(roll, abs=1e-9)
