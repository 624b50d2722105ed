"""A simulated autopilot in a process of its own."""

from __future__ import annotations

import contextlib
import json
import selectors
import socket
import subprocess
import sys
import time
from dataclasses import replace
from typing import IO

from mission.errors import LinkError
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flavour import Mode

_START_S = 30.0
_STOP_S = 3.0


class AutopilotProcess:
    """A running autopilot. It ends with `stop`, and also when this process dies."""

    def __init__(self, process: subprocess.Popen[str], ports: dict[str, int | None], config: AutopilotConfig) -> None:
        self._process = process
        self._ports = ports
        self.config = config

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

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

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

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

    def state(self, timeout_s: float = 5.0) -> dict[str, object]:
        """The autopilot's inside, for tests: mode, armed, landed, failsafe, roi_enu_m, mission_items, ...

        Raises:
            LinkError: it does not answer.
        """
        self._order({"state": True})
        answer = _read_line(self._process, timeout_s)
        if not answer:
            raise LinkError("the simulated autopilot does not answer", "see its standard error")
        found: dict[str, object] = json.loads(answer)
        return found

    def stop(self) -> None:
        """End it. Safe to call twice."""
        stdin = self._process.stdin
        if stdin is not None and not stdin.closed:
            with contextlib.suppress(BrokenPipeError):
                stdin.close()
        try:
            self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _url(self, scheme: str, name: str) -> str:
        port = self._ports[name]
        if port is None:
            raise LinkError(f"the simulated autopilot has no {name} link", f"set {name}_port in its configuration")
        return f"{scheme}://127.0.0.1:{port}"

    def _order(self, order: dict[str, object]) -> None:
        stdin: IO[str] | None = self._process.stdin
        if stdin is None or stdin.closed or not self.alive:
            raise LinkError("the simulated autopilot has ended", "start it again")
        stdin.write(json.dumps(order) + "\n")
        stdin.flush()


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
    command = [sys.executable, "-m", "sitl.autopilot", "--control", "--config", config.to_json()]
    if truth_name is not None:
        command += ["--truth", truth_name]
    # a session of its own: Ctrl-C is for the program that flies it, not for the aircraft
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    line = _read_line(process, _START_S)
    if not line:
        process.kill()
        process.wait()
        raise LinkError("the simulated autopilot did not start", "see its standard error above")
    return AutopilotProcess(process, json.loads(line), config)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def _read_line(process: subprocess.Popen[str], timeout_s: float) -> str:
    """A line from its standard output; empty if none comes in time."""
    if process.stdout is None:
        return ""
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            if selector.select(0.2):
                return process.stdout.readline()
            if process.poll() is not None:
                return ""
    return ""
