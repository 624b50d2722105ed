"""A simulated AR.Drone in a process of its own, with its camera in another."""

from __future__ import annotations

import json
import subprocess

from sitl.aircraft.process import AircraftProcess, start_program
from sitl.ardrone.config import ArdroneConfig
from sitl.ardrone.server import Ports
from sitl.camera.process import CameraStats, Fault
from sitl.scenario.schema import Scenario

_NAME = "the simulated AR.Drone"
_START_S = 90.0
_STOP_S = 8.0


class ArdroneProcess(AircraftProcess):
    """A running AR.Drone. It ends with `stop`, and also when this process dies."""

    def __init__(self, process: subprocess.Popen[str], ports: Ports, config: ArdroneConfig) -> None:
        super().__init__(_NAME, process, _STOP_S)
        self.ports = ports
        self.config = config

    @property
    def url(self) -> str:
        """Its address, with all its ports."""
        return ardrone_url(self.config.host, self.ports)

    def set_battery(self, percent: float) -> None:
        """Set what is left in the battery."""
        self._order({"battery_percent": percent})

    def fault(self, fault: Fault) -> None:
        """Break the video: `freeze` repeats one picture, `cut` sends nothing, `resume` ends both."""
        self._order({"video": fault})

    def stats(self, timeout_s: float = 5.0) -> CameraStats:
        """How its camera is doing.

        Raises:
            LinkError: it does not answer, or has no camera.
        """
        found = self._asked({"camera": True}, timeout_s)
        number = {name: float(str(value)) for name, value in found.items()}
        return CameraStats(round(number["frames"]), round(number["dropped"]), number["cpu_share"], number["delay_s"])


def ardrone_url(host: str, ports: Ports) -> str:
    """Address of an aircraft at ports of one's own."""
    video = "" if ports.video is None else f"&video={ports.video}"
    return f"ardrone://{host}?at={ports.at}&navdata={ports.navdata}{video}"


def start_ardrone(
    config: ArdroneConfig,
    truth_name: str | None = None,
    scenario: Scenario | None = None,
) -> ArdroneProcess:
    """Start one and wait until it runs.

    Args:
        config: what to simulate; ports that are 0 are chosen.
        truth_name: of the `TruthRing` it writes to, 200 times a second; it makes its own when not given.
        scenario: what its camera sees; without one there is no video.

    Raises:
        LinkError: it did not start.
    """
    arguments = ["--config", config.to_json()]
    if truth_name is not None:
        arguments += ["--truth", truth_name]
    if scenario is not None:
        arguments += ["--scenario-json", scenario.model_dump_json()]
    process, ports = start_program(_NAME, "sitl.ardrone", arguments, _START_S)
    return ArdroneProcess(process, Ports(**json.loads(ports)), config)
