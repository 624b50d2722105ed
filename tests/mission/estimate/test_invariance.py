"""Turning, moving, mirroring or shuffling a flight changes the answer only accordingly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mission.errors import EstimateRefused
from mission.estimate import ESTIMATORS
from mission.records import Estimate, FlightSightings, Matrix, Sighting, Vector
from sitl.evaluation.accuracy.flights import Walk, out_and_back, s_pattern, simulate

EXAMPLES = settings(max_examples=8, deadline=None, derandomize=True)
METHODS = st.sampled_from(sorted(ESTIMATORS))
SEEDS = st.integers(0, 2**31)


def flight_of(seed: int, wrong_share: float = 0.0) -> FlightSightings:
    rng = np.random.default_rng(seed)
    pattern = out_and_back(rate_hz=5.0) if seed % 2 else s_pattern(rate_hz=5.0)
    east, north = rng.uniform(-0.5, 0.5, 2)
    return simulate(pattern, Walk(rng.uniform(4.0, 15.0), (east, north, 0.0)), rng, wrong_share=wrong_share).flight


def estimate(method: str, flight: FlightSightings) -> Estimate | None:
    try:
        return ESTIMATORS[method].estimate(flight)
    except EstimateRefused:
        return None


def moved(flight: FlightSightings, turn: Rotation, shift: Vector) -> FlightSightings:
    def one(s: Sighting) -> Sighting:
        east, north, up = (turn.apply(s.position_enu_m) + shift).tolist()
        w, x, y, z = (turn * Rotation.from_quat(s.world_from_camera_wxyz, scalar_first=True)).as_quat(scalar_first=True)
        return replace(s, position_enu_m=(east, north, up), world_from_camera_wxyz=(w, x, y, z))

    return replace(flight, sightings=tuple(one(s) for s in flight.sightings))


def assert_same(before: Estimate | None, after: Estimate | None, turn: Matrix, shift: Vector) -> None:
    assert (before is None) == (after is None)
    if before is None or after is None:
        return
    # `batch` sums over a grid whose ends hang on which of two ranges is just below a threshold.
    grid = 50.0 if before.method == "batch" else 1.0
    assert after.depth_m == pytest.approx(before.depth_m, rel=grid * 1e-5)
    np.testing.assert_allclose(after.position_enu_m, turn @ before.position_enu_m + shift, atol=grid * 1e-4)
    assert after.rejected == before.rejected
    if before.covariance is not None and after.covariance is not None:
        six = np.kron(np.eye(2), turn)
        np.testing.assert_allclose(
            after.covariance, six @ before.covariance @ six.T, rtol=grid * 1e-3, atol=grid * 1e-5
        )


@EXAMPLES
@given(seed=SEEDS, method=METHODS, angle=st.floats(-3.1, 3.1), east=st.floats(-1e5, 1e5), up=st.floats(-1e3, 1e3))
def test_turning_about_the_vertical_and_moving(seed: int, method: str, angle: float, east: float, up: float) -> None:
    flight = flight_of(seed)
    turn, shift = Rotation.from_euler("z", angle), np.array([east, -2.0 * east, up])
    assert_same(estimate(method, flight), estimate(method, moved(flight, turn, shift)), turn.as_matrix(), shift)


@EXAMPLES
@given(seed=SEEDS, method=METHODS)
def test_mirroring_east_and_west(seed: int, method: str) -> None:
    flight = flight_of(seed)
    mirror = np.diag([-1.0, 1.0, 1.0])

    def one(s: Sighting) -> Sighting:
        # World and camera x are both mirrored: the rotation stays a rotation, M R M.
        w, x, y, z = s.world_from_camera_wxyz
        (u, v), (east, north, up) = s.pixel, s.position_enu_m
        return replace(
            s, world_from_camera_wxyz=(w, x, -y, -z), pixel=(640.0 - u, v), position_enu_m=(-east, north, up)
        )

    mirrored = replace(flight, sightings=tuple(one(s) for s in flight.sightings))
    assert_same(estimate(method, flight), estimate(method, mirrored), mirror, np.zeros(3))


@EXAMPLES
@given(seed=SEEDS, method=METHODS, shuffle=st.randoms(use_true_random=False))
def test_the_order_of_equal_times_does_not_matter(seed: int, method: str, shuffle: object) -> None:
    flight = flight_of(seed)
    pairs = [(replace(a, t_s=b.t_s), b) for a, b in zip(flight.sightings[::2], flight.sightings[1::2], strict=False)]
    rng = np.random.default_rng(seed)
    turned = [pair if rng.random() < 0.5 else pair[::-1] for pair in pairs]
    straight = replace(flight, sightings=tuple(s for pair in pairs for s in pair))
    shuffled = replace(flight, sightings=tuple(s for pair in turned for s in pair))
    assert_same(estimate(method, straight), estimate(method, shuffled), np.eye(3), np.zeros(3))


@EXAMPLES
@given(seed=SEEDS)
def test_wrong_sightings_stay_wrong_when_the_flight_is_turned(seed: int) -> None:
    flight = flight_of(seed, wrong_share=0.1)
    turn = Rotation.from_euler("z", 1.0)
    after = estimate("batch", moved(flight, turn, np.zeros(3)))
    assert_same(estimate("batch", flight), after, turn.as_matrix(), np.zeros(3))


@EXAMPLES
@given(seed=SEEDS, offset_s=st.floats(-1e6, 1e9))
def test_the_clocks_zero_does_not_matter(seed: int, offset_s: float) -> None:
    flight = flight_of(seed)
    late = replace(flight, sightings=tuple(replace(s, t_s=s.t_s + offset_s) for s in flight.sightings))
    assert_same(estimate("batch", flight), estimate("batch", late), np.eye(3), np.zeros(3))
