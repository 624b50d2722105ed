"""MavlinkDrone and its pilot process against the simulated autopilots, over the wire: one PX4 and one ArduPilot.

Both aircraft fly each test at the same time. Reaction times are measured by a wiretap next to the aircraft; the series
of twenty are in tests/soak.
"""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np
import pytest

from mission.drones.drone import Bounds, DroneEvent, Knot, Order, OrderState, Path
from mission.drones.mavlink import MavlinkDrone
from mission.drones.path_follower import setpoint_at
from mission.pose import heading
from sitl.autopilot.config import FlavourName
from sitl.faults import LinkFaults
from tests.mission.drones.fault_bench import HOLD, HOLDS, Fault, FaultBench, fault_bench

pytestmark = pytest.mark.flight

FINAL = (OrderState.DONE, OrderState.REFUSED, OrderState.ENDED)
FENCE_M = 60.0
PARAMETERS: dict[FlavourName, tuple[tuple[str, float], ...]] = {
    "px4": (("COM_OBL_RC_ACT", 5.0), ("GF_MAX_HOR_DIST", FENCE_M)),
    "ardupilot": (("FENCE_ENABLE", 1.0), ("FENCE_RADIUS", FENCE_M), ("FENCE_TOTAL", 7.0)),
}
FAULTS: dict[FlavourName, tuple[Fault, ...]] = {"px4": ("hung", "killed"), "ardupilot": ("blocked", "silent")}
OUT_AND_BACK = Path(
    (
        Knot(0.0, (0, 0, 0), (0, 0, 0)),
        Knot(1.2, (0.6, 0, 0), (1.0, 0, 0)),
        Knot(2.2, (1.6, 0, 0), (1.0, 0, 0)),
        Knot(3.4, (2.2, 0, 0), (0, 0, 0)),
        Knot(4.6, (1.6, 0, 0), (-1.0, 0, 0)),
        Knot(5.6, (0.6, 0, 0), (-1.0, 0, 0)),
        Knot(6.8, (0, 0, 0), (0, 0, 0)),
    )
)


@dataclass
class Aircraft:
    """A simulated aircraft, and a drone of this process that flies it until the faults' programs do."""

    bench: FaultBench
    drone: MavlinkDrone
    cautions: list[str] = field(default_factory=list)

    def until(self, done: Callable[[], bool], timeout_s: float) -> list[DroneEvent]:
        """Keep the drone alive until something is so; returns its events."""
        events: list[DroneEvent] = []
        deadline = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < deadline, f"not within {timeout_s} s; events: {events}"
            events += self.drone.events()
            time.sleep(0.02)
        events += self.drone.events()
        self.cautions += [event.text for event in events if event.kind == "caution"]
        return events

    def fly(self, order: Order, timeout_s: float = 20.0) -> Order:
        """Wait for an order to become final."""
        self.until(lambda: order.state in FINAL, timeout_s)
        return order

    def done(self, order: Order, timeout_s: float = 20.0) -> None:
        """Wait for an order to be done."""
        assert self.fly(order, timeout_s).state is OrderState.DONE, order.reason

    def take_off(self) -> None:
        """Connect and climb."""
        self.drone.connect(20.0)
        self.until(lambda: self.drone.telemetry().position_ok, 10.0)
        self.drone.begin(Bounds())
        self.done(self.drone.take_off(self.bench.height_m), 30.0)


Fleet = tuple[Aircraft, ...]


def each(fleet: Fleet, check: Callable[[Aircraft], None]) -> None:
    """Check all aircraft at the same time."""
    with ThreadPoolExecutor(len(fleet)) as pool:
        for checked in [pool.submit(check, aircraft) for aircraft in fleet]:
            checked.result()


@pytest.fixture(scope="module")
def fleet() -> Iterator[Fleet]:
    with ExitStack() as stack:
        found = []
        for flavour, parameters in PARAMETERS.items():
            bench = stack.enter_context(fault_bench(flavour, parameters=parameters))
            drone = MavlinkDrone(bench.url)
            stack.callback(drone.close)
            found.append(Aircraft(bench, drone))
        each(tuple(found), Aircraft.take_off)
        yield tuple(found)


