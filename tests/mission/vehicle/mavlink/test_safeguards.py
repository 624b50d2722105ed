from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.settings import LinkSettings
from mission.vehicle.drone import Bounds, Knot, OrderState, Path
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.safeguards import Safeguards
from mission.vehicle.pilot.loopback import loopback_socket
from tests.support.fake_vehicle import FakeVehicle

INTEGERS = {"COM_OBL_RC_ACT", "COM_RC_OVERRIDE", "GF_ACTION"}
PX4 = {
    "COM_OBL_RC_ACT": 5.0,
    "COM_RC_OVERRIDE": 1.0,
    "GF_ACTION": 2.0,
    "GF_MAX_HOR_DIST": 20.0,
    "GF_MAX_VER_DIST": 10.0,
}
COPTER = {
    "FENCE_ENABLE": 1.0,
    "FENCE_TYPE": 7.0,
    "FENCE_RADIUS": 20.0,
    "FENCE_ALT_MAX": 10.0,
    "FENCE_ALT_MIN": -10.0,
    "FENCE_AUTOENABLE": 0.0,
    "FENCE_OPTIONS": 0.0,
    "GUID_TIMEOUT": 3.0,
    "RCMAP_THROTTLE": 3.0,
}
NO_FENCE = {"px4": {**PX4, "GF_ACTION": 0.0}, "ardupilot": {**COPTER, "FENCE_ENABLE": 0.0}}


def _wire(message: Any) -> Any:
    return mavlink.MAVLink(None).decode(bytearray(message.pack(mavlink.MAVLink(None, 1, 1))))


class Guarded(FakeVehicle):
    """A vehicle in the air with the parameters of its autopilot, and home 15 m to the south."""

    def __init__(self, autopilot: Any, **changes: float | None) -> None:
        super().__init__(autopilot)
        self.safeguards = Safeguards(self.state)
        self.loss: float | None = None
        self.flight._guards = self
        self.run(0.1)
        for name, value in {**(PX4 if autopilot == "px4" else COPTER), **changes}.items():
            if value is not None:
                self.tell(name, value)
        self.safeguards.take(_wire(mavlink.MAVLink_mission_count_message(1, 192, 0, mavlink.MAV_MISSION_TYPE_FENCE)))
        home = round((37.0 - 15.0 / 111_194.9) * 1e7), round(127.0 * 1e7), 30_000
        zeros = (0.0, 0.0, 0.0)
        self.safeguards.take(_wire(mavlink.MAVLink_home_position_message(*home, *zeros, [1.0, 0.0, 0.0, 0.0], *zeros)))

    def tell(self, name: str, value: float) -> None:
        """PARAM_VALUE: PX4 sends an integer's bytes."""
        if name in INTEGERS:
            raw, kind = struct.unpack("<f", struct.pack("<i", int(value)))[0], mavlink.MAV_PARAM_TYPE_INT32
        else:
            raw, kind = value, mavlink.MAV_PARAM_TYPE_REAL32
        self.safeguards.take(_wire(mavlink.MAVLink_param_value_message(name.encode(), raw, kind, 900, 65535)))

    def fence(self) -> Any:
        return self.safeguards.fence()

    def refusal(self, must_hold: bool) -> str | None:
        return self.safeguards.refusal(must_hold)

    def packet_loss(self, now_s: float) -> float | None:
        return self.loss


def _hover(vehicle: FakeVehicle) -> str:
    """Order to hover; the reason when it is refused."""
    vehicle.begin(Bounds())
    order = vehicle.order("hover")
    vehicle.run(1.5)
    return vehicle.reason_of(order)


def _north(metres: float) -> Path:
    return Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(8.0, (0, metres, 0), (0, 0, 0))))


@pytest.fixture(params=["px4", "ardupilot"])
def vehicle(request: pytest.FixtureRequest) -> Guarded:
    guarded = Guarded(request.param)
    guarded.airborne()
    return guarded


def test_a_path_through_the_geofence_is_refused_and_one_within_it_is_flown(vehicle: Guarded) -> None:
    assert _hover(vehicle) == ""
    order = vehicle.order("path", path=_north(3.5))
    assert "leave the geofence: 18" in vehicle.reason_of(order)
    order = vehicle.order("path", path=_north(2.8))
    vehicle.run(9.5)
    assert vehicle.state_of(order) is OrderState.DONE


