"""A gimbal's attitude between its reports."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mission.gimbal.attitude_history import MAX_GAP_S, GimbalHistory
from mission.gimbal.reading import GimbalReading, Reference
from mission.pose.buffer import heading, world_from_body
from mission.records import Vector


def quaternion(yaw_deg: float, pitch_deg: float = -20.0) -> Vector:
    turned = Rotation.from_euler("ZYX", [yaw_deg, pitch_deg, 0.0], degrees=True)
    return np.asarray(turned.as_quat(scalar_first=True))


def reading(
    yaw_deg: float, reference: Reference = "north", rate: Vector | None = None, pitch_deg: float = -20.0
) -> GimbalReading:
    return GimbalReading(0.0, reference, quaternion(yaw_deg, pitch_deg), rate, True)


def no_aircraft(t_s: float) -> Vector | None:
    return None


def azimuth_deg(turned: Vector | None) -> float:
    assert turned is not None
    return math.degrees(heading(turned))


def test_half_way_between_two_reports() -> None:
    history = GimbalHistory()
    history.add(1.0, reading(170.0))
    history.add(1.1, reading(-170.0))
    assert abs(azimuth_deg(history.at(1.05, no_aircraft))) == pytest.approx(180.0, abs=0.01)


def test_what_is_from_the_nose_follows_the_nose_at_its_own_time() -> None:
    """A locked lens of an aircraft that yaws quickly and unevenly between two reports does not move."""

    def aircraft(t_s: float) -> Vector:
        return world_from_body(0.2, 0.1, math.radians(30.0 * math.sin(9.0 * t_s)))

    history = GimbalHistory(age_s=0.06)
    for k in range(20):
        stamp_s = 0.1 * k
        nose_deg = math.degrees(heading(aircraft(stamp_s - 0.06)))
        history.add(stamp_s, reading(40.0 - nose_deg, "heading"))
    for t_s in (0.05, 0.31, 1.234):
        assert azimuth_deg(history.at(t_s, aircraft)) == pytest.approx(40.0, abs=1e-3)


def test_rates_bend_the_way_between_reports() -> None:
    def yaw(t_s: float) -> float:
        return math.degrees(0.3 * math.sin(4.0 * t_s))

    def rate(t_s: float) -> Vector:
        return np.array([0.0, 0.0, 0.3 * 4.0 * math.cos(4.0 * t_s)])

    with_rates, without = GimbalHistory(), GimbalHistory()
    for k in range(11):
        with_rates.add(0.2 * k, reading(yaw(0.2 * k), rate=rate(0.2 * k), pitch_deg=0.0))
        without.add(0.2 * k, reading(yaw(0.2 * k), pitch_deg=0.0))
    times = np.arange(0.1, 2.0, 0.2)
    bent, straight = (
        max(abs(azimuth_deg(h.at(t, no_aircraft)) - yaw(t)) for t in times.tolist()) for h in (with_rates, without)
    )
    assert bent < 0.05
    assert straight > 10.0 * bent


def test_rates_that_explain_nothing_are_not_believed() -> None:
    history = GimbalHistory()
    history.add(0.0, reading(0.0, rate=np.zeros(3), pitch_deg=0.0))
    history.add(0.2, reading(20.0, rate=np.zeros(3), pitch_deg=0.0))
    assert azimuth_deg(history.at(0.05, no_aircraft)) == pytest.approx(5.0, abs=1e-6)


def test_nothing_is_told_across_a_gap_or_beyond_the_ends() -> None:
    history = GimbalHistory()
    history.add(1.0, reading(0.0))
    history.add(1.0 + 1.1 * MAX_GAP_S, reading(0.0))
    assert history.at(1.1, no_aircraft) is None
    assert history.at(0.9, no_aircraft) is None
    assert history.at(2.0, no_aircraft) is None
    assert history.at(1.0 + 1.1 * MAX_GAP_S + 0.1, no_aircraft, hold_s=0.2) is not None


def test_stale_and_repeated_reports_are_left_out() -> None:
    history = GimbalHistory()
    assert history.add(1.0, reading(0.0))
    assert not history.add(1.0, reading(5.0))
    assert not history.add(0.9, reading(5.0))
    assert not history.add(math.nan, reading(5.0))


def test_a_copy_stays_as_it_is() -> None:
    history = GimbalHistory()
    history.add(1.0, reading(0.0))
    copy = history.copy()
    history.add(1.1, reading(0.0))
    assert copy.at(1.05, no_aircraft) is None
    assert history.at(1.05, no_aircraft) is not None