def test_after_the_take_off_it_hovers_at_the_height_with_a_pose_at_frame_rate(fleet: Fleet) -> None:
    def check(aircraft: Aircraft) -> None:
        drone = aircraft.drone
        drone.begin(Bounds())
        aircraft.done(drone.hover())
        telemetry = drone.telemetry()
        assert telemetry.in_air
        assert telemetry.height_m == pytest.approx(2.0, abs=0.5)
        assert telemetry.pose_rate_hz >= 20.0
        truth = aircraft.bench.truth()
        assert truth.position_enu_m[2] == pytest.approx(2.0, abs=0.6)
        aircraft.until(lambda: drone.pose_at(truth.t_s) is not None, 1.0)
        pose = drone.pose_at(truth.t_s)
        assert pose is not None
        assert np.abs(pose.position_enu_m[:2] - truth.position_enu_m[:2]).max() < 0.5
        origin = drone.origin
        assert origin is not None
        assert origin.datum == "ellipsoid"
        assert origin.alt_m == pytest.approx(53.0, abs=1.0)
        aircraft.done(drone.hold())

    each(fleet, check)


def test_out_and_back_is_tracked_in_space_with_the_heading_kept(fleet: Fleet) -> None:
    each(fleet, _tracks)


def _tracks(aircraft: Aircraft) -> None:
    drone, ring = aircraft.drone, aircraft.bench.ring
    drone.begin(Bounds())
    aircraft.done(drone.turn_to(math.radians(40.0)))
    start = aircraft.bench.truth()
    order = drone.fly(OUT_AND_BACK)
    aircraft.done(order)
    assert order.started_s is not None
    cross, up, along, headings = [], [], [], []
    for t in np.arange(0.0, OUT_AND_BACK.duration_s, 0.1):
        truth, pose = ring.at(order.started_s + t), drone.pose_at(order.started_s + t)
        assert truth is not None
        moved = truth.position_enu_m - start.position_enu_m
        wanted = setpoint_at(OUT_AND_BACK, float(t), np.zeros(3)).position_ned_m[1]
        along.append(moved[0] - wanted)
        cross.append(moved[1])
        up.append(moved[2])
        if pose is not None:
            headings.append(math.degrees(heading(pose.world_from_body_wxyz)))
    assert np.abs(cross).max() < 0.35
    assert np.abs(up).max() < 0.35
    assert np.abs(along).max() < 1.2, "it may lag while it accelerates, but not lose the path"
    assert len(headings) > 0.7 * len(cross), "the rest fell into gaps: the simulator stalls on a busy machine"
    assert np.abs(np.array(headings) - 40.0).max() < 5.0
    aircraft.done(drone.hold())


def test_a_path_through_the_autopilots_own_geofence_is_refused(fleet: Fleet) -> None:
    far = Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(40.0, (0, FENCE_M + 20.0, 0), (0, 0, 0))))

    def check(aircraft: Aircraft) -> None:
        aircraft.drone.begin(Bounds(radius_m=200.0))
        aircraft.done(aircraft.drone.hover())
        order = aircraft.fly(aircraft.drone.fly(far))
        assert order.state is OrderState.REFUSED
        assert f"the autopilot's geofence is at {FENCE_M:.1f} m" in order.reason
        aircraft.done(aircraft.drone.hold())

    each(fleet, check)


def test_what_of_the_geofence_is_not_checked_is_told_before_the_flight(fleet: Fleet) -> None:
    px4, ardupilot = fleet
    assert px4.cautions == []
    assert ardupilot.cautions == ["the polygons and circles of the geofence are not checked before the flight"]


def test_a_killed_pilot_process_leaves_the_aircraft_to_its_own_failsafe(fleet: Fleet) -> None:
    each(fleet, _loses_its_pilot)


def _loses_its_pilot(aircraft: Aircraft) -> None:
    """Leaves the drone without its pilot process: from here on programs of their own fly."""
    drone, bench = aircraft.drone, aircraft.bench
    drone.begin(Bounds())
    aircraft.done(drone.hover())
    path = drone.fly(OUT_AND_BACK)
    aircraft.until(lambda: path.started_s is not None and time.monotonic() - path.started_s > 1.0, 3.0)
    assert drone.pilot_pid is not None
    killed_s = time.monotonic()
    os.kill(drone.pilot_pid, signal.SIGKILL)
    events = aircraft.until(lambda: path.state in FINAL, 1.0)
    assert "pilot-process-lost" in [e.kind for e in events]
    assert drone.hover().state is OrderState.REFUSED
    assert not drone.telemetry().connected
    assert bench.comes_to_rest()
    assert bench.tap.setpoints_s(killed_s + 0.1) == []
    drone.close()
    bench.end_failsafe()


