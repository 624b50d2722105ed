"""Two simulated vehicles in the air, served by one fleet; each with an operator of its own."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Literal

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.serve.fleet import Fleet, vehicles
from mission.records import GeodeticOrigin
from sitl.autopilot import AutopilotConfig, AutopilotProcess, Mode, start_autopilot
from tests.support.station import Station, until

SYSTEMS = (1, 2)
Trouble = Literal["pilot killed", "video gone", "link cut"]
USER_1, ACCEPTED, IN_PROGRESS = 31010, 0, 5
REQUEST_MESSAGE, CAMERA_INFORMATION = 512, 259
HOMES = (GeodeticOrigin(37.2276, 126.8405, 30.0, "amsl"), GeodeticOrigin(37.2286, 126.8405, 30.0, "amsl"))


@dataclass
class Vehicle:
    """One of them, and its operator."""

    system: int
    autopilot: AutopilotProcess
    station: Station
    folder: Path
    orders: int = 0

    def order(self) -> None:
        """Press the button: the next order, not the last one sent again (NaN stands for 0 as well)."""
        self.station.command(USER_1, *[float("nan")] * (self.orders % 5))
        self.orders += 1

    @property
    def flies(self) -> bool:
        """Whether it is flown by a program."""
        return self.autopilot.state()["mode"] == Mode.OFFBOARD.value

    @property
    def holds(self) -> bool:
        """Whether it stands in the air by itself."""
        return self.autopilot.state()["mode"] == Mode.HOLD.value

    @property
    def critical(self) -> bool:
        """Whether its newest heartbeat says that it is in a failsafe."""
        return bool(self.station.found("HEARTBEAT", 1)[-1].system_status == mavlink.MAV_STATE_CRITICAL)

    @property
    def results(self) -> list[int]:
        """What became of its orders, without progress."""
        return [result for result in self.station.results(USER_1) if result != IN_PROGRESS]

    @property
    def answers(self) -> int:
        """CAMERA_TRACKING_GEO_STATUS of its own component."""
        return len(self.station.found("CAMERA_TRACKING_GEO_STATUS"))


@dataclass
class Pair:
    """Both, and what serves them."""

    vehicles: tuple[Vehicle, Vehicle]
    fleet: Fleet
    said: list[str]

    @property
    def pilots(self) -> list[int]:
        """Process ids of the pilot processes, the children of those that serve."""
        served = [Path(f"/proc/{pid}/task/{pid}/children") for pid in self.fleet.pids]
        return [int(child) for path in served for child in path.read_text().split()]

    def locates(self, vehicle: Vehicle, after: int) -> bool:
        """Whether an order brings an answer; given again where only this machine was too busy for the deadman.

        Args:
            vehicle: that was given an order.
            after: how many orders of its had ended before.
        """
        for _ in range(3):
            if not until(lambda: len(vehicle.results) > after, 90.0):  # noqa: B023  asked at once
                return False
            if vehicle.results[-1] == ACCEPTED:
                return True
            ended = vehicle.station.texts().rpartition("no answer:")[2]
            if "was silent" not in ended:
                return False
            after = len(vehicle.results)
            vehicle.order()
        return False

    def served_again(self, vehicle: Vehicle) -> bool:
        """Whether its component answers."""
        before = len(vehicle.station.results(REQUEST_MESSAGE))
        vehicle.station.command(REQUEST_MESSAGE, CAMERA_INFORMATION)
        return until(lambda: len(vehicle.station.results(REQUEST_MESSAGE)) > before, 1.0)

    def both_fly(self) -> None:
        """Order both at the same time, and wait until both are flown."""
        before = [len(vehicle.results) for vehicle in self.vehicles]

        def taken(vehicle: Vehicle) -> bool:
            return IN_PROGRESS in vehicle.station.results(USER_1)[-1:] or vehicle.flies

        for vehicle in self.vehicles:
            vehicle.order()
        assert until(lambda: all(taken(vehicle) for vehicle in self.vehicles), 20.0), self.news()
        assert until(lambda: all(vehicle.flies for vehicle in self.vehicles), 20.0), self.news()
        assert [len(vehicle.results) for vehicle in self.vehicles] == before

    def news(self) -> str:
        """What was said, for a test that fails."""
        return "\n".join([*self.said, *(vehicle.station.texts() for vehicle in self.vehicles)])


@contextmanager
def two_vehicles(folder: Path, *, one_link: bool) -> Iterator[Pair]:
    """Both in the air, and served.

    Args:
        folder: of answers.
        one_link: whether both send to the same port, as through one radio.
    """
    ports = [_free_port()] * 2 if one_link else [_free_port(), _free_port()]
    with ExitStack() as stack:
        flown = []
        for system, port, home in zip(SYSTEMS, ports, HOMES, strict=True):
            config = AutopilotConfig(
                noise="none", system_id=system, remote_port=port, home=home, parameters=(("COM_OBL_RC_ACT", 5.0),)
            )
            autopilot = start_autopilot(config)
            stack.callback(autopilot.stop)
            station = stack.enter_context(Station(autopilot.operator_url, system=system))
            flown.append(Vehicle(system, autopilot, station, folder / f"vehicle-{system}"))
        settings = folder / "sidestep.toml"
        settings.write_text("[link]\nconnect_timeout_s = 60.0\n")
        links = [f"udpin://127.0.0.1:{port}" for port in ports]
        said: list[str] = []
        command = (sys.executable, "-m", "tests.support.seeing_serve")
        fleet = Fleet(vehicles([settings], links, SYSTEMS, [], [], folder), said.append, command, 0.5)
        over: list[bool] = []
        thread = Thread(target=fleet.run, args=(lambda: bool(over),))
        thread.start()
        stack.callback(thread.join)
        stack.callback(over.append, True)
        pair = Pair((flown[0], flown[1]), fleet, said)
        assert until(lambda: all(v.station.found("HEARTBEAT") for v in flown), 60.0), pair.news()
        climbing = [Thread(target=v.station.take_off, args=(2.0,)) for v in flown]
        for climb in climbing:
            climb.start()
        for climb in climbing:
            climb.join()
        yield pair


def kill(pid: int) -> None:
    """End a process as the kernel does when memory is short."""
    os.kill(pid, signal.SIGKILL)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])
