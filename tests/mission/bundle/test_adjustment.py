"""The bundle finds the camera's rotation and the shape of its path; what pictures cannot tell it leaves alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mission.bundle.adjustment import AdjustedBundle, adjust
from mission.bundle.projection import Cameras, Rows
from mission.bundle.telemetry_prior import TelemetryPrior
from tests.support.bundle_worlds import FOCAL_PX, Flight, fly, horizon, street, wall

TENTH_DEG = np.radians(0.1)


def solve(flight: Flight) -> AdjustedBundle:
    """Over all frames, as the mission does over its key frames."""
    prior = flight.reports.prior(flight.levels)
    return adjust(flight.reports.cameras, flight.rows, prior, 0.05 / FOCAL_PX, 20.0 / FOCAL_PX)


def rotation_error(found: Cameras, true: Cameras) -> float:
    """Rms angle by which rotations differ, a common one taken away, per axis."""
    error = (Rotation.from_matrix(found.rotation) * Rotation.from_matrix(true.rotation).inv()).as_rotvec()
    return float(np.sqrt(np.mean(np.square(error - error.mean(axis=0)))))


def shape_error(found: Cameras, true: Cameras) -> float:
    """Rms distance of paths in metres after the best turn, shift and stretch."""
    a, b = (c.position_m - c.position_m.mean(axis=0) for c in (found, true))
    turn, lengths = Rotation.align_vectors(a, b)
    scale = float(np.sum(a * turn.apply(b)) / np.sum(b * b))
    assert lengths >= 0.0
    return float(np.sqrt(np.mean(np.sum(np.square(a - scale * turn.apply(b)), axis=1))))


@pytest.mark.parametrize("seed", range(4))
def test_rotation_and_path_past_a_street_with_a_restless_autopilot(seed: int) -> None:
    rng = np.random.default_rng(seed)
    flight = fly(street(rng), rng)
    assert rotation_error(flight.reports.cameras, flight.true) > 4.0 * TENTH_DEG
    found = solve(flight)
    assert rotation_error(found.cameras, flight.true) < 0.5 * TENTH_DEG
    assert shape_error(found.cameras, flight.true) < 0.01
    assert found.still_share > 0.95
    assert found.scale * FOCAL_PX == pytest.approx(0.2, abs=0.05)


def test_the_order_of_the_rows_does_not_matter() -> None:
    rng = np.random.default_rng(15)
    flight = fly(street(rng), rng)
    order = rng.permutation(len(flight.rows.frame))
    rows = flight.rows
    mixed = Rows(rows.frame[order], rows.point[order], rows.measured[order], rows.delay_s[order])
    found, again = solve(flight), solve(replace(flight, rows=mixed))
    assert again.cameras.rotation == pytest.approx(found.cameras.rotation, abs=1e-8)
    assert again.cameras.position_m == pytest.approx(found.cameras.position_m, abs=1e-7)
    assert again.covariance == pytest.approx(found.covariance, rel=1e-5, abs=1e-12)


def test_the_covariance_is_that_of_each_frames_rotation_and_place_in_turn() -> None:
    rng = np.random.default_rng(16)
    found = solve(fly(street(rng), rng))
    sigma = np.sqrt(np.diag(found.covariance)).reshape(-1, 6)
    assert (sigma[:, :3] < TENTH_DEG).all()
    assert (sigma[:, 3:] > 2.0 * sigma[:, :3]).all()


def test_pure_rotation_is_found_and_is_not_taken_for_a_translation() -> None:
    rng = np.random.default_rng(10)
    flight = fly(street(rng), rng, out_m=0.0, turn_rad=0.4)
    found = solve(flight)
    assert rotation_error(found.cameras, flight.true) < TENTH_DEG
    spread = found.cameras.position_m - found.cameras.position_m.mean(axis=0)
    assert np.abs(spread).max() < 0.5


def test_pure_translation_past_a_wall_is_not_taken_for_a_rotation() -> None:
    rng = np.random.default_rng(11)
    flight = fly(wall(rng), rng, turn_rad=0.0)
    found = solve(flight)
    assert rotation_error(found.cameras, flight.true) < 2.0 * TENTH_DEG
    assert np.ptp(found.cameras.position_m[:, 0]) == pytest.approx(3.0, rel=0.25)


def test_points_at_infinity_give_the_rotation_and_leave_the_path_to_the_telemetry() -> None:
    rng = np.random.default_rng(12)
    flight = fly(horizon(rng), rng)
    found = solve(flight)
    assert rotation_error(found.cameras, flight.true) < 0.5 * TENTH_DEG
    reported_error = shape_error(flight.reports.cameras, flight.true)
    assert shape_error(found.cameras, flight.true) < 1.2 * reported_error


def test_a_crowd_that_walks_through_is_left_out() -> None:
    rng = np.random.default_rng(13)
    still, people = street(rng, 120), street(rng, 80)
    flight, crowd = fly(still, rng, errors=True), None
    walk = rng.choice([-1.0, 1.0], len(people)) * rng.uniform(0.5, 1.2, len(people))
    frame, point, measured = [], [], []
    for number, t_s in enumerate(flight.true.t_s):
        moved = people + np.outer(walk * t_s, [1.0, 0.0, 0.0])
        y = (moved - flight.true.position_m[number]) @ flight.true.rotation[number]
        ideal = y[:, :2] / np.maximum(y[:, 2:], 0.1)
        inside = np.flatnonzero((y[:, 2] > 0.5) & (np.abs(ideal[:, 0]) < 0.7) & (np.abs(ideal[:, 1]) < 0.5))
        frame.append(np.full(len(inside), number))
        point.append(inside + int(flight.rows.point.max()) + 1)
        measured.append(ideal[inside])
    crowd = Rows(np.concatenate(frame), np.concatenate(point), np.concatenate(measured), np.zeros(sum(map(len, frame))))
    both = Rows(
        *(
            np.concatenate([getattr(flight.rows, name), getattr(crowd, name)])
            for name in ("frame", "point", "measured", "delay_s")
        )
    )
    moving_share = len(crowd.frame) / len(both.frame)
    assert 0.3 < moving_share < 0.5
    found = solve(replace(flight, rows=both))
    assert rotation_error(found.cameras, flight.true) < 2.0 * TENTH_DEG
    mine = found.still[: int(flight.rows.point.max()) + 1]
    assert mine.mean() > 0.9
    assert found.still[len(mine) :].mean() < 0.5


def test_a_rolling_shutter_is_part_of_the_model() -> None:
    rng = np.random.default_rng(14)
    flight = fly(street(rng), rng, pixel_sigma_px=0.1)
    delay = rng.uniform(-0.02, 0.02, len(flight.rows.frame))
    true = replace(
        flight.true,
        turn_rate=np.tile([0.0, 0.3, 0.1], (len(flight.true.t_s), 1)),
        velocity_m_s=np.tile([1.0, 0.0, 0.2], (len(flight.true.t_s), 1)),
    )
    reported = replace(flight.reports.cameras, turn_rate=true.turn_rate, velocity_m_s=true.velocity_m_s)
    # Each point moves in the picture as the camera goes on during its row's delay.
    frame, turned = flight.rows.frame, Rotation.from_rotvec(true.turn_rate[flight.rows.frame] * delay[:, None])
    ray = turned.inv().apply(np.column_stack([flight.rows.measured, np.ones(len(frame))]))
    rows = Rows(frame, flight.rows.point, ray[:, :2] / ray[:, 2:], delay)
    still = replace(true, velocity_m_s=np.zeros_like(true.velocity_m_s))
    with_model = solve(
        Flight(true, TelemetryPrior(replace(reported, velocity_m_s=still.velocity_m_s), flight.reports.way_m), rows)
    )
    without = solve(Flight(true, flight.reports, replace_delay(rows)))
    assert with_model.scale < 0.3 * without.scale
    assert rotation_error(with_model.cameras, flight.true) < 0.5 * TENTH_DEG


def replace_delay(rows: Rows) -> Rows:
    """The same rows, all taken for exposed at the frame's time."""
    return Rows(rows.frame, rows.point, rows.measured, np.zeros_like(rows.delay_s))


