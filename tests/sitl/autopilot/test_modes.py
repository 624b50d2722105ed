"""Arming, modes, offboard and its loss, take-over and failsafes, as autopilots.md has them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flavour import Mode
from tests.support.autopilot_bench import Bench, setpoint, velocity_step

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
EAST = velocity_step(2.0, 99.0)


def test_px4_does_not_arm_before_its_position_is_good(px4: Bench) -> None:
    px4.run(1.0)
    assert px4.peer.command(ARM, 1) == REJECTED
    px4.run(2.5)
    assert px4.peer.command(ARM, 1) == ACCEPTED


def test_ardupilot_arms_in_stabilize_before_gps_is_good_but_guided_is_refused(ardupilot: Bench) -> None:
    ardupilot.run(1.0)
    assert ardupilot.peer.set_mode(4) == FAILED
    assert ardupilot.peer.command(ARM, 1) == ACCEPTED


def test_motors_left_idle_are_disarmed(bench: Bench) -> None:
    bench.run(3.5)
    if bench.autopilot.flavour.name == "ardupilot":
        bench.peer.set_mode(4)
    bench.peer.command(ARM, 1)
    bench.run(10.5)
    assert not bench.autopilot.commander.armed


def test_disarming_in_the_air_needs_force(bench: Bench) -> None:
    bench.hover()
    assert bench.peer.command(ARM, 0) in (DENIED, FAILED)
    assert bench.peer.command(ARM, 0, 21196) == ACCEPTED
    bench.run(1.5)
    assert bench.height() < 0.5


def test_px4_enters_offboard_only_while_setpoints_stream(px4: Bench) -> None:
    px4.hover()
    assert px4.peer.set_mode(6) == REJECTED
    px4.run(0.3, EAST)
    assert px4.peer.set_mode(6) == ACCEPTED
    px4.peer.set_mode(4, 3)
    px4.run(1.0)
    assert px4.peer.set_mode(6) == REJECTED  # the last one is a second old


@pytest.mark.parametrize(
    ("action", "mode"), [(0, Mode.POSITION), (3, Mode.RTL), (4, Mode.LAND), (5, Mode.HOLD)], ids=["0", "3", "4", "5"]
)
def test_px4_fails_safe_one_second_after_the_last_setpoint(action: int, mode: Mode) -> None:
    bench = Bench(AutopilotConfig(flavour="px4", parameters=(("COM_OBL_RC_ACT", action),)))
    bench.hover()
    bench.enter_offboard(EAST)
    bench.run(1.0, EAST)
    bench.run(0.9)
    assert bench.autopilot.commander.mode is Mode.OFFBOARD
    bench.run(0.2)
    assert bench.autopilot.commander.mode is mode
    bench.run(0.5, EAST)  # setpoints that come back do not take the aircraft back
    assert bench.autopilot.commander.mode is mode
    bench.run(1.1)
    assert bench.peer.of("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_CRITICAL
    assert any("Failsafe" in text for text in bench.peer.texts())


def test_px4_without_sticks_comes_down_drifting_and_disarms(px4: Bench) -> None:
    """As a real one at COM_OBL_RC_ACT's default: 3 m of drift in 3 s, landed after 4 s, disarmed after 6 s."""
    px4.hover(1.6)
    px4.enter_offboard(EAST)
    px4.run(2.0, EAST)
    px4.run(1.1)
    px4.path()
    px4.run(3.0)
    path = px4.path()
    speed = np.hypot(path[:, 4], path[:, 5])
    assert 1.0 < speed[: len(speed) // 2].max() < 3.0
    assert 1.5 < np.hypot(*(path[-1, 1:3] - path[0, 1:3])) < 6.0
    assert path[-1, 3] < 0.3
    px4.run(6.0)
    assert px4.autopilot.commander.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
    assert not px4.autopilot.commander.armed
    assert px4.autopilot.commander.mode is Mode.OFFBOARD


def test_ardupilot_keeps_the_last_velocity_three_seconds_then_hovers_in_guided(ardupilot: Bench) -> None:
    ardupilot.hover()
    ardupilot.enter_offboard(EAST)
    ardupilot.run(2.0, EAST)
    ardupilot.run(2.8)
    assert ardupilot.autopilot.vehicle.airframe.velocity[0] > 1.8
    ardupilot.run(4.0)
    assert abs(ardupilot.autopilot.vehicle.airframe.velocity[0]) < 0.2
    assert ardupilot.autopilot.commander.mode is Mode.OFFBOARD


def test_ardupilot_position_targets_have_no_timeout(ardupilot: Bench) -> None:
    ardupilot.hover()
    ardupilot.peer.send(setpoint(position_ned=(0.0, 3.0, -3.0), yaw=0.0))
    ardupilot.run(6.0)
    assert ardupilot.autopilot.truth.position_enu_m[0] == pytest.approx(3.0, abs=0.4)


def test_px4_acknowledges_position_without_a_remote_control_and_stays_in_offboard(px4: Bench) -> None:
    px4.hover()
    px4.enter_offboard(EAST)
    assert px4.peer.set_mode(3) == ACCEPTED
    px4.run(0.2, EAST)
    assert px4.autopilot.commander.mode is Mode.OFFBOARD
    with_rc = Bench(AutopilotConfig(flavour="px4", rc=True))
    with_rc.hover()
    assert with_rc.peer.set_mode(3) == ACCEPTED
    assert with_rc.autopilot.commander.mode is Mode.POSITION


@pytest.mark.parametrize("number", [5, 16, 17])
def test_an_operators_mode_change_stops_ardupilot_while_setpoints_go_on(ardupilot: Bench, number: int) -> None:
    ardupilot.hover()
    ardupilot.enter_offboard(EAST)
    ardupilot.run(2.0, EAST)
    assert ardupilot.peer.set_mode(number) == ACCEPTED
    ardupilot.peer.received.clear()
    ardupilot.run(0.02, EAST)
    assert ardupilot.peer.of("HEARTBEAT")[0].custom_mode == number  # at once
    ardupilot.run(3.0, EAST)
    assert math.hypot(*ardupilot.autopilot.vehicle.airframe.velocity[:2]) < 0.2


def test_px4_shows_a_take_over_in_its_heartbeat_up_to_a_second_late_but_in_current_mode_at_once(px4: Bench) -> None:
    px4.hover()
    assert px4.peer.ask_rate(mavlink.MAVLINK_MSG_ID_CURRENT_MODE, 20.0) == ACCEPTED
    px4.enter_offboard(EAST)
    px4.run(1.0, EAST)
    while not px4.peer.of("HEARTBEAT"):
        px4.run(0.05, EAST)
    px4.peer.received.clear()
    px4.peer.set_mode(4, 3)
    px4.run(0.1, EAST)
    assert px4.peer.of("CURRENT_MODE")[-1].custom_mode == 0x3040000
    assert len(px4.peer.of("HEARTBEAT")) == 0 or px4.peer.of("HEARTBEAT")[0].custom_mode == 0x3040000
    px4.run(1.0, EAST)
    assert px4.peer.of("HEARTBEAT")[-1].custom_mode == 0x3040000


def test_offboard_during_the_climb_cuts_it_short(bench: Bench) -> None:
    bench.fly_up(seconds=6.0 if bench.autopilot.flavour.name == "px4" else 3.2)
    stay = velocity_step(0.0, 0.0)
    bench.enter_offboard(stay)
    bench.run(3.0, stay)
    assert 0.2 < bench.height() < 2.6


def test_nav_takeoff_is_refused_by_ardupilot_unless_armed_in_guided(ardupilot: Bench) -> None:
    ardupilot.run(3.5)
    takeoff = (mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3.0)
    assert ardupilot.peer.command(*takeoff) == FAILED
    ardupilot.peer.command(ARM, 1)
    assert ardupilot.peer.command(*takeoff) == FAILED


def test_landing_ends_on_the_ground_disarmed(bench: Bench) -> None:
    bench.hover(1.5)
    assert bench.peer.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
    bench.run(0.5)
    assert bench.autopilot.commander.landed_state == mavlink.MAV_LANDED_STATE_LANDING
    bench.run(8.0)
    assert bench.height() == pytest.approx(0.0, abs=0.01)
    assert not bench.autopilot.commander.armed


def test_return_flies_home_and_lands(bench: Bench) -> None:
    bench.hover(1.5)
    bench.autopilot.vehicle.place((3.5, 2.0, 1.5))
    bench.autopilot.parameters.set_number("RTL_RETURN_ALT" if bench.autopilot.flavour.name == "px4" else "RTL_ALT", 4.0)
    assert bench.peer.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
    bench.run(13.0)
    assert math.hypot(*bench.autopilot.vehicle.airframe.position[:2]) < 1.5
    assert not bench.autopilot.commander.armed


def test_fly_here_moves_the_aircraft_and_shows_in_the_global_target(bench: Bench) -> None:
    bench.hover()
    lat, lon, _ = bench.autopilot.place.geodetic((0.0, 3.0, 0.0))
    ack = bench.peer.command(192, -1, 1, 0, math.nan, lat, lon, bench.autopilot.place.alt_amsl_m + 4.0)
    assert ack == ACCEPTED
    bench.run(0.1)
    bench.peer.received.clear()
    bench.peer.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT)
    bench.run(6.0)
    assert bench.autopilot.truth.position_enu_m[1] == pytest.approx(3.0, abs=0.5)
    assert bench.height() == pytest.approx(4.0, abs=0.4)
    assert bench.autopilot.commander.mode in (Mode.HOLD, Mode.OFFBOARD)
    assert bench.peer.of("POSITION_TARGET_GLOBAL_INT")


