"""What two real autopilots reported, read by `VehicleState`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.pose_quality import noise_model, position_covariance
from mission.vehicle.pilot.takeover_detection import sent_elsewhere
from mission.vehicle.state.modes import ModeKind, flight_mode, mode_parameters
from mission.vehicle.state.vehicle_state import VEHICLE_MESSAGES, PositionTarget, VehicleState
from tests.support.tlog import ARDUCOPTER, PX4, messages


def _replay(path: Path, until_s: float = 1e9) -> tuple[VehicleState, list[float]]:
    """The state at a time after the start of the log, and the heights in the air."""
    state, heights, start = VehicleState(), [], None
    for arrived, message in messages(path):
        start = arrived if start is None else start
        if arrived - start > until_s:
            break
        if message.get_type() in VEHICLE_MESSAGES:
            state.update(message, arrived)
        if message.get_type() == "LOCAL_POSITION_NED" and state.height_m is not None:
            heights.append(state.height_m)
    return state, heights


@pytest.mark.parametrize(
    ("path", "modes"),
    [(ARDUCOPTER, ["GUIDED", "LOITER", "LAND"]), (PX4, ["Takeoff", "Hold", "Offboard", "Hold", "Land", "Hold"])],
    ids=["ardupilot", "px4"],
)
def test_the_modes_of_a_real_flight_are_seen_each_once_in_order(path: Path, modes: list[str]) -> None:
    state, _ = _replay(path)
    assert [mode.name for _, mode in state.take_mode_changes()] == modes
    assert state.take_mode_changes() == []


@pytest.mark.parametrize("path", [ARDUCOPTER, PX4], ids=["ardupilot", "px4"])
def test_a_real_vehicle_is_healthy_and_flies(path: Path) -> None:
    state, _ = _replay(path, until_s=16.0)
    now = state.attitude_s
    assert now is not None
    assert state.multicopter
    assert state.armed
    assert state.in_air
    assert state.position_ok(now)
    assert state.heading_ok(now)
    assert not state.position_ok(now + 2.0), "stale"
    assert state.battery_fraction is not None


@pytest.mark.parametrize("path", [ARDUCOPTER, PX4], ids=["ardupilot", "px4"])
@pytest.mark.parametrize("lost", ["EKF_STATUS_REPORT ESTIMATOR_STATUS", "GPS_RAW_INT", "LOCAL_POSITION_NED", ""])
def test_its_health_is_told_once_all_that_it_is_made_of_was_heard(path: Path, lost: str) -> None:
    state, start = VehicleState(), None
    for arrived, message in messages(path):
        start = arrived if start is None else start
        if arrived - start > 16.0:
            break
        if message.get_type() in VEHICLE_MESSAGES and message.get_type() not in lost.split():
            state.update(message, arrived)
    assert state.told is (lost == "")
    assert not VehicleState().told


@pytest.mark.parametrize("path", [ARDUCOPTER, PX4], ids=["ardupilot", "px4"])
def test_the_height_has_no_steps_though_px4_moves_its_home(path: Path) -> None:
    _, heights = _replay(path, until_s=26.0)
    hovering = np.array(heights)[-100:]
    assert hovering.mean() == pytest.approx(3.0, abs=0.5)
    assert np.abs(np.diff(heights)).max() < 0.15


def test_px4s_own_relative_altitude_does_step() -> None:
    relative = [m.relative_alt * 1e-3 for _, m in messages(PX4) if m.get_type() == "GLOBAL_POSITION_INT"]
    assert np.abs(np.diff(relative)).max() > 0.5, "if this ends, the detour over the local frame may end, too"


def test_the_noise_follows_the_gps_accuracy_that_is_reported() -> None:
    good, rough, unknown = _replay(ARDUCOPTER)[0], _replay(PX4)[0], VehicleState()
    assert noise_model(good).position_walk_m_per_sqrt_s == pytest.approx(0.03)
    assert noise_model(rough).position_walk_m_per_sqrt_s == pytest.approx(0.09)
    assert noise_model(rough).heading_sigma_rad > 4 * noise_model(good).heading_sigma_rad
    assert noise_model(unknown) == noise_model(rough), "nothing reported: the worse of the two"
    assert position_covariance(unknown)[0, 0] > position_covariance(good)[0, 0]


def test_broken_values_are_passed_over() -> None:
    state = _replay(PX4, until_s=16.0)[0]
    local, nan = state.local, float("nan")
    packer, parser = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None)
    for message in (
        mavlink.MAVLink_local_position_ned_message(0, nan, 0, 0, 0, 0, 0),
        mavlink.MAVLink_attitude_message(0, 0, 0, nan, 0, 0, 0),
        mavlink.MAVLink_global_position_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0, 0, 0),
    ):
        state.update(parser.decode(bytearray(message.pack(packer))), 1e9)
    assert state.local is local
    assert state.battery_fraction is None
    stranger = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 255, 190))
    mode = state.mode
    state.update(parser.decode(bytearray(stranger)), 1e9)
    assert state.mode == mode


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("kind", ["offboard", "hold", "land"])
def test_a_mode_that_is_asked_for_is_recognised_in_the_heartbeat(autopilot: str, kind: ModeKind) -> None:
    flag, two, three = mode_parameters(autopilot, kind)  # type: ignore[arg-type]
    assert flag == 1.0
    custom = int(two) << 16 | int(three) << 24 if autopilot == "px4" else int(two)
    assert flight_mode(autopilot, custom).kind == kind  # type: ignore[arg-type]


def test_unknown_modes_are_unknown() -> None:
    assert flight_mode("px4", 77 << 16).kind == "unknown"
    assert flight_mode("ardupilot", 4_000_000_000).kind == "unknown"
    assert flight_mode("other", 4).kind == "unknown"


def test_lost_heartbeats_are_borne_for_a_while_as_long_as_other_telemetry_comes() -> None:
    state, _ = _replay(PX4, 20.0)
    beat_s = state.heartbeat_s
    assert beat_s is not None
    assert state.connected(beat_s + 3.4)
    assert not state.connected(beat_s + 3.6), "all is silent"
    (attitude,) = [m for _, m in messages(PX4) if m.get_type() == "ATTITUDE"][:1]
    state.update(attitude, beat_s + 5.0)
    assert state.connected(beat_s + 5.5)
    state.update(attitude, beat_s + 6.4)
    assert not state.connected(beat_s + 6.6), "its mode is not known any more"


def _heartbeat(mode: str, number: int) -> mavlink.MAVLink_message:
    guided, loiter = 4, 5
    message = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED,
        guided if mode == "GUIDED" else loiter,
        mavlink.MAV_STATE_ACTIVE,
        3,
    )
    message._header = mavlink.MAVLink_header(message.id, srcSystem=1, srcComponent=1, seq=number % 256)
    return message


@pytest.mark.parametrize("number", [100, 255, 3])
def test_an_old_mode_that_was_overtaken_on_the_way_is_no_change(number: int) -> None:
    state = VehicleState()
    state.update(_heartbeat("LOITER", number - 60), 9.0)
    state.update(_heartbeat("GUIDED", number), 10.0)
    state.update(_heartbeat("LOITER", number - 2), 10.05)
    assert [mode.name for _, mode in state.take_mode_changes()] == ["GUIDED"]
    assert state.mode.name == "GUIDED"


def test_a_newer_mode_is_always_a_change_and_so_is_one_whose_number_has_come_round() -> None:
    state = VehicleState()
    for number, mode, now_s in ((100, "GUIDED", 10.0), (101, "LOITER", 10.01), (250, "GUIDED", 11.0)):
        state.update(_heartbeat(mode, number), now_s)
    state.update(_heartbeat("LOITER", 200), 12.0)
    assert [mode.name for _, mode in state.take_mode_changes()] == ["LOITER", "GUIDED", "LOITER"]


def _heard(message: mavlink.MAVLink_message) -> mavlink.MAVLink_message:
    message._header = mavlink.MAVLink_header(message.id, srcSystem=1, srcComponent=1)
    return message


def _gps(fix: int, alt_mm: int = 30_000, ellipsoid_mm: int = 0) -> mavlink.MAVLink_message:
    place = 372_276_000, 1_268_405_000, alt_mm
    return _heard(mavlink.MAVLink_gps_raw_int_message(0, fix, *place, 100, 100, 0, 0, 10, ellipsoid_mm, 500, 500, 0, 0))


def _gps2(fix: int, ellipsoid_mm: int = 0) -> mavlink.MAVLink_message:
    place = 372_276_000, 1_268_405_000, 30_000
    return _heard(
        mavlink.MAVLink_gps2_raw_message(0, fix, *place, 100, 100, 0, 0, 10, 0, 0, 0, ellipsoid_mm, 700, 500, 0, 0)
    )


def _estimating(state: VehicleState, now_s: float) -> None:
    state.update(_heartbeat("GUIDED", 0), now_s)
    state.update(_heard(mavlink.MAVLink_ekf_status_report_message(0x33F, 0, 0, 0, 0, 0)), now_s)
    place = 372_276_000, 1_268_405_000, 100_000, 10_000
    state.update(_heard(mavlink.MAVLink_global_position_int_message(0, *place, 0, 0, 0, 0)), now_s)
    state.update(_heard(mavlink.MAVLink_local_position_ned_message(0, 0, 0, -10, 0, 0, 0)), now_s)


def test_a_filter_that_flies_on_the_second_receiver_is_healthy() -> None:
    state = VehicleState()
    _estimating(state, 10.0)
    state.update(_gps(1), 10.0)
    assert not state.position_ok(10.1)
    state.update(_gps2(3, ellipsoid_mm=53_000), 10.0)
    assert state.position_ok(10.1)
    state.update(_gps(1), 10.2)
    assert state.position_ok(10.2)
    assert state.gps_accuracy_m == pytest.approx(0.7)
    assert state.geoid_separation_m == pytest.approx(23.0)


def test_a_second_receiver_that_fell_silent_counts_no_longer() -> None:
    state = VehicleState()
    state.update(_heartbeat("GUIDED", 0), 10.0)
    state.update(_gps2(3), 10.0)
    state.update(_gps(1), 16.0)
    assert state.gps_fix == 1


@pytest.mark.parametrize(
    ("alt_mm", "ellipsoid_mm", "separation_m"),
    [
        (30_000, 53_000, 23.0),
        (30_000, 30_000, None),
        (30_000, 0, None),
        (53_000, 30_000, -23.0),
        (30_000, 30_001, 1e-3),
    ],
)
def test_a_separation_of_exactly_nothing_is_not_known(
    alt_mm: int, ellipsoid_mm: int, separation_m: float | None
) -> None:
    state = VehicleState()
    state.update(_heartbeat("GUIDED", 0), 10.0)
    state.update(_gps(3, alt_mm, ellipsoid_mm), 10.0)
    assert state.geoid_separation_m == (None if separation_m is None else pytest.approx(separation_m))


@pytest.mark.parametrize(("at_e7", "target_e7"), [(1_799_999_900, -1_799_999_900), (-1_799_999_900, 1_799_999_900)])
def test_a_target_across_the_date_line_is_near(at_e7: int, target_e7: int) -> None:
    state = VehicleState()
    state.update(_heartbeat("GUIDED", 0), 10.0)
    state.update(_heard(mavlink.MAVLink_global_position_int_message(0, 0, at_e7, 0, 0, 0, 0, 0, 0)), 10.0)
    state.update(_heard(mavlink.MAVLink_local_position_ned_message(0, 0, 0, -10, 0, 0, 0)), 10.0)
    there = state.local_of(0.0, target_e7 * 1e-7)
    assert there is not None
    assert abs(there[1]) == pytest.approx(2.2, abs=0.1)
    state.position_target = PositionTarget(11.0, 0.0, target_e7 * 1e-7, False)
    assert sent_elsewhere(state, np.array([0.0, 0.0, -10.0]), 10.5) is None
    assert sent_elsewhere(state, np.array([0.0, -4.0 * np.sign(there[1]), -10.0]), 10.5) is not None


def test_another_autopilot_is_believed_once_the_known_one_is_silent() -> None:
    state = VehicleState(1)

    def known_after(maker: int, now_s: float) -> str:
        state.update(_heard(mavlink.MAVLink_heartbeat_message(2, maker, 0, 0, 4, 3)), now_s)
        return state.autopilot

    assert known_after(mavlink.MAV_AUTOPILOT_PX4, 10.0) == "px4"
    assert known_after(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 10.5) == "px4"
    assert known_after(mavlink.MAV_AUTOPILOT_PX4, 11.0) == "px4"
    assert known_after(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 15.0) == "ardupilot"


def test_a_report_that_is_repeated_or_overtaken_is_no_new_one() -> None:
    state = VehicleState(1)
    state.update(_heard(mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 4, 3)), 10.0)
    for now_s, boot_ms, north in ((10.0, 5000, 1.0), (10.1, 5000, 1.0), (10.2, 4980, 0.9)):
        state.update(_heard(mavlink.MAVLink_local_position_ned_message(boot_ms, north, 0, -3, 0, 0, 0)), now_s)
    assert state.local is not None
    assert state.local.t_s == 10.0
    state.update(_heard(mavlink.MAVLink_local_position_ned_message(20, 0, 0, -3, 0, 0, 0)), 10.3)
    assert state.local.t_s == 10.3, "the autopilot was started again"