def test_a_vehicle_too_near_to_the_geofence_or_its_ceiling_is_not_flown(vehicle: Guarded) -> None:
    vehicle.place = np.array([3.5, 0.0, -3.0])
    vehicle.run(0.1)
    assert "outside the allowed room: 18.5 m from home, the autopilot's geofence is at 20.0 m" in _hover(vehicle)
    vehicle.place = np.array([0.0, 0.0, -8.5])
    vehicle.run(0.1)
    assert "height 8.5 m, the autopilot's geofence is at 10.0 m" in _hover(vehicle)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_take_off_through_the_ceiling_of_the_geofence_is_refused(autopilot: str) -> None:
    vehicle = Guarded(autopilot)
    vehicle.begin()
    assert "take-off would leave the geofence" in vehicle.reason_of(vehicle.order("take-off", height_m=9.0))
    assert vehicle.log == []


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_fence_that_is_off_is_no_fence(autopilot: str) -> None:
    vehicle = Guarded(autopilot, **NO_FENCE[autopilot])
    assert vehicle.fence() is None
    assert _hover(vehicle.airborne()) == ""


def test_a_fence_of_which_only_the_ceiling_is_on_has_no_radius() -> None:
    fence = Guarded("ardupilot", FENCE_TYPE=1.0).fence()
    assert (fence.radius_m, fence.max_height_m) == (np.inf, 10.0)


@pytest.mark.parametrize(
    ("action", "refused", "cautioned"),
    [(5.0, False, False), (0.0, True, True), (3.0, True, True), (4.0, True, True), (6.0, True, True)],
)
def test_what_px4_would_do_without_setpoints_is_told_and_may_forbid_the_flight(
    action: float, refused: bool, cautioned: bool
) -> None:
    vehicle = Guarded("px4", COM_OBL_RC_ACT=action)
    assert ("COM_OBL_RC_ACT" in " ".join(vehicle.safeguards.cautions())) is cautioned
    assert ("COM_OBL_RC_ACT" in _hover(vehicle.airborne())) is refused
    assert (vehicle.safeguards.refusal(must_hold=False) is None) is (action not in (6.0, 7.0))


def _status(present: bool, enabled: bool) -> Any:
    geofence = mavlink.MAV_SYS_STATUS_GEOFENCE
    sensors = geofence * present, geofence * enabled, mavlink.MAV_SYS_STATUS_PREARM_CHECK
    return mavlink.MAVLink_sys_status_message(*sensors, 0, 12_000, 0, 90, *[0] * 6)


@pytest.mark.parametrize(
    ("enable", "auto", "told", "airborne", "on"),
    [
        (1.0, 0.0, None, True, True),
        (0.0, 0.0, None, True, False),
        (0.0, 0.0, True, True, True),  # by a switch, or by DO_FENCE_ENABLE
        (1.0, 0.0, False, True, False),  # switched off, or one that only reports
        (0.0, 3.0, False, False, True),  # when it arms
        (0.0, 1.0, None, False, True),
        (0.0, 1.0, False, True, False),
    ],
)
def test_the_fence_counts_that_ardupilot_enforces_or_will_enforce_when_armed(
    enable: float, auto: float, told: bool | None, airborne: bool, on: bool
) -> None:
    vehicle = Guarded("ardupilot", FENCE_ENABLE=enable, FENCE_AUTOENABLE=auto)
    if airborne:
        vehicle.airborne()
    vehicle.silent = True
    vehicle.hear(_status(told is not None, bool(told)))
    assert (vehicle.fence() is not None) is on


def test_versions_without_the_newer_parameters_are_asked_for_them_a_few_times_only() -> None:
    vehicle = Guarded("ardupilot", FENCE_AUTOENABLE=None, FENCE_OPTIONS=None)
    link = MavlinkLink(loopback_socket(), source_system=1, source_component=192, target_system=1)
    for _ in range(3):
        assert not vehicle.safeguards.known
        vehicle.run(0.42)
        vehicle.safeguards.ask(link, vehicle.now_s)
    link.close()
    assert vehicle.safeguards.known


def test_a_fence_across_the_date_line_is_round_home() -> None:
    vehicle = FakeVehicle("ardupilot").airborne()
    guards = Safeguards(vehicle.state)
    vehicle.silent = True
    vehicle.hear(
        mavlink.MAVLink_global_position_int_message(0, -177_000_000, -1_799_999_500, 30_000, 9_000, 0, 0, 0, 0)
    )
    for name, value in COPTER.items():
        guards.take(_wire(mavlink.MAVLink_param_value_message(name.encode(), value, 9, 10, 0)))
    home = -177_000_000, 1_799_999_500, 20_000
    guards.take(_wire(mavlink.MAVLink_home_position_message(*home, 0, 0, 0, [1.0, 0.0, 0.0, 0.0], 0, 0, 0)))
    fence = guards.fence()
    assert fence is not None
    here = vehicle.state.local
    assert here is not None
    assert np.linalg.norm(fence.centre_ned_m - here.position_ned_m[:2]) == pytest.approx(10.6, abs=0.1)


