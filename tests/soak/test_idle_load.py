"""What `sidestep serve` costs while nobody orders anything: its process and its pilot process, telemetry at 50 Hz."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.process import start_autopilot
from tests.soak.conftest import Note
from tests.support.station import Station, until

pytestmark = [pytest.mark.soak, pytest.mark.timeout(300)]

MEASURED_S = 30.0
SETTLED_S = 8.0
MOST_PERCENT = 5.0
RECTANGLE = 2005


def descendants(pid: int) -> list[int]:
    """A process and all that it has started."""
    found = [pid]
    for parent in found:
        for task in Path(f"/proc/{parent}/task").glob("*/children"):
            found += [int(child) for child in task.read_text().split()]
    return found


def cpu_s(pid: int) -> float:
    """Processor time that a process has used, seconds: utime and stime of proc(5)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def acknowledged_s(station: Station, bottom: float) -> float:
    """Seconds from a box to its COMMAND_ACK; it is refused, since the vehicle stands on the ground."""
    before, began_s = len(station.results(RECTANGLE)), time.monotonic()
    station.command(RECTANGLE, 0.25, 0.25, 0.5, bottom)
    while len(station.results(RECTANGLE)) == before:
        assert time.monotonic() - began_s < 5.0
        time.sleep(0.002)  # looks again until the deadline
    return time.monotonic() - began_s


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_waiting_for_orders_costs_less_than_a_twentieth_of_a_core(flavour: str, tmp_path: Path, note: Note) -> None:
    autopilot = start_autopilot(AutopilotConfig(flavour="px4" if flavour == "px4" else "ardupilot"))
    command = [sys.executable, "-m", "gcs_plugin", "serve", "--link", autopilot.url, "--folder", str(tmp_path)]
    with (tmp_path / "said").open("wb") as said, subprocess.Popen(command, stdout=said, stderr=said) as serve:
        try:
            with Station(autopilot.operator_url) as station:
                assert until(lambda: station.found("HEARTBEAT"), 60.0), (tmp_path / "said").read_text()
            time.sleep(SETTLED_S)  # what the start asks for is over
            pids = descendants(serve.pid)
            assert len(pids) == 2, "serve and its pilot process"
            before, began_s = [cpu_s(pid) for pid in pids], time.monotonic()
            time.sleep(MEASURED_S)  # this is the measurement
            span_s = time.monotonic() - began_s
            percent = [100.0 * (cpu_s(pid) - was) / span_s for pid, was in zip(pids, before, strict=True)]
            with Station(autopilot.operator_url) as station:
                assert until(lambda: station.found("HEARTBEAT"), 10.0)
                took_s = [acknowledged_s(station, 0.5 + 0.01 * i) for i in range(15)]
        finally:
            serve.terminate()
            serve.wait(20.0)
            autopilot.stop()
    note(f"{flavour}: load of serve when idle, % of a core", [percent[0]])
    note(f"{flavour}: load of its pilot process when idle, % of a core", [percent[1]])
    note(f"{flavour}: from a box to its answer when idle, ms", [1e3 * s for s in took_s])
    assert sum(percent) < MOST_PERCENT
    assert statistics.median(took_s) < 0.1
