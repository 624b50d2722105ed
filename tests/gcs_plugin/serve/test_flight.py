"""A closed loop over MAVLink: the operator's box, the sidestep, the answer; and an abort on the way."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from gcs_plugin.component.commands import CANCELLED
from sitl.autopilot import AutopilotProcess, Mode
from sitl.run import Result, scored
from sitl.scenario import parse_scenario
from sitl.simulation import Simulation, simulation
from tests.gcs_plugin.serve.station import Station, until
from tests.sitl.test_run import SCENARIO

pytestmark = pytest.mark.flight

USER_1, USER_2, RECTANGLE = 31010, 31011, 2005
ACCEPTED, IN_PROGRESS = 0, 5
KEY = bytes(range(32))
SIGNED = """
[authority]
key_file = "key"
[orders]
box = "locate"
"""


@dataclass
class Flown:
    """What happened, one thing after the other."""

    autopilot: dict[str, object] = field(default_factory=dict)
    acknowledged_s: float = 0.0
    unsigned: list[int] = field(default_factory=list)
    box: list[int] = field(default_factory=list)
    progress: list[int] = field(default_factory=list)
    abort: list[int] = field(default_factory=list)
    mode_after_abort: str = ""
    statuses: int = 0
    answers: int = 0
    texts: str = ""
    exit_code: int = -1
    result: Result | None = None


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flown]:
    report = tmp_path_factory.mktemp("served")
    (report / "key").write_bytes(KEY)
    with simulation(parse_scenario(SCENARIO), report, extra_settings=SIGNED) as running:
        command = [sys.executable, "-m", "gcs_plugin", "serve", "--settings", str(running.settings)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            try:
                yield fly(running, process, report)
            finally:
                process.terminate()
                process.wait(20.0)


def fly(running: Simulation, process: subprocess.Popen[str], report: Path) -> Flown:
    autopilot = running.autopilot
    assert isinstance(autopilot, AutopilotProcess)
    flown = Flown()
    with Station(autopilot.operator_url, KEY) as station, Station(autopilot.operator_url, source=(254, 190)) as other:
        station.take_off(1.6)
        assert until(lambda: station.found("HEARTBEAT") and other.found("HEARTBEAT"), 60.0)
        other.command(USER_1)
        assert until(lambda: other.results(USER_1), 5.0)
        flown.unsigned = other.results(USER_1)

        began = time.monotonic()
        station.command(RECTANGLE, 0.46, 0.22, 0.66, 0.72)
        assert until(lambda: station.results(RECTANGLE), 5.0)
        flown.acknowledged_s = time.monotonic() - began
        assert until(lambda: station.found("CAMERA_TRACKING_GEO_STATUS"), 60.0), station.texts()
        assert until(lambda: "target 1" in station.texts(), 5.0)
        flown.box = station.results(RECTANGLE)
        flown.autopilot = autopilot.state()

        def taken() -> bool:  # the first order's pictures may still be written
            station.command(USER_1)
            return until(lambda: IN_PROGRESS in station.results(USER_1), 1.0)

        assert until(taken, 15.0)
        assert until(lambda: autopilot.state()["mode"] == Mode.OFFBOARD.value, 10.0)
        station.command(USER_2)
        assert until(lambda: CANCELLED in station.results(USER_1), 15.0)
        flown.progress = station.results(USER_1)
        flown.abort = station.results(USER_2)
        flown.mode_after_abort = str(autopilot.state()["mode"])
        flown.statuses = len(station.found("CAMERA_TRACKING_IMAGE_STATUS"))
        flown.answers = len(station.found("CAMERA_TRACKING_GEO_STATUS"))
        flown.texts = station.texts()
    process.terminate()
    said = list(process.stdout or ())
    flown.exit_code = process.wait(20.0)
    first = min(path.parent for path in (report / "flights").glob("*/estimate.json"))
    for later in (report / "flights").glob("2*"):
        if later != first:
            (later / "answer.json").unlink(missing_ok=True)
    flown.result = scored(running, report, flown.exit_code, said)
    return flown


def test_a_box_is_acknowledged_at_once_and_the_person_located(flown: Flown) -> None:
    assert flown.box == [ACCEPTED]
    assert flown.acknowledged_s < 0.5
    assert flown.result is not None
    assert flown.result.score is not None
    # How exact it is is shown elsewhere, on a machine that does nothing else meanwhile.
    assert flown.result.score.position_error_m < 2.5


def test_the_station_sees_the_box_move_and_gets_the_answer_once(flown: Flown) -> None:
    assert flown.statuses >= 10
    assert flown.answers == 1
    assert "target 1" in flown.texts


def test_the_autopilot_got_the_region_of_interest(flown: Flown) -> None:
    assert flown.result is not None
    assert flown.result.score is not None
    found = np.array(flown.autopilot["roi_enu_m"], dtype=float)[:2]
    assert np.linalg.norm(found - np.array(flown.result.score.truth_enu_m)[:2]) < 2.5


def test_an_unsigned_order_does_not_fly(flown: Flown) -> None:
    assert flown.unsigned == [2]
    assert "254/190 does not sign" in flown.texts


def test_an_abort_cancels_the_next_flight_and_the_aircraft_holds(flown: Flown) -> None:
    assert flown.abort == [ACCEPTED]
    assert flown.progress[-1] == CANCELLED
    assert set(flown.progress[:-1]) <= {IN_PROGRESS, 1}
    assert flown.mode_after_abort == Mode.HOLD.value


def test_the_program_ends_in_order(flown: Flown) -> None:
    assert flown.exit_code == 0
