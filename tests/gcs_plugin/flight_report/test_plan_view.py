"""The plan view draws what there is, north up and to scale."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs_plugin.flight_report.plan_view import RAYS, TRUTH, _rays, plan_view
from mission.camera.model import CameraModel, from_field_of_view
from mission.records import FlightSightings, Image, Matrix, Sighting, Vector
from tests.support.sample import ORIGIN, estimate

CAMERA = from_field_of_view(640, 480, 1.1)


def flight(count: int = 61, target: tuple[float, float, float] = (0.1, 9.0, 0.9)) -> FlightSightings:
    """Sightings of a standing target from a path to the west and back; the camera looks north-west of it."""
    sightings = []
    for i in range(count):
        position = np.array([-4.0 * np.sin(np.pi * i / max(count - 1, 1)), 0.0, 3.0])
        heading = float(np.arctan2(target[0] - position[0], target[1] - position[1])) - 0.1
        out = np.array([np.sin(heading), np.cos(heading), 0.0])
        right = np.array([np.cos(heading), -np.sin(heading), 0.0])
        turn = Rotation.from_matrix(np.column_stack([right, [0.0, 0.0, -1.0], out]))
        x, y = CameraModel(CAMERA).project(turn.inv().apply(np.array(target) - position)).tolist()
        east, north, up = position.tolist()
        w, i2, j, k = turn.as_quat(scalar_first=True).tolist()
        sightings.append(Sighting(100.25 + 0.1 * i, (east, north, up), (w, i2, j, k), (x, y)))
    return FlightSightings("flight-1", ORIGIN, CAMERA, tuple(sightings))


def drawn(png: bytes) -> Image:
    assert png.startswith(b"\x89PNG")
    decoded = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return np.asarray(decoded, dtype=np.uint8)


def places(picture: Image, colour: str) -> Matrix:
    """Pixels (x, y) of the drawing (not of the panel beside it) that have a colour."""
    bgr = [int(colour[i : i + 2], 16) for i in (5, 3, 1)]
    close = np.abs(picture[:, : int(picture.shape[1] * 0.63)].astype(int) - bgr).max(axis=2) < 12
    return np.argwhere(close)[:, ::-1].astype(np.float64)


def test_the_rays_point_from_where_the_drone_was_to_the_target_and_are_thinned() -> None:
    still = estimate(velocity=(0.0, 0.0, 0.0))
    rays = _rays(flight(300), still)
    assert len(rays) == RAYS
    target: Vector = np.array([0.1, 9.0])
    for start, end in rays:
        to_target, along = target - start, end - start
        assert abs(to_target[0] * along[1] - to_target[1] * along[0]) < 1e-6 * np.hypot(*along)
        assert np.hypot(*along) == pytest.approx(1.06 * np.hypot(*to_target))


def test_a_flight_with_few_sightings_has_a_ray_for_each() -> None:
    assert len(_rays(flight(3), estimate())) == 3
    assert len(_rays(flight(1), estimate())) == 1


def test_north_is_up_east_is_right_and_the_scale_is_the_same_both_ways() -> None:
    def truth_at(east: float, north: float) -> Vector:
        track = np.array([[100.0, east, north, 0.0]])
        fixed = np.array([[0.0, -6.0, -2.0, 3.0], [1.0, 6.0, 10.0, 3.0]])  # keeps the window the same
        cross = places(
            drawn(plan_view(flight(), estimate(), drone_track=fixed, truth_track=track, size_px=(900, 630))), TRUTH
        )
        centre: Vector = (cross.min(axis=0) + cross.max(axis=0)) / 2.0
        return centre

    middle, east, north = truth_at(-2.0, 2.0), truth_at(1.0, 2.0), truth_at(-2.0, 5.0)
    assert east[0] - middle[0] > 50.0
    assert east[1] - middle[1] == pytest.approx(0.0, abs=1.5)
    assert north[0] - middle[0] == pytest.approx(0.0, abs=1.5)
    assert middle[1] - north[1] == pytest.approx(east[0] - middle[0], abs=2.5)


def test_the_truth_is_drawn_only_where_it_is_known() -> None:
    assert len(places(drawn(plan_view(flight(), estimate())), TRUTH)) == 0


def test_an_answer_without_covariance_velocity_first_position_or_real_place_is_drawn_too() -> None:
    bare = replace(estimate(velocity=None), covariance=None, first=None)
    assert drawn(plan_view(flight(), bare, geodetic=False)).shape == (1050, 1500, 3)


def test_the_picture_has_the_size_that_was_asked_for() -> None:
    assert drawn(plan_view(flight(), estimate(), size_px=(1200, 800))).shape == (800, 1200, 3)


def test_without_sightings_there_is_nothing_to_draw() -> None:
    with pytest.raises(ValueError, match="needs sightings"):
        plan_view(replace(flight(), sightings=()), estimate())
