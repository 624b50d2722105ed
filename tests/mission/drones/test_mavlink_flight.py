"""MavlinkDrone against the simulated autopilots, over the wire; one aircraft of each kind flies all the tests."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from pymavlink import mavutil

from mission.drones.drone import Bounds, DroneEvent, Knot, Order, OrderState, Path
from mission.drones.mavlink import MavlinkDrone
from mission.drones.path_follower import setpoint_at
from sitl.autopilot import AutopilotConfig, AutopilotProcess, Mode, start_autopilot
from sitl.truth import TruthRing

pytestmark = pytest.mark.flight

FINAL = (OrderState.DONE, OrderState.REFUSED, OrderState.ENDED)
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
class Airborne:
    """A simulated aircraft in the air, and the drone connected to it."""

    autopilot: AutopilotProcess
    drone: MavlinkDrone
    ring: TruthRing

    def until(self, done: Callable[[], bool], timeout_s: float) -> list[DroneEvent]:
        """Keep the drone alive until something is so; returns its events."""
        events: list[DroneEvent] = []
        deadline = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < deadline, f"not within {timeout_s} s; events: {events}"
            events += self.drone.events()
            time.sleep(0.02)
        return events + self.drone.events()

    def wait(self, seconds: float) -> list[DroneEvent]:
        """Keep the drone alive for a time; returns its events."""
        deadline = time.monotonic() + seconds
        return self.until(lambda: time.monotonic() > deadline, seconds + 2.0)

    def fly(self, order: Order, timeout_s: float = 20.0) -> Order:
        """Wait for an order to become final."""
        self.until(lambda: order.state in FINAL, timeout_s)
        return order

    def take_control(self) -> None:
        """Hover under our control."""
        self.drone.begin(Bounds())
        order = self.fly(self.drone.hover())
        assert order.state is OrderState.DONE, order.reason

    def speed_m_s(self) -> float:
        """True speed."""
        newest = self.ring.newest()
        assert newest is not None
        return float(np.linalg.norm(newest.velocity_enu_m_s))

    def mode(self) -> str:
        """What the autopilot's inside says."""
        return str(self.autopilot.state()["mode"])

    def holds(self) -> bool:
        """Whether the autopilot is in a mode that holds still by itself."""
        return self.mode() in ("hold", "brake")


@pytest.fixture(scope="module", params=["px4", "ardupilot"])
def aircraft(request: pytest.FixtureRequest) -> Iterator[Airborne]:
    ring = TruthRing.create(seconds=120, rate_hz=200)
    # COM_OBL_RC_ACT 5: hold when setpoints stop (PX4's default without a remote control is to land).
    config = AutopilotConfig(
        flavour=request.param,
        seed=7,
        ready_after_s=1.0,
        parameters=(("COM_OBL_RC_ACT", 5.0),) * (request.param == "px4"),
    )
    autopilot = start_autopilot(config, ring.name)
    drone = MavlinkDrone(autopilot.url)
    aircraft = Airborne(autopilot, drone, ring)
    try:
        drone.connect(10.0)
        aircraft.until(lambda: drone.telemetry().position_ok, 10.0)
        drone.begin(Bounds())
        order = aircraft.fly(drone.take_off(2.0), 30.0)
        assert order.state is OrderState.DONE, order.reason
        yield aircraft
    finally:
        drone.close()
        autopilot.stop()
        ring.close()
        ring.unlink()


