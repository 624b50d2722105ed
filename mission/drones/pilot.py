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
from mission.drones.limits import Fence
from mission.drones.link import MavlinkLink
from mission.drones.loopback import loopback_socket
from mission.drones.packet_loss import PacketLoss
from mission.drones.pilot_config import MAVSDK_COMPONENT, PILOT_COMPONENT, PROGRAM_COMPONENT, PilotConfig
from mission.drones.pilot_pipe import LoopWatchdog, PilotPipe, own_stdout
from mission.drones.pilot_protocol import (
    Aim,
    Begin,
    EventReport,
    Failed,
    FlyOrder,
    KeepAlive,
    Quit,
    Ready,
)
from mission.drones.rates import MessageRates, ask_rate
from mission.drones.safeguards import SAFEGUARD_MESSAGES, Safeguards
from mission.drones.vehicle import VEHICLE_MESSAGES, VehicleState
from mission.errors import LinkError, SidestepError

_LOG = logging.getLogger(__name__)

TICK_S = 0.02
_FAREWELL_S = 6.0
_FOREIGN = ("SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET", "COMMAND_INT")
_DO_REPOSITION = 192
_ASK_TARGET_S = 2.0
_ASK_TARGET_TIMES = 3
_TARGET_HZ = 200.0
_IDLE_TARGET_HZ = 2.0


class _Vehicle:
    """The connections: MAVSDK on the vehicle's, and two loopback links behind it."""

    def __init__(self, config: PilotConfig) -> None:
        self.mavsdk, self.system = _connect(config)
        self.state = VehicleState(self.system.get_system_id())
        self.safeguards = Safeguards(self.state)
        self.loss = PacketLoss()
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
            handled=(*VEHICLE_MESSAGES, *_FOREIGN, *SAFEGUARD_MESSAGES),
            on_frame=lambda frame, now_s: self.loss.observe(frame, self.state.system, now_s),
        )
        for loopback in (port, config.program_port):
            self.mavsdk.add_any_connection_with_handle_and_forwarding(
                f"udpout://127.0.0.1:{loopback}", ForwardingOption.ON
            )
        self.controls = MavsdkControls(self.system, self.link, self.state)
        self.rates: MessageRates | None = None
        self._target_asked_s = -_ASK_TARGET_S
        self._target_watched = False
        self._target_asks = _ASK_TARGET_TIMES

    def keep_rates(self, now_s: float) -> None:
        """Ask for what the flight watches, in the autopilot's own terms."""
        if self.rates is None and self.state.heartbeat_s is not None:
            wanted = {"LOCAL_POSITION_NED": 50.0, "GLOBAL_POSITION_INT": 50.0, "ATTITUDE": 50.0}
            wanted |= {"EXTENDED_SYS_STATE": 5.0, "SYS_STATUS": 2.0, "GPS_RAW_INT": 5.0, "HOME_POSITION": 1.0}
            if self.state.autopilot == "px4":
                wanted |= {"CURRENT_MODE": 20.0, "ESTIMATOR_STATUS": 1.0}
            else:
                wanted |= {"EKF_STATUS_REPORT": 2.0}
            self.rates = MessageRates(self.link, wanted, now_s)
        if self.rates is not None:
            self.rates.keep(now_s)

    def fence(self) -> Fence | None:
        """The autopilot's geofence."""
        return self.safeguards.fence()

    def refusal(self, must_hold: bool) -> str | None:
        """Why the autopilot's own reactions forbid a flight."""
        return self.safeguards.refusal(must_hold)

    def packet_loss(self, now_s: float) -> float | None:
        """Fraction of the autopilot's packets that do not arrive."""
        return self.loss.fraction(now_s)

    def watch_target(self, flying: bool, now_s: float) -> None:
        """Ask ArduPilot for its own target, which is all that shows an operator's "fly here" in GUIDED.

        It is there only until our next setpoint, so it is asked for at the highest rate while we fly. That costs
        nothing: following our setpoints it has no target to report (ModeGuided::get_wp).
        """
        changed, self._target_watched = flying != self._target_watched, flying
        self._target_asks = 0 if changed else self._target_asks
        due = changed or now_s - self._target_asked_s > _ASK_TARGET_S
        # Without an end while we fly, since the autopilot may have forgotten; afterwards a few times, for lossy links.
        if self.state.autopilot == "ardupilot" and due and (flying or self._target_asks < _ASK_TARGET_TIMES):
            self._target_asked_s, self._target_asks = now_s, self._target_asks + 1
            ask_rate(self.link, "POSITION_TARGET_GLOBAL_INT", _TARGET_HZ if flying else _IDLE_TARGET_HZ)

    def close(self) -> None:
        """Silence everything."""
        self.controls.release()
        self.link.close()
        self.mavsdk.destroy()

    def _take(self, message: Any, arrived_s: float) -> None:
        name = message.get_type()
        if name in SAFEGUARD_MESSAGES:
            self.safeguards.take(message)
            return
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


def main(arguments: list[str]) -> int:
    """Run until the program goes; exit status 0 after an orderly end."""
    source, sink = own_stdout()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = PilotPipe(source, sink)
    try:
        config = PilotConfig.model_validate_json(arguments[0])
        vehicle = _Vehicle(config)
    except (IndexError, ValidationError, SidestepError) as error:
        cause, remedy = (error.cause, error.remedy) if isinstance(error, SidestepError) else (str(error), "")
        pipe.send(Failed(cause=cause, remedy=remedy))
        pipe.flush(1.0)
        return 2
    flight = Flight(vehicle.controls, vehicle.state, config.flight, pipe.send, vehicle)
    pipe.send(Ready(system=vehicle.state.system))
    alive = LoopWatchdog(vehicle.controls.stop)
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


def _fly(flight: Flight, vehicle: _Vehicle, pipe: PilotPipe, alive: LoopWatchdog) -> None:
    quit_asked = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: quit_asked.set())
    connected: bool | None = None
    cautioned = False
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
        vehicle.safeguards.ask(vehicle.link, now)
        if vehicle.safeguards.known and not cautioned:
            cautioned = True
            for text in vehicle.safeguards.cautions():
                pipe.send(EventReport(t_s=now, kind="caution", text=text))
        vehicle.watch_target(flight.phase in ("entering", "flying"), now)
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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