def test_ardupilot_tells_its_target_only_while_it_goes_to_a_place_by_itself(ardupilot: Bench) -> None:
    def stream(_: float) -> Any:
        return setpoint(position_ned=(0.0, 0.0, -3.0), velocity_ned=(0.0, 0.0, 0.0), yaw=0.0)

    ardupilot.hover()
    ardupilot.peer.ask_rate(mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT, 50.0)
    ardupilot.enter_offboard(stream)
    ardupilot.peer.received.clear()
    ardupilot.run(0.5, stream)
    assert ardupilot.peer.of("POSITION_TARGET_GLOBAL_INT") == [], "ModeGuided::get_wp: not while it follows setpoints"
    lat, lon, _ = ardupilot.autopilot.place.geodetic((0.0, 30.0, 0.0))
    ardupilot.peer.command(192, -1, 1, 0, math.nan, lat, lon, ardupilot.autopilot.place.alt_amsl_m + 4.0)
    ardupilot.run(0.1)
    told = ardupilot.peer.of("POSITION_TARGET_GLOBAL_INT")[-1]
    assert (told.lat_int, told.lon_int) == pytest.approx((lat * 1e7, lon * 1e7), abs=60), "single precision"
    assert told.type_mask & 0x38 == 0x38, "a place, no velocity"


