"""What `Drone` promises, flown by every aircraft that there is: a MAVLink one and an AR.Drone, over their wires."""

from __future__ import annotations

import math
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
import pytest

from mission.drones.drone import Bounds, Drone, DroneEvent, Knot, Order, OrderState, Path
from mission.drones.make import AnyDrone, make_drone
from mission.errors import LinkError
from mission.pose import heading
from mission.records import Vector
from sitl.ardrone import ArdroneConfig, start_ardrone
from sitl.autopilot import AutopilotConfig, start_autopilot
from sitl.truth import TruthRing

pytestmark = pytest.mark.flight

FINAL = (OrderState.DONE, OrderState.REFUSED, OrderState.ENDED)
BOUNDS = Bounds(radius_m=10.0, min_height_m=0.8, max_speed_m_s=3.0)
EAST_AND_BACK = Path(
    (
        Knot(0.0, (0, 0, 0), (0, 0, 0)),
        Knot(1.5, (1.0, 0, 0), (0, 0, 0)),
        Knot(3.0, (0, 0, 0), (0, 0, 0)),
    )
)
TO_THE_SIDE_M = {"mavlink": 0.3, "ardrone": 0.6}
"""How far the aircraft's true path may lie from the ordered one: the AR.Drone flies by tilt, on its dead reckoning."""


@dataclass
class Flown:
    """An aircraft in the air, and what only the simulation knows of it."""

    kind: str
    drone: AnyDrone
    ring: TruthRing

    def until(self, done: Callable[[], bool], timeout_s: float) -> list[DroneEvent]:
        """Keep it alive until something is so; its events."""
        events: list[DroneEvent] = []
        deadline = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < deadline, f"not within {timeout_s} s; events: {events}"
            events += self.drone.events()
            time.sleep(0.02)
        return events + self.drone.events()

    def wait(self, seconds: float) -> list[DroneEvent]:
        """Keep it alive for a time; its events."""
        deadline = time.monotonic() + seconds
        return self.until(lambda: time.monotonic() > deadline, seconds + 2.0)

    def final(self, order: Order, timeout_s: float = 25.0) -> Order:
        """Wait for an order to become final."""
        self.until(lambda: order.state in FINAL, timeout_s)
        return order

    def done(self, order: Order) -> None:
        """Wait for an order to be done."""
        assert self.final(order).state is OrderState.DONE, order.reason

    def hovers(self) -> None:
        """Take control."""
        self.drone.begin(BOUNDS)
        self.done(self.drone.hover())

    def place(self) -> Vector:
        """True position."""
        newest = self.ring.newest()
        assert newest is not None
        return np.array(newest.position_enu_m)

    def speed_m_s(self) -> float:
        """True speed."""
        newest = self.ring.newest()
        assert newest is not None
        return float(np.linalg.norm(newest.velocity_enu_m_s))


def _fly(kind: str, stack: ExitStack) -> Flown:
    ring = TruthRing.create(seconds=120, rate_hz=200)
    stack.callback(ring.unlink)
    stack.callback(ring.close)
    if kind == "mavlink":
        # COM_OBL_RC_ACT 5: hold when setpoints stop.
        parameters = (("COM_OBL_RC_ACT", 5.0),)
        autopilot = start_autopilot(AutopilotConfig(seed=3, ready_after_s=1.0, parameters=parameters), ring.name)
        stack.callback(autopilot.stop)
        url = autopilot.url
    else:
        free = ArdroneConfig(at_port=0, navdata_port=0, video_port=0, control_port=0, seed=3, heading_rad=0.4)
        simulated = start_ardrone(free, ring.name)
        stack.callback(simulated.stop)
        url = simulated.url
    drone = make_drone(url)
    stack.callback(drone.close)
    drone.connect(20.0)
    flown = Flown(kind, drone, ring)
    flown.until(lambda: drone.telemetry().position_ok, 10.0)
    unpermitted = flown.final(drone.take_off(1.6))
    assert unpermitted.state is OrderState.REFUSED
    assert "begin" in unpermitted.reason
    drone.begin(BOUNDS)
    flown.done(drone.take_off(1.6))
    return flown


