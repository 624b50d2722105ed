"""The AR.Drone's pilot process: ``python -m mission.drones.ardrone.pilot CONFIG``, started by `ARDrone`.

It alone talks to the drone: AT commands out, navdata in and on to the program. The rules are those of every aircraft
(`mission.drones.flight`). What stops the drone, from the outside in:

- The program is silent for 0.5 s, its pipe closes, or an exception here: hover (AT*PCMD with flag 0).
- This process's own loop hangs: a thread orders hover after 0.5 s and ends the process; the kernel's alarm after 2 s.
- This process is gone: the drone hears no command, raises its communication watchdog, and hovers within 2 s.
"""

from __future__ import annotations

import signal
import sys
import threading
import time

from pydantic import ValidationError

from mission.drones.ardrone.config import ConfigDialogue
from mission.drones.ardrone.controls import ArdroneControls
from mission.drones.ardrone.link import ArdroneLink, NavdataRelay
from mission.drones.ardrone.navdata import DroneState, Navdata
from mission.drones.ardrone.pilot_config import ArdronePilotConfig
from mission.drones.ardrone.reckoning import Reckoning
from mission.drones.ardrone.vehicle import ArdroneVehicle
from mission.drones.drone import EventKind
from mission.drones.flight import Flight
from mission.drones.pilot_pipe import LoopWatchdog, PilotPipe, own_stdout
from mission.drones.pilot_protocol import Aim, Begin, EventReport, Failed, FlyOrder, KeepAlive, Quit, Ready
from mission.errors import LinkError, SidestepError

TICK_S = 0.02
SEND_S = 0.028
"""The SDK asks for a command every 30 ms."""
_FAREWELL_S = 1.5


class _Aircraft:
    """The drone as this process sees it: link, state, configuration, controls."""

    def __init__(self, config: ArdronePilotConfig) -> None:
        self._config = config
        self.vehicle = ArdroneVehicle()
        self.controls = ArdroneControls(self.vehicle, config.drone)
        self._reckoning = Reckoning(config.address.declination_rad or 0.0, config.address.velocity_scale)
        self._relay = NavdataRelay(config.program_port)
        self._newest: Navdata | None = None
        self._dialogue = self._new_dialogue()
        self._sent_s = 0.0
        self._bootstrap = False
        self.link = ArdroneLink(config.address, self._take)

    @property
    def ready(self) -> bool:
        """Whether it is configured and tells where it is."""
        return self.vehicle.local is not None and self._dialogue.done

    @property
    def heard(self) -> bool:
        """Whether there was any navdata."""
        return self.vehicle.heartbeat_s is not None

    @property
    def given_up(self) -> list[str]:
        """Configuration keys that were not acknowledged."""
        return self._dialogue.given_up

    def send(self, now_s: float) -> None:
        """What is due: flying first, then configuration."""
        if now_s - self._sent_s < SEND_S:
            return
        self._sent_s = now_s
        commands = self.controls.commands(now_s)
        newest = self._newest
        if newest is not None:
            bootstrap = newest.says(DroneState.NAVDATA_BOOTSTRAP)
            if bootstrap and not self._bootstrap and self._dialogue.done:
                self._dialogue = self._new_dialogue()  # the drone was restarted, and forgot it all
            self._bootstrap = bootstrap
            commands += self._dialogue.step(newest, now_s)
        self.link.send(commands)

    def close(self) -> None:
        """Silence everything; from here the drone hovers by itself."""
        self.link.close()
        self._relay.close()

    def _new_dialogue(self) -> ConfigDialogue:
        return ConfigDialogue(self._config.session, self._config.drone.entries())

    def _take(self, navdata: Navdata, data: bytes, arrived_s: float) -> None:
        """In the link's thread."""
        self._relay.send(data, arrived_s)
        self._newest = navdata
        self.vehicle.take(navdata, self._reckoning.add(navdata, arrived_s), arrived_s)


def main(arguments: list[str]) -> int:
    """Run until the program goes; exit status 0 after an orderly end."""
    source, sink = own_stdout()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = PilotPipe(source, sink)
    try:
        config = ArdronePilotConfig.model_validate_json(arguments[0])
        aircraft = _connected(config, pipe)
    except (IndexError, ValidationError, SidestepError) as error:
        cause, remedy = (error.cause, error.remedy) if isinstance(error, SidestepError) else (str(error), "")
        pipe.send(Failed(cause=cause, remedy=remedy))
        pipe.flush(1.0)
        return 2
    flight = Flight(aircraft.controls, aircraft.vehicle, config.flight, pipe.send)
    pipe.send(Ready(system=1))
    for key in aircraft.given_up:
        pipe.send(EventReport(t_s=time.monotonic(), kind="statustext", text=f"{key} was not acknowledged"))
    alive = LoopWatchdog(aircraft.controls.stop)
    try:
        _fly(flight, aircraft, pipe, alive)
    finally:
        # Also after an exception: the drone must not be left flying our last tilt.
        flight.stop("failsafe", "the pilot process failed", time.monotonic())
        until = time.monotonic() + _FAREWELL_S
        while flight.phase == "holding" and time.monotonic() < until:
            now = time.monotonic()
            alive.tick()
            flight.step(now)
            aircraft.send(now)
            time.sleep(TICK_S)  # paces the loop
        pipe.flush(0.5)
        alive.stop()
        aircraft.close()
    return 0


def _connected(config: ArdronePilotConfig, pipe: PilotPipe) -> _Aircraft:
    """Wake the drone up and configure it.

    Raises:
        LinkError: it is not heard, or tells no position, within the time.
    """
    aircraft = _Aircraft(config)
    until = time.monotonic() + config.connect_timeout_s
    while not aircraft.ready:
        now = time.monotonic()
        aircraft.send(now)
        if pipe.closed.is_set() or now > until:
            aircraft.close()
            address = config.address
            if not aircraft.heard:
                raise LinkError(
                    f"no navdata from {address.host}:{address.navdata_port}",
                    "Join the AR.Drone's Wi-Fi, check that it is on and that no other program holds it",
                )
            raise LinkError("the AR.Drone does not take its configuration", "Switch it off and on")
        time.sleep(TICK_S)  # looks again until the deadline
    return aircraft


def _fly(flight: Flight, aircraft: _Aircraft, pipe: PilotPipe, alive: LoopWatchdog) -> None:
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
        flight.step(now)
        aircraft.send(now)
        if aircraft.vehicle.connected(now) != connected:
            if connected is not None:
                kind: EventKind = "link-lost" if connected else "link-back"
                pipe.send(EventReport(t_s=now, kind=kind, text="the AR.Drone's navdata"))
            connected = aircraft.vehicle.connected(now)
        if pipe.closed.is_set() or quit_asked.is_set():
            flight.stop("deadman", "the program has ended", now)
            return
        next_s = max(next_s + TICK_S, now)
        time.sleep(max(0.0, next_s - time.monotonic()))  # paces the loop


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