@settings(max_examples=8, deadline=None)
@given(
    heading=st.floats(-np.pi, np.pi),
    east=st.floats(-1e4, 1e4),
    north=st.floats(-1e4, 1e4),
    seed=st.integers(0, 100),
)
def test_turning_the_world_about_the_vertical_and_moving_its_origin_turns_and_moves_the_answer(
    heading: float, east: float, north: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    flight = fly(street(rng, 60), rng, frames=12)
    turn = Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix()
    shift = np.array([east, north, 5.0])
    before = solve(flight)
    after = solve(replace(flight, reports=_elsewhere(flight.reports, turn, shift)))
    np.testing.assert_allclose(after.cameras.position_m, before.cameras.position_m @ turn.T + shift, atol=2e-3)
    np.testing.assert_allclose(after.cameras.rotation, turn @ before.cameras.rotation, atol=2e-4)
    np.testing.assert_allclose(after.landmarks.nearness, before.landmarks.nearness, atol=1e-3)


@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 100))
def test_a_mirrored_world_gives_the_mirrored_path(seed: int) -> None:
    rng = np.random.default_rng(seed)
    flight = fly(street(rng, 60), rng, frames=12)
    mirror, across = np.diag([-1.0, 1.0, 1.0]), np.diag([-1.0, 1.0, 1.0])
    reported = flight.reports.cameras
    other = replace(reported, rotation=mirror @ reported.rotation @ across, position_m=reported.position_m @ mirror)
    rows = replace(flight.rows, measured=flight.rows.measured * [-1.0, 1.0])
    before = solve(flight)
    after = solve(replace(flight, reports=TelemetryPrior(other, flight.reports.way_m @ mirror), rows=rows))
    np.testing.assert_allclose(after.cameras.position_m, before.cameras.position_m @ mirror, atol=2e-3)
    np.testing.assert_allclose(after.cameras.rotation, mirror @ before.cameras.rotation @ across, atol=2e-4)


def test_the_same_flight_gives_the_same_answer_bit_for_bit() -> None:
    flight = fly(street(np.random.default_rng(1)), np.random.default_rng(2))
    first, second = solve(flight), solve(flight)
    assert np.array_equal(first.cameras.position_m, second.cameras.position_m)
    assert np.array_equal(first.cameras.rotation, second.cameras.rotation)


def _elsewhere(reports: TelemetryPrior, turn: np.ndarray, shift: np.ndarray) -> TelemetryPrior:
    cameras = replace(
        reports.cameras,
        rotation=turn @ reports.cameras.rotation,
        position_m=reports.cameras.position_m @ turn.T + shift,
    )
    return TelemetryPrior(cameras, reports.way_m @ turn.T)
