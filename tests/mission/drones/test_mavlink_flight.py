"""MavlinkDrone against the simulated autopilots, over the wire; one aircraft of each kind flies all the tests."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from mission.drones.drone import Bounds, DroneEvent, Knot, Order, OrderState, Path
from mission.drones.mavlink import MavlinkDrone
from mission.drones.path_follower import setpoint_at
from mission.pose import heading
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


def _launch(flavour: Literal["px4", "ardupilot"], stack: ExitStack) -> Airborne:
    ring = TruthRing.create(seconds=120, rate_hz=200)
    stack.callback(ring.unlink)
    stack.callback(ring.close)
    # COM_OBL_RC_ACT 5: hold when setpoints stop (PX4's default without a remote control is to land).
    parameters = (("COM_OBL_RC_ACT", 5.0),) if flavour == "px4" else ()
    config = AutopilotConfig(flavour=flavour, seed=7, ready_after_s=1.0, parameters=parameters)
    autopilot = start_autopilot(config, ring.name)
    stack.callback(autopilot.stop)
    drone = MavlinkDrone(autopilot.url)
    stack.callback(drone.close)
    aircraft = Airborne(autopilot, drone, ring)
    drone.connect(20.0)
    aircraft.until(lambda: drone.telemetry().position_ok, 10.0)
    drone.begin(Bounds())
    order = aircraft.fly(drone.take_off(2.0), 30.0)
    assert order.state is OrderState.DONE, order.reason
    return aircraft


@pytest.fixture(scope="module")
def fleet() -> Iterator[dict[str, Airborne]]:
    with ExitStack() as stack, ThreadPoolExecutor(2) as pool:
        px4 = pool.submit(_launch, "px4", stack)
        ardupilot = pool.submit(_launch, "ardupilot", stack)
        yield {"px4": px4.result(), "ardupilot": ardupilot.result()}


@pytest.fixture(params=["px4", "ardupilot"])
def aircraft(request: pytest.FixtureRequest, fleet: dict[str, Airborne]) -> Airborne:
    return fleet[request.param]


px4_only = pytest.mark.parametrize("aircraft", ["px4"], indirect=True)


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


@px4_only
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
    # The operator takes it out of its failsafe.
    aircraft.autopilot.switch(Mode.HOLD)


PROGRAM = """
import sys, time
from mission.drones.drone import Bounds, Knot, OrderState, Path
from mission.drones.mavlink import MavlinkDrone
EAST = Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(5.0, (3.0, 0, 0), (0, 0, 0))))
drone = MavlinkDrone(sys.argv[1])
drone.connect(10.0)
drone.begin(Bounds())
order = drone.hover()
while order.state in (OrderState.PENDING, OrderState.FLYING):
    drone.events()
    time.sleep(0.02)
order = drone.fly(EAST) if order.state is OrderState.DONE else order
while order.reason == "" and (order.started_s is None or time.monotonic() - order.started_s < 1.0):
    drone.events()
    time.sleep(0.02)
sys.stdout.write(f"{order.state.value} {order.reason}\\n")
sys.stdout.flush()
while True:
    drone.events()
    time.sleep(0.02)
"""


@px4_only
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
