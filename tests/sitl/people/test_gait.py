"""The gait: feet that hold the ground, angles as people have them, a trunk that hardly moves."""

from __future__ import annotations

import numpy as np
import pytest

from sitl.people import gait
from sitl.people.body import read_body

SPEEDS_M_S = [0.3, 0.6, 1.0, 1.4]
PHASES = np.arange(0.0, 1.0, 1.0 / 60.0)


def soles() -> np.ndarray:
    """Vertices under the left heel and ball."""
    rest = read_body().vertices_m
    return np.flatnonzero((rest[:, 2] < 0.006) & (rest[:, 1] > 0.0))


@pytest.mark.parametrize("speed", SPEEDS_M_S)
def test_the_planted_foot_stays_where_it_is(speed: float) -> None:
    stride = gait.stride_m(speed)
    flat = np.arange(0.10, 0.30, 0.02)
    places = np.array([gait.pose(phase, stride, 0.0)[soles()] + [phase * stride, 0.0, 0.0] for phase in flat])
    assert np.ptp(places[:, :, 0], axis=0).max() < 0.01
    assert np.ptp(places[:, :, 1], axis=0).max() < 0.01
    assert np.abs(places[:, :, 2]).max() < 0.012


@pytest.mark.parametrize("speed", SPEEDS_M_S)
def test_a_foot_is_always_on_the_ground_and_none_below_it(speed: float) -> None:
    lowest = [gait.pose(phase, gait.stride_m(speed), 0.0)[:, 2].min() for phase in PHASES]
    assert max(lowest) < 0.006
    assert min(lowest) > -0.016


@pytest.mark.parametrize("speed", SPEEDS_M_S)
def test_the_centroid_keeps_its_height_and_its_pace(speed: float) -> None:
    stride = gait.stride_m(speed)
    centroids = np.array([read_body().surface_centroid(gait.pose(phase, stride, 0.0)) for phase in PHASES])
    assert np.ptp(centroids[:, 2]) < 0.01 + 0.021 * speed
    assert np.ptp(centroids[:, :2], axis=0).max() < 0.035


def test_the_stride_repeats() -> None:
    stride = gait.stride_m(0.6)
    np.testing.assert_allclose(gait.pose(0.0, stride, 0.0), gait.pose(1.0 - 1e-9, stride, 0.0), atol=2e-3)


def test_left_and_right_are_mirror_images_half_a_stride_apart() -> None:
    stride = gait.stride_m(1.0)
    one, other = gait.pose(0.2, stride, 0.0), gait.pose(0.7, stride, 0.0)
    np.testing.assert_allclose(one.min(axis=0)[[0, 2]], other.min(axis=0)[[0, 2]], atol=0.02)
    assert one[:, 1].max() == pytest.approx(-other[:, 1].min(), abs=0.02)


def test_cadence_grows_with_speed_as_the_walk_ratio_says() -> None:
    for speed in SPEEDS_M_S:
        step = gait.stride_m(speed) / 2.0
        cadence_per_min = 60.0 * speed / step
        assert step / cadence_per_min == pytest.approx(0.0065)
    assert gait.stride_m(1.35) == pytest.approx(1.45, abs=0.03)


def test_joint_angles_are_those_of_free_walking() -> None:
    """What textbooks of physiotherapy give, with a wide margin, as they differ by 10 degrees among themselves.

    Hip 30 flexed to 10 (or 20) extended, knee 60 (45 to 70) flexed in early swing, ankle 10 up and 20 to 25 down. Our
    thigh counts from the vertical, which is the hip's angle with a pelvis that does not tilt.
    """
    angles = np.degrees([gait.joint_angles(phase, gait.stride_m(1.3)) for phase in PHASES])
    thigh, knee, ankle = angles.T
    assert 20.0 < thigh.max() < 40.0
    assert -30.0 < thigh.min() < -10.0
    assert 45.0 < knee.max() < 70.0
    assert 0.65 < PHASES[knee.argmax()] < 0.82
    assert 0.0 <= knee.min() < 12.0
    assert 5.0 < ankle.max() < 25.0
    assert -25.0 < ankle.min() < -5.0


def test_standing_people_sway_a_little_and_differently() -> None:
    times = np.arange(0.0, 20.0, 0.25)
    tracks = [np.array([read_body().surface_centroid(gait.pose(0.0, 0.0, t, seed)) for t in times]) for seed in (1, 2)]
    for track in tracks:
        assert 0.005 < np.ptp(track[:, 1]) < 0.04
        assert np.ptp(track[:, 2]) < 0.01
    assert np.abs(tracks[0] - tracks[1]).max() > 0.003


def test_a_body_at_rest_is_as_tall_as_the_mesh() -> None:
    standing = gait.pose(0.0, 0.0, 0.0)
    assert np.ptp(standing[:, 2]) == pytest.approx(1.75, abs=0.02)
