"""How far the telemetry errs is found from what the pictures leave over; what stays open is told honestly."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mission.bundle.gauge_alignment import SCALE, TURN, most_likely_gauge
from mission.bundle.gauss_markov import GaussMarkov
from mission.bundle.telemetry_prior import ErrorLevels, TelemetryPrior
from mission.camera import Camera, Mounting
from mission.pose.buffer import Pose, world_from_body
from mission.records import CameraIntrinsics, NoiseModel
from tests.support.bundle_worlds import ROUGH, fly, street


def reported(seed: int, *, errors: bool = True) -> tuple[TelemetryPrior, np.ndarray, np.ndarray]:
    """Reports, the true path and the rotations in front of the reported attitudes."""
    flight = fly(street(np.random.default_rng(0), 30), np.random.default_rng(seed), errors=errors)
    turned = flight.true.rotation @ np.swapaxes(flight.reports.cameras.rotation, 1, 2)
    return flight.reports, flight.true.position_m, turned


def test_the_lens_goes_about_an_aircraft_that_turns_on_the_spot() -> None:
    lens = CameraIntrinsics(640, 480, 500.0, 500.0, 320.0, 240.0)
    camera = Camera(lens, Mounting.tilted(0.0, (0.2, 0.0, 0.0)), calibrated=True)

    def turning(t_s: float) -> Pose:
        attitude = world_from_body(0.0, 0.0, 0.5 * t_s)
        return Pose(t_s, np.array([3.0, 4.0, 1.0]), np.zeros(3), attitude, np.eye(3), np.eye(3))

    reports, _ = TelemetryPrior.collect(turning, camera, np.linspace(0.0, 3.0, 10))
    assert np.linalg.norm(reports.way_m[-1]) == pytest.approx(0.4 * np.sin(0.75), abs=1e-6)
    np.testing.assert_allclose(reports.way_m, reports.cameras.position_m - reports.cameras.position_m[0], atol=1e-9)


def test_a_path_that_was_stretched_turned_and_moved_comes_back() -> None:
    reports, path, turned = reported(1, errors=False)
    turn = Rotation.from_rotvec([0.02, -0.03, 0.1]).as_matrix()
    spoilt = 1.3 * (path - path.mean(axis=0)) @ turn.T + [5.0, 6.0, 7.0]
    found = most_likely_gauge(spoilt, path, turn @ turned, reports.prior(ErrorLevels.stated(ROUGH)))
    back = found.pivot_m + found.offset_m + found.scale * (spoilt - found.pivot_m) @ found.turn.T
    np.testing.assert_allclose(back, path, atol=0.02)
    assert found.scale == pytest.approx(1.0 / 1.3, rel=0.01)


def test_what_stays_open_of_the_scale_and_the_directions_is_as_large_as_told() -> None:
    scales, turns = [], []
    for seed in range(60):
        reports, path, turned = reported(seed)
        levels = ErrorLevels.stated(ROUGH)
        found = most_likely_gauge(path, reports.cameras.position_m, turned, reports.prior(levels))
        sigma = np.sqrt(np.diag(found.covariance))
        scales.append(np.log(found.scale) / sigma[SCALE])
        turns.append(Rotation.from_matrix(found.turn).as_rotvec() / sigma[TURN])
    assert 0.6 < np.sqrt(np.mean(np.square(scales))) < 1.4
    assert 0.6 < np.sqrt(np.mean(np.square(turns))) < 1.4


@pytest.mark.parametrize("stated", [ROUGH, NoiseModel()])
def test_levels_are_found_whatever_the_aircraft_says_of_itself(stated: NoiseModel) -> None:
    found = []
    for seed in range(12):
        reports, path, turned = reported(seed)
        true = fly(street(np.random.default_rng(0), 30), np.random.default_rng(seed)).true
        assert np.array_equal(true.position_m, path)
        levels = reports.fitted(ErrorLevels.stated(stated), true, turned)
        found.append([levels.heading.sigma, levels.tilt.sigma, levels.horizontal.sigma])
    heading, tilt, horizontal = np.median(found, axis=0)
    assert 0.02 < heading < 0.06
    assert 0.006 < tilt < 0.03
    assert 0.08 < horizontal < 0.25


def test_an_aircraft_that_does_not_err_is_not_said_to() -> None:
    reports, _, turned = reported(3, errors=False)
    true = fly(street(np.random.default_rng(0), 30), np.random.default_rng(3), errors=False).true
    levels = reports.fitted(ErrorLevels.stated(ROUGH), true, turned)
    assert levels.heading.sigma < 0.7 * ROUGH.heading_sigma_rad
    assert levels.horizontal.sigma < 0.1


def test_the_integral_of_a_process_grows_as_its_own_samples_do() -> None:
    t_s, wander = np.linspace(0.0, 6.0, 61), GaussMarkov(0.2, 2.0)
    drawn = np.random.default_rng(5).multivariate_normal(np.zeros(61), wander.covariance(t_s), size=4000, method="svd")
    way = np.cumsum(0.5 * (drawn[:, 1:] + drawn[:, :-1]), axis=1) * 0.1
    expected = wander.integral_covariance(t_s)
    np.testing.assert_allclose(np.var(way[:, [19, 59]], axis=0), np.diag(expected)[[20, 60]], rtol=0.1)
    assert expected[0, 0] == pytest.approx(0.0, abs=1e-9)
