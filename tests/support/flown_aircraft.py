"""Three aircraft in the air at once, each behind a link that can be spoiled: a PX4, an ArduPilot and an AR.Drone."""

from __future__ import annotations

import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from mission.pose.buffer import Pose
from mission.records import Vector
from mission.vehicle.ardrone.ardrone import ARDrone
from mission.vehicle.drone import Bounds, DroneEvent, Knot, Order, OrderState, Path
from mission.vehicle.make import make_drone
from mission.vehicle.mavlink.mavlink_drone import MavlinkDrone
from sitl.aircraft.truth import TruthRing, VehicleTruth
from sitl.ardrone import ArdroneConfig, ArdroneProcess, start_ardrone
from sitl.autopilot.config import FlavourName
from sitl.faults import LinkFaults
from tests.support.bad_wifi import BadWifi
from tests.support.fault_bench import NOT_YET, FaultBench, fault_bench

FINAL = (OrderState.DONE, OrderState.REFUSED, OrderState.ENDED)
BOUNDS = Bounds(radius_m=10.0, min_height_m=0.8, max_speed_m_s=3.0)
HEIGHT_M = 1.6
FENCE_M = 60.0
PARAMETERS: dict[FlavourName, tuple[tuple[str, float], ...]] = {
    # COM_OBL_RC_ACT 5: hold when setpoints stop.
    "px4": (("COM_OBL_RC_ACT", 5.0), ("GF_MAX_HOR_DIST", FENCE_M)),
    "ardupilot": (("FENCE_ENABLE", 1.0), ("FENCE_RADIUS", FENCE_M), ("FENCE_TOTAL", 7.0)),
}
OUT_AND_BACK = Path(
    (
        Knot(0.0, (0, 0, 0), (0, 0, 0)),
        Knot(1.1, (0.6, 0, 0), (1.0, 0, 0)),
        Knot(2.2, (1.2, 0, 0), (0, 0, 0)),
        Knot(3.3, (0.6, 0, 0), (-1.0, 0, 0)),
        Knot(4.4, (0, 0, 0), (0, 0, 0)),
    )
)
OwnDrone = MavlinkDrone | ARDrone
AnyFlown = TypeVar("AnyFlown", bound="Flown")
STARVED = ("the program was silent", "no longer received", "is not heard")
"""Reasons why an order ends that a machine without time to spare brings about by itself."""


def flown_by_url(url: str) -> OwnDrone:
    """The aircraft behind an address, which has a pilot process."""
    drone = make_drone(url)
    assert isinstance(drone, MavlinkDrone | ARDrone)
    return drone


class Flown(ABC):
    """An aircraft in the air, and what only the simulation knows of it."""

    def __init__(self, kind: str, drone: OwnDrone, ring: TruthRing) -> None:
        self.kind, self.drone, self.ring = kind, drone, ring
        self.cautions: list[str] = []

    @abstractmethod
    def spoil(self, spoilt: bool) -> None:
        """Let its link lose every fifth packet, double and reorder some; or mend it."""

    def until(self, done: Callable[[], bool], timeout_s: float) -> list[DroneEvent]:
        """Keep it alive until something is so; its events."""
        events: list[DroneEvent] = []
        deadline = time.monotonic() + timeout_s
        while not done():
            assert time.monotonic() < deadline, f"not within {timeout_s} s; events: {events}"
            events += self.drone.events()
            time.sleep(0.02)
        events += self.drone.events()
        self.cautions += [event.text for event in events if event.kind == "caution"]
        return events

    def wait(self, seconds: float) -> list[DroneEvent]:
        """Keep it alive for a time; its events."""
        deadline = time.monotonic() + seconds
        return self.until(lambda: time.monotonic() > deadline, seconds + 5.0)

    def final(self, order: Order, timeout_s: float = 40.0) -> Order:
        """Wait for an order to become final."""
        self.until(lambda: order.state in FINAL, timeout_s)
        return order

    def done(self, order: Callable[[], Order]) -> Order:
        """Give an order and wait until it is done, taking control again where the machine had no time for us."""
        for _ in range(3):
            given = self.final(order())
            if given.state is OrderState.DONE or not any(reason in given.reason for reason in STARVED):
                break
            warnings.warn(f"flown again, since the machine had no time: {given.reason}", stacklevel=2)
            self.until(lambda: self.drone.telemetry().position_ok, 10.0)
            self.hovers()
        assert given.state is OrderState.DONE, given.reason
        return given

    def hovers(self) -> None:
        """Take control."""
        self._permitted(self.drone.hover)

    def takes_off(self) -> None:
        """From the ground."""
        self._permitted(lambda: self.drone.take_off(HEIGHT_M))

    def _permitted(self, order: Callable[[], Order]) -> None:
        """Begin, and give an order that is done; again while a new connection has not heard all that must be known."""
        deadline = time.monotonic() + 10.0
        while True:
            self.drone.begin(BOUNDS)
            given = self.final(order())
            if not any(reason in given.reason for reason in NOT_YET) or time.monotonic() > deadline:
                break
            self.wait(0.1)
        assert given.state is OrderState.DONE, given.reason

    def on_its_way(self, path: Path = OUT_AND_BACK) -> Order:
        """Take control and fly a path; returns when it moves. Again where the machine had no time for us."""
        for _ in range(3):
            self.hovers()
            order = self.drone.fly(path)
            self.until(lambda given=order: self.speed_m_s() > 0.4 or given.state in FINAL, 10.0)  # type: ignore[misc]
            if order.state not in FINAL or not any(reason in order.reason for reason in STARVED):
                break
            warnings.warn(f"flown again, since the machine had no time: {order.reason}", stacklevel=2)
            self.until(lambda: self.drone.telemetry().position_ok, 10.0)
        assert order.state not in FINAL, order.reason
        return order

    def pose_before(self, seconds: float) -> Pose:
        """A pose that lies so far back, as soon as telemetry without a gap gives one."""
        found: list[Pose] = []

        def given() -> bool:
            pose = self.drone.pose_at(time.monotonic() - seconds)
            if pose is not None:
                found.append(pose)
            return pose is not None

        self.until(given, 10.0)
        return found[0]

    def truth(self) -> VehicleTruth:
        """The newest, with the time at which it held."""
        newest = self.ring.newest()
        assert newest is not None
        return newest

    def place(self) -> Vector:
        """True position."""
        return np.array(self.truth().position_enu_m)

    def speed_m_s(self) -> float:
        """True speed."""
        return float(np.linalg.norm(self.truth().velocity_enu_m_s))

    def comes_to_rest(self, timeout_s: float = 8.0) -> bool:
        """Whether it stands still in the air within a time, with nobody who flies it."""
        deadline = time.monotonic() + timeout_s
        while self.speed_m_s() > 0.3:
            if time.monotonic() > deadline:
                return False
            time.sleep(0.05)  # looks at the truth 20 times a second
        return float(self.place()[2]) > 0.5

    def connect_and_take_off(self) -> None:
        """From nothing."""
        self.drone.connect(20.0)
        self.until(lambda: self.drone.telemetry().position_ok, 20.0)
        unpermitted = self.final(self.drone.take_off(HEIGHT_M))
        assert unpermitted.state is OrderState.REFUSED
        assert "begin" in unpermitted.reason
        self.takes_off()


