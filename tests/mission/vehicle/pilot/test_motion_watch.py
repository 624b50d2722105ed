"""Estimators that jump, freeze or fail in flight: the vehicle is put into hold before it is faster than allowed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.records import Vector
from mission.vehicle.drone import Bounds, Knot, OrderState, Path
from mission.vehicle.limits import FlightSettings
from mission.vehicle.path_follower import Setpoint
from mission.vehicle.pilot.motion_watch import MotionWatch
from mission.vehicle.state.vehicle_state import VEHICLE_MESSAGES, LocalState, VehicleState
from tests.support.fake_vehicle import TICK_S, FakeVehicle
from tests.support.tlog import ARDUCOPTER, PX4, messages

LIMIT_M_S = 3.0
BOUNDS = Bounds(radius_m=30.0, max_speed_m_s=LIMIT_M_S)
PATTERN = Path(
    (
        Knot(0.0, (0, 0, 0), (0, 0, 0)),
        Knot(2.0, (2.5, 0, 0), (2.0, 0, 0)),
        Knot(4.0, (5.0, 0, 0), (0, 0, 0)),
        Knot(8.0, (0, 0, 0), (0, 0, 0)),
    )
)
MOMENTS_S = (0.3, 1.7, 5.2)
"""Into the pattern."""
_POSITION_GAIN = 1.0
_LAG_S = 0.4
_FASTEST_M_S = 10.0


class Chaser(FakeVehicle):
    """A multicopter whose autopilot chases setpoints by its estimate, which may be off from where it truly is.

    Position gain 1/s on top of the velocity asked for, reached with a lag of 0.4 s, as fast as 10 m/s: what autopilots
    do by default. `place` and `velocity` are as reported; `true_velocity` is in true axes.
    """

    off: Vector
    heading_off = 0.0
    fastest_m_s = 0.0
    true_velocity: Vector
    true_place: Vector

    def begin_truth(self) -> Chaser:
        self.off, self.true_velocity, self.true_place = np.zeros(3), np.zeros(3), self.place.copy()
        return self

    def run(self, seconds: float) -> None:
        if not hasattr(self, "off"):
            super().run(seconds)
            return
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self._chase()
            self._tell()
            self.flight.heard(self.now_s)
            self.flight.step(self.now_s)

    def _chase(self) -> None:
        turn = np.array(
            [
                [math.cos(self.heading_off), -math.sin(self.heading_off), 0.0],
                [math.sin(self.heading_off), math.cos(self.heading_off), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        wanted = np.zeros(3)
        if self.streaming and self.custom_mode == self._code("offboard"):
            _, setpoint, yaw = self.setpoints[-1]
            wanted = setpoint.velocity_ned_m_s + _POSITION_GAIN * (setpoint.position_ned_m - self.place)
            wanted = wanted * min(1.0, _FASTEST_M_S / max(1e-9, float(np.linalg.norm(wanted))))
            self.yaw += max(-1.0, min(1.0, 3.0 * math.remainder(yaw - self.yaw, math.tau))) * TICK_S
        # What it accelerates along by its own axes is turned by the error of its heading.
        self.true_velocity = self.true_velocity + turn @ (wanted - self.velocity) * (TICK_S / _LAG_S)
        self.true_place = self.true_place + TICK_S * self.true_velocity
        self.velocity, self.place = self.true_velocity.copy(), self.true_place + self.off
        self.fastest_m_s = max(self.fastest_m_s, float(np.linalg.norm(self.true_velocity)))


def _chaser(autopilot: str = "px4") -> Chaser:
    chaser = Chaser(autopilot)  # type: ignore[arg-type]
    chaser.airborne()
    chaser.begin_truth()
    chaser.begin(BOUNDS)
    hover = chaser.order("hover")
    chaser.run(1.5)
    assert chaser.state_of(hover) is OrderState.DONE
    return chaser


def _jump(chaser: Chaser, metres: float, bearing_rad: float, turn_rad: float) -> None:
    step = metres * np.array([math.cos(bearing_rad), math.sin(bearing_rad), 0.0])
    chaser.off = chaser.off + step
    chaser.place = chaser.place + step
    chaser.heading_off += turn_rad
    chaser.yaw += turn_rad
    chaser._last_yaw += turn_rad  # the gyroscopes feel nothing


def _flown_with(metres: float, degrees: float, into_s: float, bearing_rad: float) -> tuple[Chaser, int]:
    chaser = _chaser()
    order = chaser.order("path", path=PATTERN)
    chaser.run(into_s)
    _jump(chaser, metres, bearing_rad, math.radians(degrees))
    chaser.run(8.0 if not metres and not degrees else 4.0)
    return chaser, order


def test_a_pattern_without_a_fault_is_flown_to_its_end() -> None:
    chaser, order = _flown_with(0.0, 0.0, 1.0, 0.0)
    assert chaser.state_of(order) is OrderState.DONE
    assert chaser.fastest_m_s < LIMIT_M_S


@pytest.mark.parametrize("metres", [0.3, 0.6, 1.0, 2.0, 3.0, 6.0, 12.0])
def test_a_position_step_never_makes_it_faster_than_allowed(metres: float) -> None:
    for into_s, bearing in itertools.product(MOMENTS_S, (0.0, 2.0)):
        chaser, order = _flown_with(metres, 0.0, into_s, bearing)
        assert chaser.fastest_m_s < LIMIT_M_S, f"{into_s} s into the pattern"
        if metres >= 1.0:
            assert chaser.state_of(order) is OrderState.ENDED
            assert f"jumped by {metres:.1f} m" in chaser.reason_of(order)
            assert chaser.log[-1] == "mode hold"
            assert not chaser.streaming


@pytest.mark.parametrize("degrees", [5.0, 10.0, 20.0, 45.0, 90.0])
def test_a_heading_step_never_makes_it_faster_than_allowed(degrees: float) -> None:
    for into_s, sign in itertools.product(MOMENTS_S, (-1.0, 1.0)):
        chaser, order = _flown_with(0.0, sign * degrees, into_s, 0.0)
        assert chaser.fastest_m_s < LIMIT_M_S, f"{into_s} s into the pattern"
        if degrees >= 10.0:
            assert "heading jumped by" in chaser.reason_of(order)
            assert chaser.log[-1] == "mode hold"


def test_a_step_while_it_turns_and_while_reports_are_lost_is_seen() -> None:
    for lost_s in (0.0, 0.3):
        chaser = _chaser()
        order = chaser.order("turn", heading_rad=3.0)
        chaser.run(0.5)
        assert chaser.state_of(order) is OrderState.FLYING
        chaser.now_s += lost_s
        _jump(chaser, 0.0, 0.0, math.radians(40.0))
        chaser.run(0.1)
        assert chaser.state_of(order) is OrderState.ENDED


def test_a_vehicle_that_is_late_on_its_path_is_not_off_it() -> None:
    """A real PX4 is 2 m behind a setpoint that moves at 2 m/s."""
    state = FakeVehicle("px4").airborne().state
    watch = MotionWatch(FlightSettings(), 200.0)
    for i in range(200):
        now_s = 200.0 + 0.02 * i
        target = Setpoint(np.array([2.0 * 0.02 * i, 0.0, -3.0]), np.array([2.0, 0.0, 0.0]))
        here = np.array([max(0.0, 2.0 * (0.02 * i - 0.95)), 0.0, -3.0])
        velocity = np.array([2.0 if here[0] > 0.0 else 0.0, 0.0, 0.0])
        state.local = LocalState(now_s, here, velocity, now_s)
        assert watch.step(state, target, LIMIT_M_S, now_s) is None


def test_a_vehicle_that_is_too_fast_or_too_far_off_is_stopped() -> None:
    chaser = _chaser()
    order = chaser.order("path", path=PATTERN)
    chaser.run(1.0)
    chaser.true_velocity = np.array([0.0, LIMIT_M_S + 1.2, 0.0])
    chaser.run(0.1)
    assert "the limit is 3.0 m/s" in chaser.reason_of(order)

    chaser = _chaser()
    order = chaser.order("hover")
    for _ in range(10):  # wind carries it away, slowly enough for the speed
        chaser.true_velocity = np.array([2.5, 0.0, 0.0])
        chaser.run(0.2)
    assert "from where it should be" in chaser.events("failsafe")[0].text
    assert chaser.log[-1] == "mode hold"


def _no_fix(vehicle: FakeVehicle) -> None:
    vehicle.fix = 2


def _nowhere(vehicle: FakeVehicle) -> None:
    vehicle.nowhere = True


def _doubted(vehicle: FakeVehicle) -> None:
    vehicle.estimator = 0x27 if vehicle.autopilot == "px4" else 831 & ~0x10


def _constant(vehicle: FakeVehicle) -> None:
    vehicle.estimator = 0x27 if vehicle.autopilot == "px4" else 831 | 0x80


def _frozen(vehicle: FakeVehicle) -> None:
    vehicle.boot_s = vehicle.now_s


FAULTS: dict[str, Callable[[FakeVehicle], None]] = {
    "GPS fix": _no_fix,
    "place on earth": _nowhere,
    "does not vouch": _doubted,
    "estimator": _constant,
    "stand still": _frozen,
}


@pytest.mark.parametrize("said", FAULTS)
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_pose_that_is_not_vouched_for_any_more_ends_the_pattern_in_hold(autopilot: str, said: str) -> None:
    vehicle = FakeVehicle(autopilot).airborne()  # type: ignore[arg-type]
    vehicle.begin()
    vehicle.order("hover")
    vehicle.run(1.5)
    order = vehicle.order("path", path=PATTERN)
    vehicle.run(1.0)
    FAULTS[said](vehicle)
    vehicle.run(1.8)
    assert vehicle.state_of(order) is OrderState.ENDED
    assert said in vehicle.reason_of(order)
    assert vehicle.log[-1] == "mode hold"


def test_a_moving_vehicle_that_says_the_same_again_and_again_tells_nothing_new() -> None:
    state = FakeVehicle("px4").airborne().state
    for i in range(50):
        message = mavlink.MAVLink_local_position_ned_message(200_000 + 20 * i, 1.0, 2.0, -3.0, 1.0, 0.0, 0.0)
        packed = message.pack(mavlink.MAVLink(None, 1, 1))
        state.update(mavlink.MAVLink(None).decode(bytearray(packed)), 200.0 + 0.02 * i)
    assert state.local is not None
    assert state.local.t_s == pytest.approx(200.0)
    assert state.stands_still(201.0)


@pytest.mark.parametrize("path", [ARDUCOPTER, PX4], ids=["ardupilot", "px4"])
def test_real_estimators_are_not_taken_for_ones_that_jump(path: FilePath) -> None:
    state, watch = VehicleState(), MotionWatch(FlightSettings(), 0.0)
    for arrived, message in messages(path):
        if message.get_type() not in VEHICLE_MESSAGES:
            continue
        state.update(message, arrived)
        if state.in_air and state.local is not None:
            assert watch.fault(state, arrived) is None
            assert watch.step(state, _here(state), 20.0, arrived) is None


def _here(state: VehicleState) -> Setpoint:
    assert state.local is not None
    return Setpoint(state.local.position_ned_m, np.zeros(3))