def test_after_the_take_off_it_hovers_at_the_height_with_a_pose_at_frame_rate(aircraft: Airborne) -> None:
    aircraft.take_control()
    telemetry = aircraft.drone.telemetry()
    assert telemetry.in_air
    assert telemetry.height_m == pytest.approx(2.0, abs=0.5)
    assert telemetry.pose_rate_hz >= 20.0
    truth = aircraft.ring.newest()
    assert truth is not None
    assert truth.position_enu_m[2] == pytest.approx(2.0, abs=0.6)
    aircraft.until(lambda: aircraft.drone.pose_at(truth.t_s) is not None, 1.0)
    pose = aircraft.drone.pose_at(truth.t_s)
    assert pose is not None
    assert np.abs(pose.position_enu_m[:2] - truth.position_enu_m[:2]).max() < 0.5
    origin = aircraft.drone.origin
    assert origin is not None
    assert origin.datum == "ellipsoid"
    assert origin.alt_m == pytest.approx(53.0, abs=1.0)
    assert aircraft.fly(aircraft.drone.hold()).state is OrderState.DONE


def test_out_and_back_is_tracked_in_space_with_the_heading_kept(aircraft: Airborne) -> None:
    aircraft.take_control()
    drone, ring = aircraft.drone, aircraft.ring
    turn = aircraft.fly(drone.turn_to(math.radians(40.0)))
    assert turn.state is OrderState.DONE, turn.reason
    start = ring.newest()
    assert start is not None
    order = aircraft.fly(drone.fly(OUT_AND_BACK))
    assert order.state is OrderState.DONE, order.reason
    assert order.started_s is not None
    cross, up, along, headings = [], [], [], []
    for t in np.arange(0.0, OUT_AND_BACK.duration_s, 0.1):
        truth, pose = ring.at(order.started_s + t), drone.pose_at(order.started_s + t)
        assert truth is not None
        assert pose is not None, f"no pose {t:.1f} s into the path"
        moved = truth.position_enu_m - start.position_enu_m
        wanted = setpoint_at(OUT_AND_BACK, float(t), np.zeros(3)).position_ned_m[1]
        along.append(moved[0] - wanted)
        cross.append(moved[1])
        up.append(moved[2])
        w, x, y, z = pose.world_from_body_wxyz
        headings.append(math.degrees(math.atan2(w * w + x * x - y * y - z * z, 2 * (x * y + w * z))))
    assert np.abs(cross).max() < 0.35
    assert np.abs(up).max() < 0.35
    assert np.abs(along).max() < 1.2, "it may lag while it accelerates, but not lose the path"
    assert np.abs(np.array(headings) - 40.0).max() < 5.0
    assert aircraft.fly(drone.hold()).state is OrderState.DONE


def test_the_pilots_switch_ends_it_and_it_is_never_re_entered(aircraft: Airborne) -> None:
    aircraft.take_control()
    path = aircraft.drone.fly(OUT_AND_BACK)
    aircraft.until(lambda: path.state is OrderState.FLYING, 2.0)
    aircraft.autopilot.switch(Mode.HOLD)
    switched = time.monotonic()
    events = aircraft.until(lambda: path.state in FINAL, 3.0)
    assert path.state is OrderState.ENDED
    assert path.ended_s is not None
    assert path.ended_s - switched < 1.0
    events += aircraft.wait(1.5)
    assert [e.kind for e in events].count("pilot") == 1
    assert aircraft.fly(aircraft.drone.hover()).state is OrderState.REFUSED
    assert aircraft.mode() == "hold"


def test_an_operators_fly_here_ends_it(aircraft: Airborne) -> None:
    aircraft.take_control()
    station = mavutil.mavlink_connection(aircraft.autopilot.operator_url.replace("://", ":"), source_system=255)
    try:
        here = aircraft.drone.origin
        assert here is not None
        flown = aircraft.drone.hover()
        events: list[DroneEvent] = []
        for _ in range(3):
            station.mav.heartbeat_send(6, 8, 0, 0, 4)
            station.mav.command_int_send(
                1, 1, 6, 192, 0, 0, -1, 1, 0, math.nan, round(here.lat_deg * 1e7) + 1500, round(here.lon_deg * 1e7), 5.0
            )
            events += aircraft.wait(0.5)
        assert flown.state in FINAL
        assert "pilot" in [e.kind for e in events]
        assert aircraft.fly(aircraft.drone.hover()).state is OrderState.REFUSED
    finally:
        station.close()
        aircraft.autopilot.switch(Mode.HOLD)


