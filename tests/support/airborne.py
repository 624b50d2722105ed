"""The simulation with `sidestep locate` as users run it, over a link that can be spoiled."""

from __future__ import annotations

import struct
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot import AutopilotProcess, Mode
from sitl.camera import CameraProcess
from sitl.faults import FaultRelay, LinkFaults
from sitl.scenario.schema import parse_scenario
from sitl.simulation.processes import Simulation, simulation
from sitl.simulation.run import Result, locate, scored
from tests.support.fault_bench import free_port

PATTERN = "sidestep: out-and-back"
"""What `sidestep locate` says when the pattern begins."""
TAKE_OFF = ("--take-off", "1.6")
_STARVED = (
    "position is no longer received",
    "is not heard",
    "the program was silent",
    "no picture for 1 s",
    "no person found in 8 s",
)
"""Ends of a flight that a machine without time to spare brings about by itself: the simulator or the program stalls."""
_ATTEMPTS = 3


@dataclass
class Airborne:
    """A simulation, and the relay between its aircraft and whoever flies it."""

    running: Simulation
    report: Path
    relay: FaultRelay
    attempts: int = _ATTEMPTS
    """Flights that are flown for one, where `_STARVED` says why it ended; 1 where figures are taken."""

    @property
    def autopilot(self) -> AutopilotProcess:
        """The simulated autopilot."""
        assert isinstance(self.running.autopilot, AutopilotProcess)
        return self.running.autopilot

    @property
    def camera(self) -> CameraProcess:
        """The simulated camera."""
        assert isinstance(self.running.camera, CameraProcess)
        return self.running.camera

    @property
    def link(self) -> tuple[str, str]:
        """The option that sends `sidestep locate` through the relay."""
        return "--link", f"udpin://127.0.0.1:{self.relay.program_port}"

    def locate(self, *options: str) -> tuple[Result, str]:
        """A whole flight, scored against the truth, and all that was said; again where the machine had no time."""
        for _ in range(self.attempts):
            code, said = locate(self.running, [*self.link, *options])
            result, text = scored(self.running, self.report, code, said), " ".join(" ".join(said).split())
            if result.exit_code == 0 or not any(reason in text for reason in _STARVED):
                break
            warnings.warn(f"flown again, since the machine had no time: {text[-120:]}", stacklevel=2)
            if self.autopilot.state()["armed"]:
                options = tuple(option for option in options if option not in TAKE_OFF)
                self._to_hold()
        return result, text

    def locate_until(self, marker: str, act: Callable[[subprocess.Popen[str]], object]) -> tuple[int, str]:
        """Run `sidestep locate`, act when a line with the marker appears; its exit code and all that it said.

        The video's delay is not measured, which makes the way to the pattern shorter. Where the machine had no time for
        it to come to the marker, it is run again.
        """
        quick = self.report / "quick.toml"
        settings = self.running.settings.read_text(encoding="utf-8")
        quick.write_text(settings.replace("[video]", "[video]\ncheck_offset = false"), encoding="utf-8")
        command = [sys.executable, "-m", "gcs_plugin", "locate", "--settings", str(quick), *self.link]
        for _ in range(self.attempts):
            said, acted = [], False
            with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
                for line in process.stdout or ():
                    said.append(line)
                    if marker in line and not acted:
                        acted = True
                        act(process)
                code = process.wait(60.0)
            text = " ".join(" ".join(said).split())
            if acted or not any(reason in text for reason in _STARVED):
                break
            warnings.warn(f"flown again, since the machine had no time: {text[-120:]}", stacklevel=2)
            self._to_hold()
        assert acted, f"{marker!r} was not said: {text}"
        return code, text

    def newest_folder(self) -> Path:
        """Of the flight that was flown last."""
        return max((self.report / "flights").glob("2*"), key=lambda path: path.stat().st_mtime)

    def comes_to_rest(self) -> bool:
        """Whether the true aircraft stands still within a few seconds, and stays in the air."""
        deadline = time.monotonic() + 10.0
        still_since = None
        while time.monotonic() < deadline:
            truth = self.running.ring.newest()
            assert truth is not None
            now = time.monotonic()
            still = np.linalg.norm(truth.velocity_enu_m_s) < 0.25 and truth.position_enu_m[2] > 0.8
            still_since = (still_since or now) if still else None
            if still_since is not None and now - still_since > 1.0:
                return True
            time.sleep(0.05)  # looks at the truth 20 times a second
        return False

    def _to_hold(self) -> None:
        """The operator ends what a flight left."""
        assert self.comes_to_rest()
        self.autopilot.switch(Mode.HOLD)

    def set_integer(self, name: str, value: int) -> None:
        """Set an integer parameter of PX4 as an operator would."""
        url = self.autopilot.operator_url.replace("://", ":")
        operator = mavutil.mavlink_connection(url, source_system=255)
        raw = struct.unpack("<f", struct.pack("<i", value))[0]
        operator.mav.param_set_send(1, 1, name.encode(), raw, mavlink.MAV_PARAM_TYPE_INT32)
        assert operator.recv_match(type="PARAM_VALUE", blocking=True, timeout=3.0) is not None
        operator.close()


@contextmanager
def airborne(
    scenario: str, report: Path, *, extra_settings: str = "", faults: LinkFaults | None = None
) -> Iterator[Airborne]:
    """Start a scenario's simulation with a relay on its link.

    Args:
        scenario: TOML.
        report: folder of its files and flights.
        extra_settings: TOML that is appended to the mission's settings.
        faults: of the link, from the start.
    """
    with ExitStack() as stack:
        running = stack.enter_context(simulation(parse_scenario(scenario), report, extra_settings=extra_settings))
        port = urlsplit(running.autopilot.url).port
        relay = FaultRelay(free_port(), port or 0, seed=running.scenario.seed)
        stack.callback(relay.close)
        if faults is not None:
            relay.set(faults)
        yield Airborne(running, report, relay)
