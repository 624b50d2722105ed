import math

import numpy as np
import pytest

from mission.camera import Mounting
from mission.camera.mounting import rotation, wxyz
from tests.support.panorama import level_pose, world_from_body


def test_a_level_camera_looks_ahead_with_its_x_to_the_right() -> None:
    turned = Mounting.tilted(0.0).body_from_camera
    np.testing.assert_allclose(turned.apply([0, 0, 1]), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(turned.apply([1, 0, 0]), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(turned.apply([0, 1, 0]), [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("tilt_deg", [-10.0, 0.0, 20.0, 90.0])
def test_a_tilted_camera_looks_down_by_its_tilt(tilt_deg: float) -> None:
    mounting = Mounting.tilted(math.radians(tilt_deg))
    forward, right, down = mounting.body_from_camera.apply([0, 0, 1])
    assert math.degrees(math.atan2(down, forward)) == pytest.approx(tilt_deg)
    assert right == pytest.approx(0.0)
    assert math.degrees(mounting.tilt_down_rad) == pytest.approx(tilt_deg)


def test_flying_east_the_camera_looks_east_and_its_x_points_south() -> None:
    pose = level_pose(0.0, np.array(wxyz(world_from_body(math.pi / 2, 0.0, 0.0))))
    seen = rotation(Mounting.tilted(0.0).world_from_camera_wxyz(pose))
    np.testing.assert_allclose(seen.apply([0, 0, 1]), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(seen.apply([1, 0, 0]), [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(seen.apply([0, 1, 0]), [0, 0, -1], atol=1e-12)


def test_the_lever_arm_turns_with_the_aircraft() -> None:
    pose = level_pose(0.0, np.array(wxyz(world_from_body(math.pi / 2, 0.0, 0.0))))
    place = Mounting.tilted(0.0, (0.2, 0.0, 0.05)).position_enu_m(pose)
    np.testing.assert_allclose(place, [0.2, 0.0, -0.05], atol=1e-12)
