"""The AR.Drone's pilot process: ``python -m mission.vehicle.ardrone.pilot CONFIG``, started by `ARDrone`.

It alone talks to the drone: AT commands out, navdata in and on to the program. Its loop and its rules are those of any
aircraft (`mission.vehicle.pilot.loop`, `mission.vehicle.pilot.rules`); hold is hover here (AT*PCMD with flag 0). When
this process is gone, the drone hears no command, raises its communication watchdog, and hovers within 2 s.
"""

from __future__ import annotations

import sys
import time

from mission.errors import LinkError
from mission.vehicle.ardrone.config import ConfigDialogue
from mission.vehicle.ardrone.controls import ArdroneControls
from mission.vehicle.ardrone.link import ArdroneLink, NavdataRelay
from mission.vehicle.ardrone.navdata import DroneState, Navdata
from mission.vehicle.ardrone.pilot_config import ArdronePilotConfig
from mission.vehicle.ardrone.reckoning import Reckoning
from mission.vehicle.ardrone.vehicle import ArdroneVehicle
from mission.vehicle.limits import FlightSettings
from mission.vehicle.pilot.loop import TICK_S, run
from mission.vehicle.pilot.pipe import PilotPipe
from mission.vehicle.pilot.preconditions import Guards
from mission.vehicle.pilot.protocol import EventReport
from mission.vehicle.pilot.rules import FlightRules

SEND_S = 0.028
"""The SDK asks for a command every 30 ms."""


class _Aircraft:
    """The drone as this process sees it: link, state, configuration, controls. `pilot_loop.Aircraft`."""

    farewell_s = 1.5
    idle_tick_s = TICK_S
    sign_of_life = "the AR.Drone's navdata"
    guards: Guards | None = None

    def __init__(self, config: ArdronePilotConfig) -> None:
        self._config = config
        self.settings: FlightSettings = config.flight
        self.state = ArdroneVehicle()
        self.controls = ArdroneControls(self.state, config.drone)
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
        return self.state.local is not None and self._dialogue.done

    @property
    def heard(self) -> bool:
        """Whether there was any navdata."""
        return self.state.heartbeat_s is not None

    def look(self, flight: FlightRules, now_s: float) -> list[EventReport]:
        """Configuration keys that were not acknowledged, once; the link's thread has taken in everything else."""
        del flight
        given_up, self._dialogue.given_up = self._dialogue.given_up, []
        return [EventReport(t_s=now_s, kind="statustext", text=f"{key} was not acknowledged") for key in given_up]

    def order_begins(self) -> None:
        """Nothing: it tells everything all the time."""

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
        self.state.take(navdata, self._reckoning.add(navdata, arrived_s), arrived_s)


def main(arguments: list[str]) -> int:
    """Run until the program goes; exit status 0 after an orderly end."""
    return run(lambda pipe: _connected(ArdronePilotConfig.model_validate_json(arguments[0] if arguments else ""), pipe))


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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
