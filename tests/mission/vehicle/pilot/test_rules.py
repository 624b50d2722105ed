from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.drone import Bounds, Knot, OrderState, Path
from mission.vehicle.limits import FlightSettings
from tests.support.fake_vehicle import FakeVehicle

OUT_AND_BACK = Path(
    (
        Knot(0.0, (0, 0, 0), (0, 0, 0)),
        Knot(2.0, (1.5, 0, 0), (1.0, 0, 0)),
        Knot(4.0, (3.0, 0, 0), (0, 0, 0)),
        Knot(8.0, (0, 0, 0), (0, 0, 0)),
    )
)


@pytest.fixture(params=["px4", "ardupilot"])
def vehicle(request: pytest.FixtureRequest) -> FakeVehicle:
    return FakeVehicle(request.param).airborne()


def _flying(vehicle: FakeVehicle, bounds: Bounds | None = None) -> FakeVehicle:
    vehicle.begin(bounds)
    order = vehicle.order("hover")
    vehicle.run(1.5)
    assert vehicle.state_of(order) is OrderState.DONE
    return vehicle


def test_take_off_arms_and_climbs_without_setpoints() -> None:
    for autopilot, mode in (("px4", None), ("ardupilot", "mode offboard")):
        vehicle = FakeVehicle(autopilot)  # type: ignore[arg-type]
        vehicle.run(0.2)
        vehicle.begin()
        order = vehicle.order("take-off", height_m=3.0)
        vehicle.run(1.0)
        assert vehicle.state_of(order) is OrderState.DONE
        assert vehicle.log == [*([mode] if mode else []), "arm", "take-off 3.0"]
        assert not vehicle.setpoints


def test_take_off_that_the_autopilot_refuses_says_why() -> None:
    vehicle = FakeVehicle("px4")
    vehicle.run(0.2)
    vehicle.obeys = False
    vehicle.begin()
    order = vehicle.order("take-off", height_m=3.0)
    vehicle.run(10.0)
    assert vehicle.state_of(order) is OrderState.REFUSED
    assert "does not arm: COMMAND_DENIED" in vehicle.reason_of(order)


def test_a_first_setpoint_that_was_lost_is_not_the_end() -> None:
    """PX4 denies Offboard until it has heard one: it is asked again, and no more once it is in the mode."""
    vehicle = FakeVehicle("px4").airborne()
    vehicle.begin()
    vehicle.obeys = False
    order = vehicle.order("hover")
    vehicle.run(0.5)
    assert vehicle.state_of(order) is OrderState.PENDING
    vehicle.obeys = True
    vehicle.run(2.5)
    assert vehicle.state_of(order) is OrderState.DONE
    assert vehicle.log.count("mode offboard") == 2


def test_nothing_flies_without_begin(vehicle: FakeVehicle) -> None:
    for order in (vehicle.order("hover"), vehicle.order("path", path=OUT_AND_BACK), vehicle.order("land")):
        assert vehicle.state_of(order) is OrderState.REFUSED
        assert "begin" in vehicle.reason_of(order)
    vehicle.run(1.0)
    assert vehicle.log == []


