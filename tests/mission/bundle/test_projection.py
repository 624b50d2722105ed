"""Where points appear to cameras: the derivatives are those of the prediction, and behind a camera there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mission.bundle.projection import Cameras, Landmarks, Rows, linearise, linearise_cameras, residuals, tangents
from mission.bundle.rotations import exponential
from mission.records import Matrix
from tests.support.bundle_worlds import NORTHWARD, cameras

TINY = 1e-6


def world(delay_s: float = 0.0) -> tuple[Cameras, Landmarks, Rows]:
    """Three cameras that see forty points in no particular order, each about once or twice."""
    rng = np.random.default_rng(1)
    turn = exponential(rng.normal(size=(3, 3)) * 0.1)
    seen_from = cameras(np.arange(3.0), turn @ NORTHWARD, rng.normal(size=(3, 3)))
    seen_from = replace(seen_from, turn_rate=rng.normal(size=(3, 3)), velocity_m_s=rng.normal(size=(3, 3)))
    direction = np.array([0.0, 1.0, 0.0]) + 0.3 * rng.normal(size=(40, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = Landmarks(np.array([0.1, -0.2, 0.3]), direction, rng.uniform(0.0, 0.2, 40))
    frame, point = rng.integers(0, 3, 60), rng.integers(0, 40, 60)
    return seen_from, points, Rows(frame, point, rng.normal(size=(60, 2)) * 0.1, np.full(60, delay_s))


def test_the_derivatives_by_the_camera_are_those_of_the_prediction() -> None:
    seen_from, points, rows = world()
    residual, by_camera, _ = linearise(seen_from, points, rows)
    for number, axis in enumerate(np.eye(3)):
        turned = replace(seen_from, rotation=exponential(TINY * axis[None]) @ seen_from.rotation)
        by_turn = (residual - residuals(turned, points, rows)) / TINY
        assert by_turn == pytest.approx(by_camera[:, number], abs=1e-5)
        shifted = replace(seen_from, position_m=seen_from.position_m + TINY * axis)
        by_place = (residual - residuals(shifted, points, rows)) / TINY
        assert by_place == pytest.approx(by_camera[:, 3 + number], abs=1e-5)


def test_the_derivatives_by_the_point_are_those_of_the_prediction() -> None:
    seen_from, points, rows = world()
    residual, _, by_point = linearise(seen_from, points, rows)
    across = tangents(points.direction)
    for number in range(2):
        moved = replace(points, direction=points.direction + TINY * across[:, :, number])
        by_direction = (residual - residuals(seen_from, moved, rows)) / TINY
        assert by_direction == pytest.approx(by_point[:, number], abs=1e-5)
    nearer = replace(points, nearness=points.nearness + TINY)
    by_nearness = (residual - residuals(seen_from, nearer, rows)) / TINY
    assert by_nearness == pytest.approx(by_point[:, 2], abs=1e-5)


def test_points_that_are_known_have_the_same_residuals_and_derivatives() -> None:
    everything = world(delay_s=0.01)
    residual, by_camera, _ = linearise(*everything)
    again, by_camera_again = linearise_cameras(*everything)
    assert np.array_equal(again, residual)
    assert np.array_equal(by_camera_again, by_camera)


def test_a_late_row_is_seen_by_the_camera_where_it_is_by_then() -> None:
    seen_from, points, rows = world(delay_s=0.01)
    later: Matrix = seen_from.position_m + 0.01 * seen_from.velocity_m_s
    turned = seen_from.rotation @ exponential(0.01 * seen_from.turn_rate)
    moved = replace(seen_from, rotation=turned, position_m=later)
    there = replace(rows, delay_s=np.zeros(len(rows.frame)))
    assert residuals(seen_from, points, rows) == pytest.approx(residuals(moved, points, there), abs=1e-12)


def test_a_point_behind_the_camera_has_no_residual_and_moves_nothing() -> None:
    seen_from, points, rows = world()
    behind = replace(points, direction=-points.direction, nearness=np.zeros(40))
    residual, by_camera, by_point = linearise(seen_from, behind, rows)
    assert np.isnan(residual).all()
    assert not by_camera.any()
    assert not by_point.any()
