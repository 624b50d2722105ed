"""The pilot process, the only thing that flies: ``python -m mission.drones.pilot CONFIG``, started by `PilotProcess`.

It owns the vehicle's connection (MAVSDK, forwarding to the program's pymavlink over loopback UDP), and reads orders
from its standard input. What stops the vehicle, from the outside in:

- The program is silent for 0.5 s: hold (`Flight`).
- The program's end of the pipe closes, or its process is gone: hold, then this process ends.
- An exception here: hold, then this process ends.
- This process's own loop hangs: a thread orders hold after 0.5 s and ends the process; should Python itself hang, the
  kernel's alarm ends it after 2 s. Its setpoints die with it, and the autopilot's own failsafe takes over.
"""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import signal
import sys
import threading
import time
from typing import Any

from mavsdk.enums import ForwardingOption
from mavsdk.exceptions import ConnectionError as MavsdkConnectionError
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.system import System
from pydantic import ValidationError

from mission.drones.controls import MavsdkControls
from mission.drones.drone import EventKind
from mission.drones.flight import Flight
from mission.drones.link import MavlinkLink
from mission.drones.loopback import loopback_socket
from mission.drones.pilot_config import MAVSDK_COMPONENT, PILOT_COMPONENT, PROGRAM_COMPONENT, PilotConfig
from mission.drones.pilot_protocol import (
    MAX_LINE,
    Aim,
    Begin,
    EventReport,
    Failed,
    FlyOrder,
    FromPilot,
    KeepAlive,
    Quit,
    Ready,
    ToPilot,
    decode_to_pilot,
    encode,
)
from mission.drones.rates import MessageRates
from mission.drones.vehicle import VEHICLE_MESSAGES, VehicleState
from mission.errors import LinkError, SidestepError

_LOG = logging.getLogger(__name__)

TICK_S = 0.02
_FAREWELL_S = 6.0
_HANG_S = 0.5
_ALARM_S = 2.0
_FOREIGN = ("SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET", "COMMAND_INT")
_DO_REPOSITION = 192


class _Vehicle:
    """The connections: MAVSDK on the vehicle's, and two loopback links behind it."""

    def __init__(self, config: PilotConfig) -> None:
        self.mavsdk, self.system = _connect(config)
        self.state = VehicleState(self.system.get_system_id())
        self.rivals: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._own = {MAVSDK_COMPONENT, PILOT_COMPONENT, PROGRAM_COMPONENT}
        sock = loopback_socket()
        port = sock.getsockname()[1]
        self.link = MavlinkLink(
            sock,
            source_system=self.state.system,
            source_component=PILOT_COMPONENT,
            target_system=self.state.system,
            handler=self._take,
            handled=(*VEHICLE_MESSAGES, *_FOREIGN),
        )
        for loopback in (port, config.program_port):
            self.mavsdk.add_any_connection_with_handle_and_forwarding(
                f"udpout://127.0.0.1:{loopback}", ForwardingOption.ON
            )
        self.controls = MavsdkControls(self.system, self.link, self.state)
        self.rates: MessageRates | None = None

    def keep_rates(self, now_s: float) -> None:
        """Ask for what the flight watches, in the autopilot's own terms."""
        if self.rates is None and self.state.heartbeat_s is not None:
            wanted = {"LOCAL_POSITION_NED": 50.0, "GLOBAL_POSITION_INT": 50.0, "ATTITUDE": 50.0}
            wanted |= {"EXTENDED_SYS_STATE": 5.0, "SYS_STATUS": 2.0, "GPS_RAW_INT": 5.0}
            if self.state.autopilot == "px4":
                wanted |= {"CURRENT_MODE": 20.0, "ESTIMATOR_STATUS": 1.0}
            else:
                wanted |= {"EKF_STATUS_REPORT": 2.0, "POSITION_TARGET_GLOBAL_INT": 50.0}
            self.rates = MessageRates(self.link, wanted, now_s)
        if self.rates is not None:
            self.rates.keep(now_s)

    def close(self) -> None:
        """Silence everything."""
        self.controls.release()
        self.link.close()
        self.mavsdk.destroy()

    def _take(self, message: Any, arrived_s: float) -> None:
        name = message.get_type()
        if name not in _FOREIGN:
            self.state.update(message, arrived_s)
            return
        ours = message.get_srcSystem() == self.state.system and message.get_srcComponent() in self._own
        if ours or message.target_system not in (0, self.state.system):
            return
        if name != "COMMAND_INT" or message.command == _DO_REPOSITION:
            who = f"{message.get_srcSystem()}/{message.get_srcComponent()}"
            self.rivals.put(f"another controller ({who}) sent {name}")


