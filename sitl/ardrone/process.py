"""A simulated AR.Drone in a process of its own, with its camera in another."""

from __future__ import annotations

import contextlib
import json
import selectors
import subprocess
import sys
import time

from mission.errors import LinkError
from sitl.ardrone.config import ArdroneConfig
from sitl.ardrone.server import Ports
from sitl.camera.process import CameraStats, Fault
from sitl.scenario import Scenario

_START_S = 90.0
_STOP_S = 8.0


class ArdroneProcess:
    """A running AR.Drone. It ends with `stop`, and also when this process dies."""

    def __init__(self, process: subprocess.Popen[str], ports: Ports, config: ArdroneConfig) -> None:
        self._process = process
        self.ports = ports
        self.config = config

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def url(self) -> str:
        """Its address, with all its ports."""
        return ardrone_url(self.config.host, self.ports)

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def set_battery(self, percent: float) -> None:
        """Set what is left in the battery."""
        self._order({"battery_percent": percent})

    def fault(self, fault: Fault) -> None:
        """Break the video: `freeze` repeats one picture, `cut` sends nothing, `resume` ends both."""
        self._order({"video": fault})

    def state(self, timeout_s: float = 5.0) -> dict[str, object]:
        """The aircraft's inside, for tests: state, emergency, lost, position_enu_m, ids, ...

        Raises:
            LinkError: it does not answer.
        """
        return self._asked({"state": True}, timeout_s)

    def stats(self, timeout_s: float = 5.0) -> CameraStats:
        """How its camera is doing.

        Raises:
            LinkError: it does not answer, or has no camera.
        """
        found = self._asked({"camera": True}, timeout_s)
        number = {name: float(str(value)) for name, value in found.items()}
        return CameraStats(round(number["frames"]), round(number["dropped"]), number["cpu_share"], number["delay_s"])

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

    def _asked(self, order: dict[str, object], timeout_s: float) -> dict[str, object]:
        self._order(order)
        answer = _read_line(self._process, timeout_s)
        if not answer:
            raise LinkError("the simulated AR.Drone does not answer", "see its standard error")
        found: dict[str, object] = json.loads(answer)
        return found

    def _order(self, order: dict[str, object]) -> None:
        stdin = self._process.stdin
        if stdin is None or stdin.closed or not self.alive:
            raise LinkError("the simulated AR.Drone has ended", "start it again")
        stdin.write(json.dumps(order) + "\n")
        stdin.flush()


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
    command = [sys.executable, "-m", "sitl.ardrone", "--control", "--config", config.to_json()]
    if truth_name is not None:
        command += ["--truth", truth_name]
    if scenario is not None:
        command += ["--scenario-json", scenario.model_dump_json()]
    # a session of its own: Ctrl-C is for the program that flies it, not for the aircraft
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    line = _read_line(process, _START_S)
    if not line:
        process.kill()
        process.wait()
        raise LinkError("the simulated AR.Drone did not start", "see its standard error above")
    return ArdroneProcess(process, Ports(**json.loads(line)), config)


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