def test_a_hung_program_stops_the_aircraft_within_0_7_s(aircraft: Airborne) -> None:
    aircraft.take_control()
    path = aircraft.drone.fly(OUT_AND_BACK)
    aircraft.until(lambda: path.started_s is not None and time.monotonic() - path.started_s > 1.0, 3.0)
    time.sleep(1.5)  # the program hangs
    hung_s = time.monotonic() - 1.5
    events = aircraft.until(lambda: path.state in FINAL, 1.0)
    deadman = next(e for e in events if e.kind == "deadman")
    assert deadman.t_s - hung_s < 0.7
    assert path.state is OrderState.ENDED
    assert aircraft.holds()


def test_a_lost_link_is_reported_and_the_aircraft_stops_by_itself(aircraft: Airborne) -> None:
    aircraft.take_control()
    path = aircraft.drone.fly(OUT_AND_BACK)
    aircraft.until(lambda: path.started_s is not None and time.monotonic() - path.started_s > 1.0, 3.0)
    aircraft.autopilot.cut()
    cut_s = time.monotonic()
    try:
        events = aircraft.until(lambda: path.state in FINAL, 3.0)
        lost = next(e for e in events if e.kind == "link-lost")
        assert lost.t_s - cut_s < 1.5
        assert aircraft.drone.pose_at(time.monotonic()) is None
        aircraft.until(lambda: aircraft.speed_m_s() < 0.3, 8.0)
    finally:
        aircraft.autopilot.cut(False)
    aircraft.until(lambda: aircraft.drone.telemetry().connected and aircraft.holds(), 6.0)


PROGRAM = """
import sys, time
from mission.drones.drone import Bounds, OrderState
from mission.drones.mavlink import MavlinkDrone
from tests.mission.drones.test_mavlink_flight import OUT_AND_BACK
drone = MavlinkDrone(sys.argv[1])
drone.connect(10.0)
drone.begin(Bounds())
order = drone.hover()
while order.state in (OrderState.PENDING, OrderState.FLYING):
    drone.events()
    time.sleep(0.02)
order = drone.fly(OUT_AND_BACK) if order.state is OrderState.DONE else order
while order.reason == "" and (order.started_s is None or time.monotonic() - order.started_s < 1.0):
    drone.events()
    time.sleep(0.02)
sys.stdout.write(f"{order.state.value} {order.reason}\\n")
sys.stdout.flush()
while True:
    drone.events()
    time.sleep(0.02)
"""


def test_a_killed_program_stops_the_aircraft(aircraft: Airborne) -> None:
    aircraft.drone.close()
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, aircraft.autopilot.url], stdout=subprocess.PIPE, text=True
    )
    try:
        assert program.stdout is not None
        assert program.stdout.readline() == "flying \n"
        program.kill()
        killed = time.monotonic()
        while not aircraft.holds():
            assert time.monotonic() - killed < 1.5, f"still {aircraft.mode()}"
            time.sleep(0.02)
    finally:
        program.kill()
        program.communicate()
    aircraft.drone.connect(10.0)
    assert aircraft.drone.telemetry().in_air


def test_a_killed_pilot_process_leaves_the_aircraft_to_its_own_failsafe(aircraft: Airborne) -> None:
    """The last test: it leaves the drone without its pilot process."""
    aircraft.take_control()
    path = aircraft.drone.fly(OUT_AND_BACK)
    aircraft.until(lambda: path.started_s is not None and time.monotonic() - path.started_s > 1.0, 3.0)
    pid = aircraft.drone.pilot_pid
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    events = aircraft.until(lambda: path.state in FINAL, 1.0)
    assert "pilot-process-lost" in [e.kind for e in events]
    assert aircraft.drone.hover().state is OrderState.REFUSED
    assert not aircraft.drone.telemetry().connected
    aircraft.until(lambda: aircraft.speed_m_s() < 0.2, 8.0)