def test_a_pilot_process_that_hangs_ends_itself_and_the_aircraft_holds(fleet: Fleet) -> None:
    def check(aircraft: Aircraft) -> None:
        bench = aircraft.bench
        if bench.flavour == "px4":
            # Its loop hangs: a thread orders hold.
            assert bench.pilot_hung(1.0, signal.SIGUSR1).hold_ordered_s < 0.9
        else:
            # Python hangs, MAVSDK sends on: the kernel ends the process after 2 s.
            assert bench.pilot_hung(1.0, signal.SIGUSR2).last_setpoint_s < 2.5
        bench.end_failsafe()

    each(fleet, check)


def test_a_broken_program_ends_in_hold(fleet: Fleet) -> None:
    def check(aircraft: Aircraft) -> None:
        for fault in FAULTS[aircraft.bench.flavour]:
            reaction = aircraft.bench.program_broken(fault, into_s=1.0)
            assert reaction.hold_ordered_s < 0.7, fault

    each(fleet, check)


def test_the_operators_mode_ends_the_pattern_and_is_never_undone(fleet: Fleet) -> None:
    def check(aircraft: Aircraft) -> None:
        bench = aircraft.bench
        hold = HOLD[bench.flavour][-1]
        assert bench.taken_over(lambda: bench.operator_orders_mode(*hold), into_s=1.0) < 1.0
        assert bench.mode() == "hold"

    each(fleet, check)


def test_an_operators_fly_here_in_guided_ends_the_pattern(fleet: Fleet) -> None:
    bench = fleet[1].bench
    bench.fly(into_s=1.0)
    clicked_s = bench.operator_sends_here(15.0)
    # One of our setpoints may replace the order before the autopilot has told of it: then the operator clicks again.
    for _ in range(3):
        if bench.until(lambda: bool(bench.program.said("pilot")), 0.3):
            break
        clicked_s = bench.operator_sends_here(15.0)
    assert "another place" in bench.program.said("pilot")[0]["text"]
    assert not [t for t in bench.tap.setpoints_s(clicked_s) if t - clicked_s > 0.3]
    assert bench.tap.mode_orders(clicked_s) == []
    bench.operator_orders_mode(*HOLD["ardupilot"][-1])


def test_20_percent_packet_loss_is_flown_with_and_40_percent_is_not(fleet: Fleet) -> None:
    # Which is noticed first is up to chance: the share that is lost, that nothing new came for too long, or, of a new
    # order, that the hold before it has not been confirmed through the loss yet.
    reasons = ("of the packets, more than 30 %", "no longer received", "is not heard", "the vehicle is holding")

    def check(aircraft: Aircraft) -> None:
        bench = aircraft.bench
        bench.relay.set(LinkFaults(loss=0.2, duplicate=0.05, reorder=0.05))
        try:
            bench.fly(into_s=1.0)
            bench.relay.set(LinkFaults(loss=0.4))
            assert bench.until(lambda: bool(bench.program.said("link-lost")), 4.0)
            text = bench.program.said("link-lost")[0]["text"]
            assert any(reason in text for reason in reasons), text
            assert bench.until(lambda: bench.mode() in HOLDS, 4.0)
            assert bench.comes_to_rest()
            bench.program.forget()
            bench.program.tell("fly 1.8")
            news = bench.program.wait_for("order")
            assert (news["order"], news["state"]) == ("hover", "refused")
            assert any(reason in news["reason"] for reason in reasons), news["reason"]
        finally:
            bench.relay.set(LinkFaults())
            bench.drop_program()

    each(fleet, check)


def test_a_lost_link_is_reported_and_the_aircraft_stops_by_itself(fleet: Fleet) -> None:
    """The last test: it leaves the autopilots in their failsafe."""

    def check(aircraft: Aircraft) -> None:
        aircraft.bench.link_cut(into_s=1.0)

    each(fleet, check)