@pytest.fixture(scope="module")
def fleet() -> Iterator[dict[str, Flown]]:
    with ExitStack() as stack, ThreadPoolExecutor(2) as pool:
        flights = {kind: pool.submit(_fly, kind, stack) for kind in ("mavlink", "ardrone")}
        yield {kind: flight.result() for kind, flight in flights.items()}


@pytest.fixture(params=["mavlink", "ardrone"])
def flown(fleet: dict[str, Flown], request: pytest.FixtureRequest) -> Iterator[Flown]:
    """Each aircraft in turn, hovering by itself before and after."""
    craft = fleet[request.param]
    for other in fleet.values():
        other.drone.events()
    yield craft
    if craft.drone.telemetry().in_air:
        craft.final(craft.drone.hold())


@pytest.mark.parametrize("url", ["udpin://127.0.0.1:{port}", "ardrone://127.0.0.1?navdata={port}&at={port}"])
def test_nobody_there_is_a_link_error_in_time(url: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    drone = make_drone(url.format(port=port))
    began = time.monotonic()
    with pytest.raises(LinkError) as caught:
        drone.connect(1.0)
    assert time.monotonic() - began < 6.0
    assert caught.value.remedy
    drone.close()


def test_it_tells_what_it_is_and_how_it_is(flown: Flown) -> None:
    drone: Drone = flown.drone
    telemetry = drone.telemetry()
    assert drone.name
    assert telemetry.connected
    assert telemetry.in_air
    assert telemetry.pose_rate_hz >= 20.0
    assert telemetry.battery_fraction is not None
    assert 0.5 < telemetry.battery_fraction <= 1.0
    assert telemetry.height_m == pytest.approx(float(flown.place()[2]), abs=0.4)
    assert drone.capabilities.global_position == (drone.origin is not None)
    assert drone.noise().position_walk_m_per_sqrt_s > 0.0


def test_hover_stays(flown: Flown) -> None:
    flown.hovers()
    before = flown.place()
    flown.wait(1.0)
    assert np.linalg.norm(flown.place() - before) < 0.3
    assert flown.speed_m_s() < 0.4


def test_turns_to_a_heading_and_then_follows_the_aim(flown: Flown) -> None:
    flown.hovers()
    flown.done(flown.drone.turn_to(1.0))
    pose = flown.drone.pose_at(time.monotonic() - 0.1)
    assert pose is not None
    assert abs(heading(pose.world_from_body_wxyz) - 1.0) < math.radians(6.0)
    flown.drone.aim(0.5)
    flown.wait(2.0)
    told = flown.drone.telemetry().heading_rad
    assert told is not None
    assert abs(math.remainder(told - 0.5, math.tau)) < math.radians(6.0)


def test_flies_a_path_and_reports_where_it_was(flown: Flown) -> None:
    flown.hovers()
    flown.wait(0.5)
    began = flown.place()
    order = flown.drone.fly(EAST_AND_BACK)
    track: list[tuple[float, Vector]] = []

    def over() -> bool:
        track.append((time.monotonic(), flown.place()))
        return order.state in FINAL

    flown.until(over, 15.0)
    assert order.state is OrderState.DONE, order.reason
    assert order.started_s is not None
    true = np.array([place - began for _, place in track])
    assert true[:, 0].max() == pytest.approx(1.0, abs=TO_THE_SIDE_M[flown.kind])
    assert np.abs(true[:, 1:]).max() < TO_THE_SIDE_M[flown.kind]
    assert np.linalg.norm(true[-1]) < TO_THE_SIDE_M[flown.kind]
    # What it says of itself agrees with the truth over the pattern, as far as its own noise model promises (4 sigmas).
    poses = [(place, flown.drone.pose_at(t_s)) for t_s, place in track if t_s < track[-1][0] - 0.3]
    told = np.array([pose.position_enu_m for _, pose in poses if pose is not None])
    truth = np.array([place for place, pose in poses if pose is not None])
    assert len(told) > 0.9 * len(poses)
    noise = flown.drone.noise()
    drift = 4.0 * math.hypot(noise.position_sigma_m, noise.position_walk_m_per_sqrt_s * math.sqrt(4.0))
    assert np.linalg.norm((told - told[0]) - (truth - truth[0]), axis=1).max() < max(0.25, drift)


def test_a_path_beyond_the_bounds_is_refused(flown: Flown) -> None:
    flown.hovers()
    far = Path((Knot(0.0, (0, 0, 0), (0, 0, 0)), Knot(30.0, (30.0, 0, 0), (0, 0, 0))))
    order = flown.final(flown.drone.fly(far))
    assert order.state is OrderState.REFUSED
    assert "bounds" in order.reason
    nonsense = flown.final(flown.drone.turn_to(math.nan))
    assert nonsense.state is OrderState.REFUSED


def test_a_pose_is_only_given_where_there_is_one(flown: Flown) -> None:
    now = time.monotonic()
    assert flown.drone.pose_at(now + 1.0) is None
    assert flown.drone.pose_at(now - 3600.0) is None
    pose = flown.drone.pose_at(now - 0.2)
    assert pose is not None
    assert pose.t_s == now - 0.2
    assert np.linalg.eigvalsh(pose.position_covariance_m2).min() > 0.0
    assert np.linalg.eigvalsh(pose.attitude_covariance_rad2).min() > 0.0


def test_a_silent_program_stops_it(flown: Flown) -> None:
    flown.hovers()
    order = flown.drone.fly(EAST_AND_BACK)
    flown.until(lambda: flown.speed_m_s() > 0.4, 5.0)
    time.sleep(1.0)  # the silence that is tested
    events = flown.wait(1.5)
    assert order.state is OrderState.ENDED
    assert any(event.kind == "deadman" for event in events)
    assert flown.speed_m_s() < 0.5
    refused = flown.final(flown.drone.hover())
    assert refused.state is OrderState.REFUSED, "control is not taken twice on one permission"


def test_hold_gives_control_back(flown: Flown) -> None:
    flown.hovers()
    flown.done(flown.drone.hold())
    order = flown.final(flown.drone.hover())
    assert order.state is OrderState.REFUSED
    flown.hovers()


@pytest.mark.soak
def test_without_its_pilot_process_it_stops_by_itself(flown: Flown) -> None:
    """The last that flies: the autopilot's failsafe or the AR.Drone's watchdog acts; a new connection can land it."""
    flown.hovers()
    order = flown.drone.fly(EAST_AND_BACK)
    flown.until(lambda: flown.speed_m_s() > 0.4, 5.0)
    pilot = flown.drone.pilot_pid
    assert pilot is not None
    os.kill(pilot, signal.SIGKILL)
    events = flown.until(lambda: order.state is OrderState.ENDED, 5.0)
    assert any(event.kind == "pilot-process-lost" for event in events + flown.wait(0.2))
    deadline = time.monotonic() + 6.0
    while flown.speed_m_s() > 0.3:
        assert time.monotonic() < deadline, "it flies on without its pilot"
        time.sleep(0.05)
    flown.drone.close()
    flown.drone.connect(20.0)
    flown.until(lambda: flown.drone.telemetry().position_ok, 10.0)
    flown.drone.begin(BOUNDS)
    flown.done(flown.drone.land())
    assert not flown.drone.telemetry().in_air
    flown.drone.close()
    flown.drone.close()
    closed = flown.drone.hover()
    assert closed.state is OrderState.REFUSED
