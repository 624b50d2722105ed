"""What walks is told from what stands by the epipolar lines of two pictures; what stands is left alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.bundle.epipolar_gate import keeps_to_epipolar_lines
from mission.bundle.projection import Rows
from mission.records import Matrix
from tests.support.bundle_worlds import FOCAL_PX, Flight, fly, horizon, street, wall

PIXEL = 1.0 / FOCAL_PX


def walkers(flight: Flight, rng: np.random.Generator, count: int, across_m_s: float, away_m_s: float) -> Rows:
    """Points on people 5 to 9 m away, who walk across the camera's way and away from it."""
    first = np.stack(
        [rng.uniform(-3.0, 3.0, count), rng.uniform(5.0, 9.0, count), rng.uniform(0.0, 1.7, count)], axis=1
    )
    way = rng.choice([-1.0, 1.0], count)
    frame, point, measured = [], [], []
    for number, t_s in enumerate(flight.true.t_s):
        place = first + np.outer(way * t_s, [across_m_s, away_m_s, 0.0])
        y = (place - flight.true.position_m[number]) @ flight.true.rotation[number]
        ideal = y[:, :2] / np.maximum(y[:, 2:], 0.1)
        inside = np.flatnonzero((y[:, 2] > 0.5) & (np.abs(ideal[:, 0]) < 0.7) & (np.abs(ideal[:, 1]) < 0.5))
        frame.append(np.full(len(inside), number))
        point.append(inside)
        measured.append(ideal[inside])
    return Rows(np.concatenate(frame), np.concatenate(point), np.concatenate(measured), np.zeros(sum(map(len, frame))))


def together(still: Rows, moving: Rows) -> Rows:
    """Both, the moving points numbered after the still ones."""
    after = int(still.point.max()) + 1
    return Rows(
        np.concatenate([still.frame, moving.frame]),
        np.concatenate([still.point, moving.point + after]),
        np.concatenate([still.measured, moving.measured]),
        np.concatenate([still.delay_s, moving.delay_s]),
    )


def kept(flight: Flight, rows: Rows) -> np.ndarray:
    return keeps_to_epipolar_lines(rows, flight.true.t_s, PIXEL)


@pytest.mark.parametrize(
    ("points", "out_m", "turn_rad"),
    [
        pytest.param(street, 0.0, 0.4, id="pure rotation"),
        pytest.param(street, 3.0, 0.0, id="pure translation"),
        pytest.param(street, 3.0, 0.3, id="both"),
        pytest.param(wall, 3.0, 0.3, id="a plane"),
        pytest.param(horizon, 3.0, 0.3, id="points without parallax"),
        pytest.param(street, 0.0, 0.0, id="no motion at all"),
        pytest.param(street, 0.02, 0.3, id="hardly any baseline"),
    ],
)
def test_what_stands_is_kept(points: object, out_m: float, turn_rad: float) -> None:
    rng = np.random.default_rng(3)
    assert callable(points)
    world: Matrix = points(rng)
    flight = fly(world, rng, out_m=out_m, turn_rad=turn_rad)
    assert kept(flight, flight.rows).mean() > 0.97


@pytest.mark.parametrize("seed", range(3))
def test_people_who_walk_to_and_fro_are_left_out_though_they_are_two_points_of_five(seed: int) -> None:
    rng = np.random.default_rng(seed)
    flight = fly(street(rng, 180), rng)
    crowd = walkers(flight, rng, 90, across_m_s=0.1, away_m_s=0.6)
    both = together(flight.rows, crowd)
    assert 0.3 < len(crowd.frame) / len(both.frame) < 0.5
    found, mine = kept(flight, both), int(flight.rows.point.max()) + 1
    assert found[:mine].mean() > 0.8
    assert found[mine:].mean() < 0.35


def test_a_point_that_moves_along_the_baseline_is_not_told_apart_and_is_the_bundles_to_judge() -> None:
    rng = np.random.default_rng(5)
    flight = fly(street(rng, 120), rng, turn_rad=0.0, errors=False)
    along = walkers(flight, rng, 10, across_m_s=0.5, away_m_s=0.0)
    mine = int(flight.rows.point.max()) + 1
    assert kept(flight, together(flight.rows, along))[mine:].mean() > 0.5


def test_too_few_points_and_too_short_a_flight_judge_nobody() -> None:
    rng = np.random.default_rng(6)
    few = fly(street(rng, 12), rng)
    assert kept(few, few.rows).all()
    brief = fly(street(rng), rng)
    soon = brief.rows.only(brief.rows.frame < 2)
    assert keeps_to_epipolar_lines(soon, brief.true.t_s[:2], PIXEL).all()
    nothing = brief.rows.only(np.zeros(len(brief.rows.frame), dtype=bool))
    assert keeps_to_epipolar_lines(nothing, brief.true.t_s, PIXEL).shape == (0,)


@settings(max_examples=8, deadline=None)
@given(heading=st.floats(-0.5, 0.5), seed=st.integers(0, 50))
def test_a_turned_camera_changes_no_verdict_on_the_background(heading: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    flight = fly(street(rng), rng, turn_rad=heading)
    assert kept(flight, flight.rows).mean() > 0.97


def test_the_same_points_get_the_same_verdict_every_time() -> None:
    rng = np.random.default_rng(8)
    flight = fly(street(rng), rng)
    both = together(flight.rows, walkers(flight, rng, 60, 0.3, 0.5))
    assert np.array_equal(kept(flight, both), kept(flight, both))
