"""A simulated autopilot in a process of its own."""

from __future__ import annotations

import json
import socket
import subprocess
from dataclasses import replace

from mission.errors import LinkError
from sitl.aircraft.process import AircraftProcess, start_program
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flavour import Mode

_NAME = "the simulated autopilot"
_START_S = 30.0
_STOP_S = 3.0


class AutopilotProcess(AircraftProcess):
    """A running autopilot. It ends with `stop`, and also when this process dies."""

    def __init__(self, process: subprocess.Popen[str], ports: dict[str, int | None], config: AutopilotConfig) -> None:
        super().__init__(_NAME, process, _STOP_S)
        self._ports = ports
        self.config = config

    @property
    def url(self) -> str:
        """What the drone connects to (MAVSDK's form): it listens there for the autopilot."""
        return f"udpin://127.0.0.1:{self._ports['remote']}"

    @property
    def operator_url(self) -> str:
        """Where another ground station connects to.

        Raises:
            LinkError: the configuration has no operator port.
        """
        return self._url("udpout", "operator")

    @property
    def tcp_url(self) -> str:
        """The TCP server, if the configuration has one.

        Raises:
            LinkError: the configuration has no TCP port.
        """
        return self._url("tcpout", "tcp")

    def lose(self, fraction: float, *, all_links: bool = False) -> None:
        """Lose this fraction of the packets, each way, on the companion's link or on all."""
        self._order({"loss": fraction, "link": "all" if all_links else "remote"})

    def cut(self, cut: bool = True, *, all_links: bool = False) -> None:
        """Cut the companion's link (or all), or mend it."""
        self._order({"cut": cut, "link": "all" if all_links else "remote"})

    def set_battery(self, fraction: float) -> None:
        """Set what is left in the battery."""
        self._order({"battery": fraction})

    def switch(self, mode: Mode) -> None:
        """Change the mode as the pilot's switch does, without any message."""
        self._order({"switch": mode.value})

    def _url(self, scheme: str, name: str) -> str:
        port = self._ports[name]
        if port is None:
            raise LinkError(f"{_NAME} has no {name} link", f"set {name}_port in its configuration")
        return f"{scheme}://127.0.0.1:{port}"


def start_autopilot(config: AutopilotConfig, truth_name: str | None = None) -> AutopilotProcess:
    """Start one and wait until it runs.

    Args:
        config: what to simulate; with `remote_port` 0 a free port is found.
        truth_name: of the `TruthRing` it writes to, 200 times a second.

    Raises:
        LinkError: it did not start.
    """
    if config.remote_port == 0:
        config = replace(config, remote_port=_free_port())
    arguments = ["--config", config.to_json()]
    if truth_name is not None:
        arguments += ["--truth", truth_name]
    process, ports = start_program(_NAME, "sitl.autopilot", arguments, _START_S)
    return AutopilotProcess(process, json.loads(ports), config)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])