def test_out_and_back_is_flown_as_asked_from_where_it_hovers(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    order = vehicle.order("path", path=OUT_AND_BACK)
    began = vehicle.now_s
    vehicle.run(9.0)
    assert vehicle.state_of(order) is OrderState.DONE
    at = {round(t - began, 2): s for t, s, _ in vehicle.setpoints}
    middle = min(at, key=lambda t: abs(t - 2.0))
    assert at[middle].position_ned_m == pytest.approx([0.0, 1.5 + (middle - 2.0), -3.0], abs=1e-3)
    assert at[middle].velocity_ned_m_s == pytest.approx([0.0, 1.0, 0.0], abs=0.02)
    assert at[max(at)].position_ned_m == pytest.approx([0.0, 0.0, -3.0])
    steps = np.diff([t for t, _, _ in vehicle.setpoints])
    assert steps.max() <= 0.05, "20 Hz or more"


def test_heading_is_absolute_and_moves_to_the_latest_aim_no_faster_than_allowed(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    order = vehicle.order("turn", heading_rad=math.radians(-170))
    vehicle.run(8.0)
    assert vehicle.state_of(order) is OrderState.DONE
    assert vehicle.yaw == pytest.approx(math.radians(-170), abs=1e-3)
    vehicle.order("path", path=OUT_AND_BACK)
    vehicle.flight.aim(math.radians(170))
    vehicle.run(2.0)
    yaws = np.unwrap([yaw for _, _, yaw in vehicle.setpoints])
    assert np.abs(np.diff(yaws)).max() <= FlightSettings().max_yaw_rate_rad_s * 0.04 + 1e-9
    assert vehicle.yaw == pytest.approx(math.radians(170), abs=1e-3)


@pytest.mark.parametrize("mode", ["land", "return"])
def test_a_mode_that_we_did_not_order_ends_everything_and_is_never_undone(vehicle: FakeVehicle, mode: str) -> None:
    _flying(vehicle)
    order = vehicle.order("path", path=OUT_AND_BACK)
    vehicle.run(1.0)
    vehicle.log.clear()
    vehicle.switch(mode)
    vehicle.run(0.06)
    assert vehicle.state_of(order) is OrderState.ENDED
    assert len(vehicle.events("pilot")) == 1
    assert vehicle.log == ["release"], "silent, and no mode commanded"
    sent = len(vehicle.setpoints)
    again = vehicle.order("hover")
    vehicle.run(3.0)
    assert vehicle.state_of(again) is OrderState.REFUSED
    assert len(vehicle.setpoints) == sent
    assert vehicle.log == ["release"]
    vehicle.order("hold")
    vehicle.run(1.0)
    assert vehicle.log == ["release"], "hold does not take it from the pilot either"


def test_a_mode_change_between_begin_and_the_first_order_takes_the_permission_away(vehicle: FakeVehicle) -> None:
    vehicle.begin()
    vehicle.run(0.1)
    vehicle.switch("land")
    vehicle.run(0.1)
    vehicle.switch("hold")
    vehicle.run(0.1)
    assert vehicle.state_of(vehicle.order("hover")) is OrderState.REFUSED


def test_after_a_takeover_a_new_begin_flies_again(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    vehicle.switch("hold")
    vehicle.run(0.1)
    _flying(vehicle)


@pytest.mark.parametrize(("mask", "metres"), [(0, 20.0), (0xFFF8, 20.0), (0xFFF8, 1.0)])
def test_an_operators_fly_here_in_guided_ends_the_flight(mask: int, metres: float) -> None:
    vehicle = _flying(FakeVehicle("ardupilot").airborne())
    vehicle.run(1.0)
    latitude = round((37.0 + metres / 111_194.9) * 1e7)
    target = mavlink.MAVLink_position_target_global_int_message(
        0, 5, mask, latitude, round(127.0 * 1e7), 33.0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    vehicle.hear(target)
    vehicle.run(0.04)
    assert "sent to another place" in vehicle.events("pilot")[0].text
    assert vehicle.log[-1] == "release"


RIVAL = "another controller (77/9) sent SET_ATTITUDE_TARGET"


def test_a_strangers_packet_ends_nothing_while_the_vehicle_follows_us(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    order = vehicle.order("path", path=OUT_AND_BACK)
    vehicle.run(1.0)
    for _ in range(5):
        vehicle.flight.rival(RIVAL, vehicle.now_s)
        vehicle.run(0.2)
    vehicle.run(7.5)
    assert vehicle.state_of(order) is OrderState.DONE
    assert [event.text.split(";")[0] for event in vehicle.events("caution")] == [RIVAL]


def test_a_vehicle_that_follows_a_stranger_in_a_mode_of_ours_is_put_into_hold(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    vehicle.obeys = False
    for _ in range(60):
        vehicle.flight.rival(RIVAL, vehicle.now_s)
        vehicle.place = vehicle.place + np.array([0.05, 0.0, 0.0])
        vehicle.velocity = np.array([2.5, 0.0, 0.0])
        vehicle.run(0.02)
    assert RIVAL in vehicle.events("failsafe")[0].text
    assert "mode hold" in vehicle.log


def test_a_stranger_whom_the_autopilot_obeys_has_the_vehicle(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    vehicle.flight.rival("another controller sent it to another place", vehicle.now_s, obeyed=True)
    assert vehicle.log[-1] == "release"
    assert "the autopilot obeys it" in vehicle.events("pilot")[0].text


def test_another_controller_on_the_link_prevents_the_flight(vehicle: FakeVehicle) -> None:
    vehicle.begin()
    vehicle.flight.rival(RIVAL, vehicle.now_s)
    assert RIVAL in vehicle.reason_of(vehicle.order("hover"))


def test_a_stray_heartbeat_of_another_autopilot_ends_nothing(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    order = vehicle.order("path", path=OUT_AND_BACK)
    vehicle.run(1.0)
    for maker, kind in ((mavlink.MAV_AUTOPILOT_PX4, 2), (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 2), (18, 1)):
        ours = mavlink.MAV_AUTOPILOT_PX4 if vehicle.autopilot == "px4" else mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        if maker != ours:
            vehicle.hear(mavlink.MAVLink_heartbeat_message(kind, maker, 0, 0, mavlink.MAV_STATE_CRITICAL, 3))
            vehicle.run(0.1)
    vehicle.run(8.0)
    assert vehicle.state_of(order) is OrderState.DONE
    assert not vehicle.events("pilot") + vehicle.events("failsafe")


def test_a_silent_program_stops_the_vehicle_within_deadman_and_tick(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    order = vehicle.order("path", path=OUT_AND_BACK)
    vehicle.run(1.0)
    silent_since = vehicle.now_s
    vehicle.program_alive = False
    vehicle.run(0.7)
    assert 0.4 < vehicle.events("deadman")[0].t_s - silent_since < 0.5
    assert vehicle.log[-2:] == ["release", "mode hold"]
    assert not vehicle.streaming
    assert vehicle.state_of(order) is OrderState.ENDED
    vehicle.program_alive = True
    vehicle.run(0.5)
    assert vehicle.state_of(vehicle.order("hover")) is OrderState.REFUSED, "control was given back"


def test_a_silent_program_is_nothing_to_a_vehicle_that_we_do_not_fly(vehicle: FakeVehicle) -> None:
    vehicle.begin()
    vehicle.program_alive = False
    vehicle.run(3.0)
    assert vehicle.log == []


def test_a_lost_position_stops_the_setpoints(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    vehicle.silent = True
    vehicle.run(0.7)
    assert vehicle.events("link-lost")
    assert not vehicle.streaming


def test_a_low_battery_ends_the_flight(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    vehicle.battery = 19
    vehicle.run(0.1)
    assert "battery is at 19 %" in vehicle.events("failsafe")[0].text
    assert vehicle.log[-2:] == ["release", "mode hold"]


def test_the_time_allowed_ends_the_flight(vehicle: FakeVehicle) -> None:
    _flying(vehicle, Bounds(max_duration_s=4.0))
    vehicle.run(3.0)
    assert "time allowed (4 s)" in vehicle.events("failsafe")[0].text
    assert vehicle.log[-2:] == ["release", "mode hold"]


def test_a_vehicle_blown_out_of_its_bounds_is_stopped(vehicle: FakeVehicle) -> None:
    _flying(vehicle, Bounds(radius_m=5.0))
    vehicle.obeys = False
    vehicle.place = np.array([6.7, 0.0, -3.0])
    vehicle.run(0.1)
    assert "left its bounds" in vehicle.events("failsafe")[0].text


def test_hold_is_asked_again_until_the_autopilot_reports_it(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    vehicle.obeys = False
    order = vehicle.order("hold")
    vehicle.run(2.0)
    assert vehicle.state_of(order) is OrderState.FLYING
    assert vehicle.log.count("mode hold") == 3
    vehicle.obeys = True
    vehicle.run(1.0)
    assert vehicle.state_of(order) is OrderState.DONE
    assert not vehicle.streaming


def test_a_path_that_leaves_the_bounds_is_refused_whole_and_the_hover_goes_on(vehicle: FakeVehicle) -> None:
    _flying(vehicle, Bounds(radius_m=2.9))
    order = vehicle.order("path", path=OUT_AND_BACK)
    assert vehicle.state_of(order) is OrderState.REFUSED
    assert "more than 2.9 m" in vehicle.reason_of(order)
    vehicle.run(3.0)
    assert vehicle.place == pytest.approx([0, 0, -3])
    assert vehicle.flight.phase == "flying"


def test_an_autopilot_that_does_not_enter_the_mode_is_put_into_hold_again() -> None:
    vehicle = FakeVehicle("px4").airborne()
    vehicle.begin()
    vehicle.obeys = False
    order = vehicle.order("hover")
    vehicle.run(3.2)
    assert vehicle.state_of(order) is OrderState.REFUSED
    assert "does not let us fly it: COMMAND_DENIED" in vehicle.reason_of(order)
    assert not vehicle.streaming


def test_a_later_order_replaces_the_earlier_one(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    path = vehicle.order("path", path=OUT_AND_BACK)
    vehicle.run(2.0)
    hover = vehicle.order("hover")
    assert vehicle.state_of(path) is OrderState.ENDED
    vehicle.run(2.0)
    assert vehicle.state_of(hover) is OrderState.DONE
    assert vehicle.place[1] == pytest.approx(2.0, abs=0.05), "stopped ahead, where it can come to rest"


def test_land_after_hold_needs_no_new_begin(vehicle: FakeVehicle) -> None:
    _flying(vehicle)
    vehicle.order("hold")
    vehicle.run(0.2)
    order = vehicle.order("land")
    vehicle.run(0.2)
    assert vehicle.log[-1] == "mode land"
    vehicle.landed, vehicle.armed = mavlink.MAV_LANDED_STATE_ON_GROUND, False
    vehicle.run(0.1)
    assert vehicle.state_of(order) is OrderState.DONE


def _disarmed(v: FakeVehicle) -> None:
    v.armed = False


def _battery_low(v: FakeVehicle) -> None:
    v.battery = 15


def _no_fix(v: FakeVehicle) -> None:
    v.silent, v.state.gps_fix = True, 2


def _no_heading(v: FakeVehicle) -> None:
    v.silent, v.state.heading_known = True, False


def _too_high(v: FakeVehicle) -> None:
    v.place = np.array([0.0, 0.0, -40.0])


def _returning(v: FakeVehicle) -> None:
    v.switch("return")


def _aeroplane(v: FakeVehicle) -> None:
    v.silent, v.state.vehicle_type = True, mavlink.MAV_TYPE_FIXED_WING


REFUSALS: dict[str, Callable[[FakeVehicle], None]] = {
    "not armed and airborne": _disarmed,
    "battery is at 15 %": _battery_low,
    "position is not healthy": _no_fix,
    "heading is not healthy": _no_heading,
    "outside the allowed room": _too_high,
    "vehicle is in": _returning,
    "not a multicopter": _aeroplane,
}


@pytest.mark.parametrize("reason", REFUSALS)
def test_the_flight_is_refused_with_its_reason(vehicle: FakeVehicle, reason: str) -> None:
    REFUSALS[reason](vehicle)
    vehicle.run(0.1)
    vehicle.begin()
    order = vehicle.order("hover")
    assert vehicle.state_of(order) is OrderState.REFUSED
    assert reason in vehicle.reason_of(order)
    assert reason in vehicle.events("refused")[0].text
    assert vehicle.log == []


def test_px4_in_offboard_by_somebody_else_is_refused() -> None:
    vehicle = FakeVehicle("px4").airborne()
    vehicle.switch("offboard")
    vehicle.run(0.1)
    vehicle.begin()
    assert "another controller" in vehicle.reason_of(vehicle.order("hover"))
