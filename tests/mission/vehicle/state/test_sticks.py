"""In which mode control is given back: one with sticks only where the throttle stick rests in the middle."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.state.modes import mode_parameters
from mission.vehicle.state.vehicle_state import VehicleState
from tests.support.wired_vehicle import WiredVehicle

LOITER, BRAKE = 5.0, 17.0
RC = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER


def heard(state: VehicleState, message: mavlink.MAVLink_message, now_s: float) -> None:
    message._header = mavlink.MAVLink_header(message.id, srcSystem=1, srcComponent=1)
    state.update(message, now_s)


def vehicle(throttle_us: int, *, healthy: bool = True, channels: int = 8, at: int = 3) -> VehicleState:
    state = VehicleState(1)
    state.sticks.throttle_channel = at
    heard(state, mavlink.MAVLink_sys_status_message(RC, RC, RC * healthy, 0, 12_000, 0, 90, *[0] * 6), 10.0)
    pulses = [1100] * 18
    pulses[at - 1] = throttle_us
    heard(state, mavlink.MAVLink_rc_channels_message(0, channels, *pulses, 255), 10.0)
    return state


def rc_channels(throttle_us: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_rc_channels_message(0, 8, 1500, 1500, throttle_us, *[1500] * 15, 255)


@pytest.mark.parametrize(
    ("throttle_us", "rest"), [(1500, True), (1420, True), (1590, True), (1000, False), (1700, False), (65535, False)]
)
def test_a_stick_rests_where_it_neither_climbs_nor_sinks(throttle_us: int, rest: bool) -> None:
    assert vehicle(throttle_us).sticks.rest(10.5) is rest


def test_it_does_not_rest_where_it_is_not_known() -> None:
    assert not VehicleState(1).sticks.rest(10.0)
    assert not vehicle(1500, healthy=False).sticks.rest(10.5)
    assert not vehicle(1500, channels=0).sticks.rest(10.5)
    assert not vehicle(1500).sticks.rest(13.0), "it is old"
    assert vehicle(1500, at=2).sticks.rest(10.5)


@pytest.mark.parametrize(("sticks", "modes"), [(True, [LOITER, LOITER, BRAKE]), (False, [BRAKE, BRAKE, LOITER])])
def test_ardupilot_is_asked_for_the_other_hold_when_it_refuses_the_first(sticks: bool, modes: list[float]) -> None:
    assert [mode_parameters("ardupilot", "hold", attempt, sticks=sticks)[1] for attempt in range(3)] == modes


def test_px4_holds_in_hold_which_gives_way_to_the_sticks_by_itself() -> None:
    assert mode_parameters("px4", "hold", sticks=True) == mode_parameters("px4", "hold") == (1.0, 4.0, 3.0)


@pytest.mark.parametrize(
    ("throttle_us", "name", "said"), [(1500, "LOITER", "given back"), (1100, "BRAKE", "sticks do nothing in it")]
)
def test_control_comes_back_in_a_mode_with_sticks_where_they_rest(throttle_us: int, name: str, said: str) -> None:
    flown = WiredVehicle("ardupilot", "loiter")
    flown.begin()
    flown.order("hover")
    flown.run(1.5)
    told = vehicle(throttle_us).sticks
    told.take(rc_channels(throttle_us), flown.now_s)
    flown.state.sticks = told
    hold = flown.order("hold")
    flown.run(1.5)
    assert flown.state.mode.name == name
    assert said in flown.last(hold).reason