def test_sticks_that_do_nothing_in_px4s_hold_are_told() -> None:
    assert Guarded("px4").safeguards.cautions() == []
    (note,) = Guarded("px4", COM_RC_OVERRIDE=2.0).safeguards.cautions()
    assert "in Hold the sticks do nothing" in note


def test_a_long_guided_timeout_is_told() -> None:
    notes = Guarded("ardupilot", GUID_TIMEOUT=30.0).safeguards.cautions()
    assert "flies on for 30 s" in notes[0]
    assert Guarded("ardupilot").safeguards.cautions() == []


def test_nothing_flies_before_the_safeguards_are_known_and_silence_ends_the_asking() -> None:
    vehicle = Guarded("px4", COM_OBL_RC_ACT=None, GF_ACTION=None)
    vehicle.airborne()
    assert "not known yet" in _hover(vehicle)
    link = MavlinkLink(loopback_socket(), source_system=1, source_component=192, target_system=1)
    for _ in range(10):
        vehicle.run(0.42)
        vehicle.safeguards.ask(link, vehicle.now_s)
    link.close()
    assert vehicle.safeguards.known
    assert "does not tell what it does when setpoints stop" in vehicle.safeguards.cautions()[0]
    assert "does not tell its geofence" in vehicle.safeguards.cautions()[1]
    assert "COM_OBL_RC_ACT is not known" in _hover(vehicle)
    vehicle.flight._settings = LinkSettings(accept_failsafe=True).flight()
    assert _hover(vehicle) == ""


def test_what_was_never_answered_is_asked_for_again_when_an_order_begins() -> None:
    vehicle = Guarded("px4", COM_OBL_RC_ACT=None)
    asked: list[str] = []
    link = MavlinkLink(loopback_socket(), source_system=1, source_component=192, target_system=1)
    link.send = lambda message, **_: asked.append(message.get_type())  # type: ignore[method-assign]  # not the wire
    for _ in range(2):
        for _ in range(20):
            vehicle.run(0.42)
            vehicle.safeguards.ask(link, vehicle.now_s)
        vehicle.safeguards.order_begins()
    link.close()
    assert asked.count("PARAM_REQUEST_READ") == 13


def test_a_link_that_loses_too_much_refuses_the_flight_and_ends_one(vehicle: Guarded) -> None:
    vehicle.loss = 0.4
    assert "the link loses 40 % of the packets, more than 30 %" in _hover(vehicle)
    vehicle.loss = 0.2
    assert _hover(vehicle) == ""
    vehicle.loss = 0.4
    vehicle.run(0.1)
    assert "40 %" in vehicle.events("link-lost")[0].text
    assert not vehicle.streaming


def test_the_loss_is_named_beside_what_it_brings_about(vehicle: Guarded) -> None:
    """A hold that is not confirmed, an autopilot that is not heard and a mode that it does not take have one cause."""
    loss = "the link loses 40 % of the packets, more than 30 %"
    assert _hover(vehicle) == ""
    vehicle.loss, vehicle.obeys = 0.4, False
    vehicle.run(0.1)
    assert _hover(vehicle) == f"the vehicle is holding; {loss}"
    vehicle.run(9.0)
    assert "did not confirm to hold" in vehicle.events("failsafe")[0].text
    assert loss in vehicle.events("failsafe")[0].text
    vehicle.silent = True
    vehicle.run(4.0)
    assert _hover(vehicle) == f"the autopilot is not heard; {loss}"
    vehicle.loss = 0.2
    assert _hover(vehicle) == "the autopilot is not heard"


def test_a_guided_vehicle_that_moves_by_itself_is_somebody_elses() -> None:
    vehicle = FakeVehicle("ardupilot").airborne()
    vehicle.silent = True
    vehicle.hear(mavlink.MAVLink_local_position_ned_message(0, 0, 0, -3, 2.0, 0, 0))
    assert "another controller is flying it: in GUIDED it moves at 2.0 m/s" in _hover(vehicle)


def test_an_operator_may_accept_that_px4_does_not_hold() -> None:
    assert LinkSettings().flight().must_hold
    accepted = LinkSettings(accept_failsafe=True).flight()
    vehicle = Guarded("px4", COM_OBL_RC_ACT=0.0)
    assert "link.accept_failsafe" in _hover(vehicle.airborne())
    vehicle.flight._settings = accepted
    assert _hover(vehicle) == ""