def test_a_low_battery_is_a_failsafe_when_the_parameter_says_so(bench: Bench) -> None:
    bench.hover()
    px4 = bench.autopilot.flavour.name == "px4"
    bench.autopilot.commander.battery_fraction = 0.1
    bench.run(0.1)
    assert bench.autopilot.commander.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR  # by default only a warning
    assert any("attery" in text for text in bench.peer.texts())
    bench.autopilot.commander.battery_fraction = 0.5
    bench.autopilot.parameters.set_number("COM_LOW_BAT_ACT" if px4 else "BATT_FS_LOW_ACT", 2 if px4 else 1)
    bench.run(0.1)
    bench.autopilot.commander.battery_fraction = 0.1
    bench.run(0.1)
    assert bench.autopilot.commander.mode is Mode.LAND


def test_a_geofence_stops_the_flight(bench: Bench) -> None:
    px4 = bench.autopilot.flavour.name == "px4"
    for name, value in (
        [("GF_MAX_HOR_DIST", 4.0)] if px4 else [("FENCE_ENABLE", 1), ("FENCE_RADIUS", 4.0), ("FENCE_ACTION", 4)]
    ):
        bench.autopilot.parameters.set_number(name, value)
    bench.hover()
    bench.enter_offboard(EAST)
    bench.run(5.0, EAST)
    assert bench.autopilot.commander.mode is (Mode.HOLD if px4 else Mode.BRAKE)
    assert bench.autopilot.truth.position_enu_m[0] < 8.0


