"""A video finds its place in a log by how the camera turned, or says why not."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from mission.camera.camera import Camera
from mission.camera.mounting import Mounting
from mission.errors import LogError
from mission.logs.pose_log import Attitudes, Clock, PoseLog, Positions
from mission.logs.series import from_euler
from mission.observation.rotation_curve import TimedTurn
from mission.observation.self_calibration import find_tilt
from mission.observation.time_search import find_time
from mission.records import GeodeticOrigin, NoiseModel, Vector
from mission.sighting import world_from_camera
from mission.timing.background_rotation import Turn

TILT = math.radians(15.0)
CAMERA = Camera.from_field_of_view(640, 480, 1.1, Mounting.tilted(TILT))


def restless(seed: int) -> Callable[[Vector], Vector]:
    """A heading that turns to and fro, never twice the same."""
    rng = np.random.default_rng(seed)
    waves = [(rng.uniform(0.05, 0.5), rng.uniform(0.0, 6.3), rng.uniform(0.1, 0.3)) for _ in range(8)]
    return lambda t: np.sum([a * np.sin(2.0 * math.pi * f * t + p) for f, p, a in waves], axis=0)


def log_of(
    heading: Callable[[Vector], Vector],
    last_s: float,
    rate_hz: float = 10.0,
    wobble: float = 0.02,
    clock: Clock = "vehicle",
) -> PoseLog:
    t = np.arange(0.0, last_s, 0.1)
    still = np.zeros((len(t), 3))
    angles = np.degrees(np.column_stack([wobble * np.sin(t), wobble * np.cos(1.3 * t), heading(t)]))
    return PoseLog(
        "csv", clock, GeodeticOrigin(0, 0, 0), Positions(t, still, still), from_euler(t, angles), None, NoiseModel()
    )


def turns_of(
    log: PoseLog, first_s: float, duration_s: float, noise: float = 0.001, factor: float = 1.0
) -> list[TimedTurn]:
    pose_at, rng, found = log.pose_at(), np.random.default_rng(3), []
    for from_s in np.arange(0.0, duration_s, 0.1).tolist():
        before, now = pose_at(first_s + from_s), pose_at(first_s + from_s + 0.1)
        assert before is not None
        assert now is not None
        turned = (world_from_camera(before, CAMERA).inv() * world_from_camera(now, CAMERA)).as_rotvec()
        vector = factor * turned + rng.normal(0.0, noise, 3)
        found.append(TimedTurn(from_s, from_s + 0.1, Turn(vector, np.full(3, 240.0), 40)))
    return found


@pytest.mark.parametrize("seed", range(6))
def test_found_anywhere_in_a_long_flight(seed: int) -> None:
    log = log_of(restless(seed), 400.0)
    begin = 37.0 + 50.037 * seed
    found = find_time(turns_of(log, begin, 30.0), log, CAMERA, None)
    assert found.measured
    assert found.offset_s == pytest.approx(-begin, abs=0.010)
    assert abs(found.offset_s + begin) < 4.0 * found.sigma_s
    assert found.likeness > found.runner_up


def test_another_flight_is_refused() -> None:
    log, other = log_of(restless(1), 200.0), log_of(restless(2), 200.0)
    with pytest.raises(LogError, match="cannot be put together"):
        find_time(turns_of(other, 20.0, 30.0), log, CAMERA, None)


def test_straight_flight_is_refused_without_a_time() -> None:
    log = log_of(lambda t: 0.0 * t, 100.0)
    with pytest.raises(LogError, match="cannot be put together"):
        find_time(turns_of(log, 20.0, 20.0), log, CAMERA, None)


def test_straight_flight_takes_an_exact_guess() -> None:
    log = log_of(lambda t: 0.0 * t, 100.0)
    found = find_time(turns_of(log, 20.0, 20.0), log, CAMERA, -20.0, 0.05)
    assert not found.measured
    assert (found.offset_s, found.sigma_s) == (-20.0, 0.05)


def test_a_manoeuvre_flown_twice_needs_the_files_times() -> None:
    def twice(t: Vector) -> Vector:
        return np.asarray(0.4 * np.sin(2.0 * math.pi * 0.21 * (t % 60.0)) * np.exp(-(((t % 60.0) - 30.0) ** 2) / 60.0))

    log = log_of(twice, 120.0, wobble=0.0)
    turns = turns_of(log, 80.0, 20.0)
    with pytest.raises(LogError, match="two places"):
        find_time(turns, log, CAMERA, None)
    assert find_time(turns, log, CAMERA, -78.0, 3.0).offset_s == pytest.approx(-80.0, abs=0.02)


def test_log_on_the_video_s_clock_is_not_searched_far() -> None:
    log = log_of(restless(5), 60.0, clock="video")
    assert find_time(turns_of(log, 0.3, 30.0), log, CAMERA, None).offset_s == pytest.approx(-0.3, abs=0.01)


def test_no_attitude_no_time() -> None:
    log = log_of(restless(5), 60.0)
    blind = PoseLog("csv", "vehicle", log.origin, log.positions, None, None, log.noise)
    with pytest.raises(LogError, match="no attitude"):
        find_time(turns_of(log, 10.0, 20.0), blind, CAMERA, None)


def test_tilt_from_turns() -> None:
    log = log_of(restless(7), 100.0)
    level = Camera.from_field_of_view(640, 480, 1.1)
    found = find_tilt(turns_of(log, 20.0, 40.0), log, level, -20.0)
    assert found is not None
    tilt, sigma = found
    assert abs(tilt) == pytest.approx(TILT, abs=0.01)
    assert sigma < 0.02


def test_attitudes_are_needed_in_order() -> None:
    assert isinstance(log_of(restless(1), 20.0).aircraft, Attitudes)
