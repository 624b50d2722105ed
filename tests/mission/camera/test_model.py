import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.camera import CameraModel, from_field_of_view
from mission.records import CameraIntrinsics

WIDE = CameraIntrinsics(640, 480, 420.0, 424.0, 316.0, 246.0, (-0.30, 0.10, 0.001, -0.0005, -0.01))


def test_the_middle_of_an_ideal_picture_looks_along_the_axis() -> None:
    model = CameraModel(from_field_of_view(640, 480, math.radians(70.0)))
    np.testing.assert_allclose(model.ray((320.0, 240.0)), [0.0, 0.0, 1.0], atol=1e-12)


def test_the_outer_edge_is_at_half_the_field_of_view() -> None:
    model = CameraModel(from_field_of_view(640, 480, math.radians(70.0)))
    x, _, z = model.ray((640.0, 240.0))
    assert math.degrees(math.atan2(x, z)) == pytest.approx(35.0)


def test_the_papers_camera_sees_its_object_at_the_edge() -> None:
    model = CameraModel(CameraIntrinsics(640, 480, 516.5, 516.5, 320.0, 240.0))
    assert model.project((0.57, 0.0, 0.92))[0] == pytest.approx(640.0, abs=0.1)


def test_pixels_are_half_a_pixel_above_opencvs() -> None:
    point = np.array([[0.3, -0.2, 2.0]])
    matrix = np.array([[WIDE.fx, 0, WIDE.cx], [0, WIDE.fy, WIDE.cy], [0, 0, 1.0]])
    opencv, _ = cv2.projectPoints(point, np.zeros(3), np.zeros(3), matrix, np.array(WIDE.distortion))
    # With cx, cy in our convention OpenCV's formula gives our pixels: both are shifted alike.
    np.testing.assert_allclose(CameraModel(WIDE).project(point), opencv.reshape(-1, 2), atol=1e-9)
    assert CameraModel(WIDE).matrix[0, 2] == WIDE.cx - 0.5


@given(st.floats(0.0, 640.0), st.floats(0.0, 480.0))
def test_a_ray_projects_back_to_its_pixel(x: float, y: float) -> None:
    model = CameraModel(WIDE)
    np.testing.assert_allclose(model.project(model.ray((x, y))), (x, y), atol=1e-6)


def test_many_at_once_are_the_same_as_one_by_one() -> None:
    model = CameraModel(WIDE)
    pixels = np.random.default_rng(1).uniform((0, 0), (640, 480), (50, 2))
    rays = model.ray(pixels)
    assert rays.shape == (50, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    np.testing.assert_allclose(rays, [model.ray(pixel) for pixel in pixels], atol=1e-12)
    assert model.ray(np.empty((0, 2))).shape == (0, 3)
    assert model.project(np.empty((0, 3))).shape == (0, 2)


@pytest.mark.parametrize("point", [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (math.nan, 0.0, 1.0)])
def test_a_point_that_cannot_be_seen_is_refused(point: tuple[float, float, float]) -> None:
    model = CameraModel(WIDE)
    assert not model.in_reach(point)
    with pytest.raises(ValueError, match="behind the camera"):
        model.project(np.array([point, (0.0, 0.0, 1.0)]))


def test_a_point_beyond_the_fold_of_the_distortion_is_out_of_reach() -> None:
    lens = CameraIntrinsics(640, 480, 500.0, 500.0, 320.0, 240.0, (-0.3, 0.0, 0.0, 0.0, 0.0))
    model = CameraModel(lens)
    assert model.max_radius == pytest.approx(math.sqrt(1 / 0.9))
    assert model.in_reach((0.3, 0.0, 1.0))
    assert not model.in_reach((1.8, 0.0, 1.0))  # the polynomial alone would put it at x = 345 px


def test_no_ray_leads_to_a_pixel_that_the_lens_does_not_reach() -> None:
    lens = CameraIntrinsics(640, 480, 250.0, 250.0, 320.0, 240.0, (-0.3, 0.0, 0.0, 0.0, 0.0))
    assert np.isnan(CameraModel(lens).ray((0.0, 0.0))).all()


@pytest.mark.parametrize("angle", [0.0, -1.0, math.pi, math.nan])
def test_an_impossible_field_of_view_is_refused(angle: float) -> None:
    with pytest.raises(ValueError, match="field of view"):
        from_field_of_view(640, 480, angle)