def _connect(config: PilotConfig) -> tuple[Mavsdk, System]:
    """Opens the vehicle's connection as a companion with the vehicle's own system id.

    Raises:
        LinkError: the address cannot be opened, or no autopilot is heard.
    """
    own = config.target_system or 1
    deadline = time.monotonic() + config.connect_timeout_s
    for _ in range(3):
        mavsdk = Mavsdk(Configuration.create_manual(own, MAVSDK_COMPONENT, True))
        try:
            mavsdk.add_any_connection_with_handle_and_forwarding(config.url, ForwardingOption.ON)
        except MavsdkConnectionError as error:
            mavsdk.destroy()
            raise LinkError(f"cannot open {config.url} ({error})", "Check the address and who else uses it") from error
        system = _wait_for_system(mavsdk, config.target_system, deadline)
        if system is None:
            mavsdk.destroy()
            raise LinkError(
                f"no autopilot is heard on {config.url}", "Check that the vehicle is on and sends to this address"
            )
        if system.get_system_id() == own:
            return mavsdk, system
        own = system.get_system_id()
        mavsdk.destroy()
    raise LinkError(f"the system id on {config.url} keeps changing", "Set target_system")


def _wait_for_system(mavsdk: Mavsdk, wanted: int, deadline_s: float) -> System | None:
    while time.monotonic() < deadline_s:
        for system in mavsdk.get_systems():
            if system.has_autopilot() and wanted in (0, system.get_system_id()):
                return system
        time.sleep(0.02)  # looks again until the deadline
    return None


class _Pipe:
    """The program's lines as they come, and lines to it; neither side ever blocks the loop."""

    def __init__(self, source: int, sink: int) -> None:
        self.closed = threading.Event()
        self._lines: queue.SimpleQueue[ToPilot] = queue.SimpleQueue()
        self._out: queue.Queue[FromPilot] = queue.Queue(1000)
        self._source, self._sink = source, sink
        self._parent = os.getppid()
        threading.Thread(target=self._read, name="orders", daemon=True).start()
        self._writer = threading.Thread(target=self._write, name="reports", daemon=True)
        self._writer.start()

    def take(self) -> list[ToPilot]:
        """The lines since the last call."""
        if os.getppid() != self._parent:
            self.closed.set()
        lines = []
        with contextlib.suppress(queue.Empty):
            while True:
                lines.append(self._lines.get_nowait())
        return lines

    def send(self, line: FromPilot) -> None:
        """Send a line; dropped when the program has not read a thousand of them."""
        with contextlib.suppress(queue.Full):
            self._out.put_nowait(line)

    def flush(self, timeout_s: float) -> None:
        """Wait until everything is written."""
        until = time.monotonic() + timeout_s
        while self._out.unfinished_tasks and time.monotonic() < until:
            time.sleep(0.01)  # looks again until the deadline

    def _read(self) -> None:
        pending = b""
        while data := os.read(self._source, 65536):
            *lines, pending = (pending + data).split(b"\n")
            for line in lines:
                order = decode_to_pilot(line)
                if order is not None:
                    self._lines.put(order)
            pending = pending[:MAX_LINE]
        self.closed.set()

    def _write(self) -> None:
        while True:
            line = self._out.get()
            try:
                _write_all(self._sink, encode(line))
            except OSError:
                self.closed.set()
            self._out.task_done()


