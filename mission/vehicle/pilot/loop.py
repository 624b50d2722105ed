"""The loop of a pilot process, whatever it flies: the program's orders in, the flight's rules, hold at the end.

What stops the aircraft, from the outside in:

- The program is silent for 0.5 s: hold (`FlightRules`).
- The program's end of the pipe closes, or its process is gone: hold, then the pilot process ends; at once while it
  still connects.
- An exception here: hold, then the pilot process ends.
- The pilot process's own loop hangs: a thread orders hold after 0.5 s and ends the process; should Python itself hang,
  the kernel's alarm ends it after 2 s. Its setpoints die with it, and the aircraft's own failsafe takes over.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from typing import Final, Protocol

from pydantic import ValidationError

from mission.errors import SidestepError
from mission.vehicle.drone import EventKind
from mission.vehicle.limits import FlightSettings
from mission.vehicle.pilot.controls import Controls
from mission.vehicle.pilot.pipe import LoopWatchdog, PilotPipe, own_stdout
from mission.vehicle.pilot.preconditions import Guards
from mission.vehicle.pilot.protocol import AimOrder, Begin, EventReport, Failed, FlyOrder, KeepAlive, Quit, Ready
from mission.vehicle.pilot.rules import FlightRules
from mission.vehicle.state.vehicle_state import VehicleState

TICK_S: Final = 0.02


class PilotedAircraft(Protocol):
    """What the loop flies: connected, and to be looked after at every tick."""

    @property
    def controls(self) -> Controls:
        """What the flight's rules can do to it."""
        ...

    @property
    def state(self) -> VehicleState:
        """What it reports."""
        ...

    @property
    def guards(self) -> Guards | None:
        """What is known of it beyond its state."""
        ...

    @property
    def settings(self) -> FlightSettings:
        """Limits of the flight."""
        ...

    @property
    def sign_of_life(self) -> str:
        """What is no longer heard when the link is lost."""
        ...

    @property
    def farewell_s(self) -> float:
        """The longest that hold may take to be confirmed before the process ends."""
        ...

    @property
    def idle_tick_s(self) -> float:
        """Between two turns of the loop while we do not fly it."""
        ...

    def look(self, flight: FlightRules, now_s: float) -> list[EventReport]:
        """Take in what came, before the flight's rules look at it; what the program should know of it."""
        ...

    def order_begins(self) -> None:
        """The operator ordered something: look again at what may have changed since."""
        ...

    def send(self, now_s: float) -> None:
        """Send what is due, after the flight's rules."""
        ...

    def close(self) -> None:
        """Silence everything."""
        ...


def run(connect: Callable[[PilotPipe], PilotedAircraft]) -> int:
    """Be the pilot process until the program goes.

    Args:
        connect: opens the connection; raises SidestepError or ValidationError when that cannot be.

    Returns:
        Exit status: 0 after an orderly end, 2 when there was no connection.
    """
    source, sink = own_stdout()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = PilotPipe(source, sink)
    try:
        with pipe.ends_with_program():
            aircraft = connect(pipe)
    except (ValidationError, SidestepError) as error:
        cause, remedy = (error.cause, error.remedy) if isinstance(error, SidestepError) else (str(error), "")
        pipe.send(Failed(cause=cause, remedy=remedy))
        pipe.flush(1.0)
        return 2
    flight = FlightRules(aircraft.controls, aircraft.state, aircraft.settings, pipe.send, aircraft.guards)
    pipe.send(Ready(system=aircraft.state.system))
    alive = LoopWatchdog(flight.order_hold_once)
    try:
        _fly(flight, aircraft, pipe, alive)
    finally:
        # Also after an exception: the aircraft must not be left flying our last setpoint.
        flight.stop("failsafe", "the pilot process failed", time.monotonic())
        until = time.monotonic() + aircraft.farewell_s
        while flight.phase == "holding" and (now := time.monotonic()) < until:
            alive.tick()
            flight.step(now)
            aircraft.send(now)
            time.sleep(TICK_S)  # paces the loop
        pipe.flush(0.5)
        alive.stop()
        aircraft.close()
    return 0


def _fly(flight: FlightRules, aircraft: PilotedAircraft, pipe: PilotPipe, alive: LoopWatchdog) -> None:
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
                    aircraft.order_begins()
                case AimOrder():
                    flight.aim(line.heading_rad)
                case FlyOrder():
                    flight.order(line, now)
                case Quit():
                    quit_asked.set()
                case KeepAlive():
                    pass
        for report in aircraft.look(flight, now):
            pipe.send(report)
        flight.step(now)
        aircraft.send(now)
        was, state = connected, aircraft.state
        connected = state.connected(now) if state.heartbeat_s is not None else None
        if was is not None and connected is not None and connected != was:
            kind: EventKind = "link-back" if connected else "link-lost"
            pipe.send(EventReport(t_s=now, kind=kind, text=aircraft.sign_of_life))
        if pipe.closed.is_set() or quit_asked.is_set():
            flight.stop("deadman", "the program has ended", now)
            return
        next_s = max(next_s + (aircraft.idle_tick_s if flight.phase == "idle" else TICK_S), now)
        time.sleep(max(0.0, next_s - time.monotonic()))  # paces the loop