def test_a_region_of_interest_is_remembered_and_turns_the_nose_in_ardupilot_guided_only(bench: Bench) -> None:
    bench.hover()
    px4 = bench.autopilot.flavour.name == "px4"
    lat, lon, alt = bench.autopilot.place.geodetic((20.0, 0.0, 1.0))
    assert bench.peer.command(mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0, 0, lat, lon, alt) == ACCEPTED
    assert bench.autopilot.commander.roi == pytest.approx((20.0, 0.0, 1.0), abs=1.0)  # float32 degrees
    bench.run(4.0)
    assert bench.heading_deg() == pytest.approx(0.0 if px4 else 90.0, abs=6.0)
    bench.peer.send(
        mavlink.MAVLink_command_int_message(
            1, 1, 6, mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0, 0, 0, 0, round(lat * 1e7), round(lon * 1e7), 2.0
        )
    )
    roi = bench.autopilot.commander.roi
    assert roi is not None
    assert roi[2] == pytest.approx(bench.autopilot.home_up + 2.0, abs=0.01)  # frame 6: above home
    assert bench.peer.command(mavlink.MAV_CMD_DO_SET_ROI_NONE) == ACCEPTED
    assert bench.autopilot.commander.roi is None


def test_a_region_of_interest_is_lost_by_ardupilot_s_next_setpoint_and_by_px4_s_next_mission(bench: Bench) -> None:
    bench.hover()
    lat, lon, alt = bench.autopilot.place.geodetic((20.0, 0.0, 1.0))
    assert bench.peer.command(mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0, 0, lat, lon, alt) == ACCEPTED
    bench.peer.send(setpoint(position_ned=(0.0, 0.0, -3.0), yaw=0.0))
    px4 = bench.autopilot.flavour.name == "px4"
    assert (bench.autopilot.commander.roi is not None) is px4
    bench.autopilot.commander.has_mission = True
    bench.autopilot.commander.request_mode(Mode.MISSION, bench.now)
    assert bench.autopilot.commander.roi is None


def test_px4_tells_its_mode_twice_a_second_whatever_is_asked_for(px4: Bench) -> None:
    px4.hover()
    assert px4.peer.ask_rate(mavlink.MAVLINK_MSG_ID_CURRENT_MODE, 20.0) == ACCEPTED
    px4.run(1.0)
    px4.peer.received.clear()
    px4.run(10.0)
    assert 17 <= len(px4.peer.of("CURRENT_MODE")) <= 19


def test_condition_yaw_turns_ardupilot_only(bench: Bench) -> None:
    bench.hover()
    px4 = bench.autopilot.flavour.name == "px4"
    assert bench.peer.command(mavlink.MAV_CMD_CONDITION_YAW, 60, 20, 1, 0) == (UNSUPPORTED if px4 else ACCEPTED)
    bench.run(3.0)
    assert bench.heading_deg() == pytest.approx(0.0 if px4 else 60.0, abs=6.0)


def test_a_position_at_home_stays_put_and_a_nonsense_setpoint_changes_nothing(bench: Bench) -> None:
    bench.hover()
    before = bench.autopilot.commander.setpoint
    bench.peer.send(setpoint(position_ned=(math.nan, math.nan, math.nan), yaw=0.0))
    bench.peer.send(setpoint(velocity_ned=(1.0, 0.0, 0.0), frame=77))
    assert bench.autopilot.commander.setpoint is before