def main(arguments: list[str]) -> int:
    """Run until the program goes; exit status 0 after an orderly end."""
    source, sink = _own_stdout()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = _Pipe(source, sink)
    try:
        config = PilotConfig.model_validate_json(arguments[0])
        vehicle = _Vehicle(config)
    except (IndexError, ValidationError, SidestepError) as error:
        cause, remedy = (error.cause, error.remedy) if isinstance(error, SidestepError) else (str(error), "")
        pipe.send(Failed(cause=cause, remedy=remedy))
        pipe.flush(1.0)
        return 2
    flight = Flight(vehicle.controls, vehicle.state, config.flight, pipe.send)
    pipe.send(Ready(system=vehicle.state.system))
    alive = _Alive(vehicle.controls)
    try:
        _fly(flight, vehicle, pipe, alive)
    finally:
        # Also after an exception: the vehicle must not be left flying our last setpoint.
        flight.stop("failsafe", "the pilot process failed", time.monotonic())
        until = time.monotonic() + _FAREWELL_S
        while flight.phase == "holding" and time.monotonic() < until:
            alive.tick()
            flight.step(time.monotonic())
            time.sleep(TICK_S)  # paces the loop
        pipe.flush(0.5)
        alive.stop()
        vehicle.close()
    return 0


def _fly(flight: Flight, vehicle: _Vehicle, pipe: _Pipe, alive: _Alive) -> None:
    quit_asked = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: quit_asked.set())
    connected: bool | None = None
    next_s = time.monotonic()
    while True:
        now = time.monotonic()
        alive.tick()
        for line in pipe.take():
            flight.heard(now)
            match line:
                case Begin():
                    flight.begin(line.bounds, now)
                case Aim():
                    flight.aim(line.heading_rad)
                case FlyOrder():
                    flight.order(line, now)
                case Quit():
                    quit_asked.set()
                case KeepAlive():
                    pass
        with contextlib.suppress(queue.Empty):
            while True:
                flight.rival(vehicle.rivals.get_nowait(), now)
        vehicle.keep_rates(now)
        flight.step(now)
        if vehicle.state.connected(now) != connected and vehicle.state.heartbeat_s is not None:
            if connected is not None:
                kind: EventKind = "link-lost" if connected else "link-back"
                pipe.send(EventReport(t_s=now, kind=kind, text="the autopilot's heartbeat"))
            connected = vehicle.state.connected(now)
        if pipe.closed.is_set() or quit_asked.is_set():
            flight.stop("deadman", "the program has ended", now)
            return
        next_s = max(next_s + TICK_S, now)
        time.sleep(max(0.0, next_s - time.monotonic()))  # paces the loop


class _Alive:
    """Ends this process when its loop hangs."""

    def __init__(self, controls: MavsdkControls) -> None:
        self._controls = controls
        self._ticked_s = time.monotonic()
        self._stopped = threading.Event()
        threading.Thread(target=self._watch, name="watchdog", daemon=True).start()

    def tick(self) -> None:
        """The loop is alive."""
        self._ticked_s = time.monotonic()
        # The default action of SIGALRM ends the process without any help from Python.
        signal.setitimer(signal.ITIMER_REAL, _ALARM_S)

    def stop(self) -> None:
        """No more watching, only the alarm for what is left to do."""
        self._stopped.set()
        signal.setitimer(signal.ITIMER_REAL, 5.0)

    def _watch(self) -> None:
        while not self._stopped.wait(0.1):
            if time.monotonic() - self._ticked_s > _HANG_S:
                self._controls.stop()
                time.sleep(0.5)  # lets the stop go out before the process ends
                os._exit(3)


def _own_stdout() -> tuple[int, int]:
    """File descriptors from and to the program. MAVSDK writes its log to 1, which becomes the standard error."""
    sink = os.dup(1)
    os.dup2(2, 1)
    return 0, sink


def _write_all(sink: int, data: bytes) -> None:
    while data:
        data = data[os.write(sink, data) :]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