class MavlinkFlown(Flown):
    """A PX4 or an ArduPilot on a bench."""

    def __init__(self, bench: FaultBench) -> None:
        super().__init__(bench.flavour, flown_by_url(bench.url), bench.ring)
        self.bench = bench

    def spoil(self, spoilt: bool) -> None:
        """By the bench's relay."""
        self.bench.relay.set(LinkFaults(loss=0.2, duplicate=0.05, reorder=0.05) if spoilt else LinkFaults())


class ArdroneFlown(Flown):
    """An AR.Drone, its Wi-Fi, and its port for AT commands, which anybody may send to."""

    def __init__(self, simulated: ArdroneProcess, wifi: BadWifi, ring: TruthRing) -> None:
        url = f"ardrone://127.0.0.1?at={wifi.ports[0]}&navdata={wifi.ports[1]}"
        super().__init__("ardrone", flown_by_url(url), ring)
        self.simulated, self.wifi = simulated, wifi

    def spoil(self, spoilt: bool) -> None:
        """By its Wi-Fi."""
        self.wifi.lost, self.wifi.doubled, self.wifi.late_s = (0.2, 0.2, 0.03) if spoilt else (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Fleet:
    """The three."""

    px4: MavlinkFlown
    ardupilot: MavlinkFlown
    ardrone: ArdroneFlown

    @property
    def mavlink(self) -> tuple[MavlinkFlown, ...]:
        """Those that speak MAVLink."""
        return self.px4, self.ardupilot

    @property
    def all(self) -> tuple[Flown, ...]:
        """Every aircraft that there is."""
        return self.px4, self.ardupilot, self.ardrone


def each(crafts: Sequence[AnyFlown], check: Callable[[AnyFlown], None]) -> None:
    """Check aircraft at the same time; an error says whose it is."""
    with ThreadPoolExecutor(len(crafts)) as pool:
        for craft, checked in [(craft, pool.submit(check, craft)) for craft in crafts]:
            try:
                checked.result()
            except BaseException as error:
                error.add_note(f"flown by: {craft.kind}")
                raise


@contextmanager
def fleet_in_the_air() -> Iterator[Fleet]:
    """Start the three and take off."""
    with ExitStack() as stack:
        px4, ardupilot = (
            MavlinkFlown(stack.enter_context(fault_bench(flavour, parameters=parameters, height_m=HEIGHT_M)))
            for flavour, parameters in PARAMETERS.items()
        )
        found = Fleet(px4, ardupilot, _ardrone(stack))
        for craft in found.all:
            stack.callback(craft.drone.close)
        each(found.all, Flown.connect_and_take_off)
        yield found


def _ardrone(stack: ExitStack) -> ArdroneFlown:
    ring = TruthRing.create(seconds=120, rate_hz=200)
    stack.callback(ring.unlink)
    stack.callback(ring.close)
    free = ArdroneConfig(at_port=0, navdata_port=0, video_port=0, control_port=0, seed=3, heading_rad=0.4)
    simulated = start_ardrone(free, ring.name)
    stack.callback(simulated.stop)
    wifi = BadWifi("127.0.0.1", [simulated.ports.at, simulated.ports.navdata], lost=0.0, doubled=0.0, late_s=0.0)
    stack.callback(wifi.close)
    return ArdroneFlown(simulated, wifi, ring)
