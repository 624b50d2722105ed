"""Real closed loops: a simulated aircraft, `sidestep locate` as users run it, and what goes wrong in the air."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from gcs_plugin.geotags import read_geotags
from sitl.autopilot import AutopilotProcess, Mode
from sitl.run import Result, locate, scored
from sitl.scenario import parse_scenario
from sitl.simulation import Simulation, simulation

pytestmark = pytest.mark.flight

SCENARIO = """
name = "closed-loop"
seed = 11
[autopilot]
wind_m_s = 0.3
[vehicle]
heading_deg = 40.0
[camera]
tilt_down_deg = 10.0
distortion = { k1 = -0.05, k2 = 0.01 }
exposure_ms = 8.0
readout_ms = 16.0
extra_latency_ms = 60.0
[[people]]
distance_m = 5.5
bearing_deg = 46.0
speed_m_s = 0.6
walk_from_line_of_sight_deg = 60.0
when = "drone-turns"
stop_after_s = 13.0
"""


@dataclass
class Airborne:
    """The simulation after its first flight, still in the air."""

    running: Simulation
    first: Result
    said: list[str]

    @property
    def autopilot(self) -> AutopilotProcess:
        assert isinstance(self.running.autopilot, AutopilotProcess)
        return self.running.autopilot

    def locate_until(self, marker: str, act: Callable[[subprocess.Popen[str]], object]) -> tuple[int, str]:
        """Run `sidestep locate`, act when a line with the marker appears; its exit code and all that it said."""
        command = [sys.executable, "-m", "gcs_plugin", "locate", "--settings", str(self.running.settings)]
        said = []
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            for line in process.stdout or ():
                said.append(line)
                if marker in line:
                    act(process)
                    marker = "\0"
            code = process.wait(60.0)
        return code, " ".join(" ".join(said).split())

    def newest_folder(self) -> Path:
        return max((self.running.settings.parent / "flights").glob("2*"), key=lambda path: path.stat().st_mtime)

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


PATTERN = "sidestep: out-and-back"


@pytest.fixture(scope="module")
def airborne(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Airborne]:
    report = tmp_path_factory.mktemp("closed-loop")
    with simulation(parse_scenario(SCENARIO), report) as running:
        code, said = locate(running, ["--take-off", "1.6"])
        yield Airborne(running, scored(running, report, code, said), said)


def test_a_walking_person_is_located(airborne: Airborne) -> None:
    assert airborne.first.score is not None, "\n".join(airborne.said)
    assert airborne.first.exit_code == 0
    assert airborne.first.score.depth_error_pct < 12.0
    assert airborne.first.score.velocity_error_m_s < 0.35


def test_the_error_is_of_the_size_that_the_ellipse_says(airborne: Airborne) -> None:
    assert airborne.first.score is not None
    assert airborne.first.score.nees < 16.0
    assert airborne.first.score.sigma_m < 1.0


def test_the_answer_is_on_the_disk_as_geotag_pictures_and_sightings(airborne: Airborne) -> None:
    flights = airborne.running.settings.parent / "flights"
    folder = airborne.running.settings.parent / airborne.first.flight_folder
    (geotag,) = read_geotags(flights / "geotags.gpkg")[:1]
    assert geotag.picture_type == "image/jpeg"
    for name in ("plan.png", "contact-sheet.jpg", "sightings.jsonl", "events.jsonl", "answer.json", "estimate.json"):
        assert (folder / name).stat().st_size > 100, name


def test_the_autopilot_got_the_region_of_interest_and_the_waypoint(airborne: Airborne) -> None:
    state = airborne.autopilot.state()
    assert airborne.first.score is not None
    assert (
        np.linalg.norm(np.array(state["roi_enu_m"], dtype=float)[:2] - np.array(airborne.first.score.truth_enu_m)[:2])
        < 2.0
    )
    assert state["mission_items"] == 1


def test_the_log_estimates_to_the_same_answer_again(airborne: Airborne) -> None:
    folder = airborne.running.settings.parent / airborne.first.flight_folder
    command = [sys.executable, "-m", "gcs_plugin", "estimate", str(folder / "sightings.jsonl")]
    again = json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout)
    assert airborne.first.answer is not None
    for key in ("position_enu_m", "velocity_enu_m_s", "covariance", "depth_m"):
        assert again[key] == airborne.first.answer[key]


def test_ctrl_c_in_the_pattern_holds_and_leaves_the_log_whole(airborne: Airborne) -> None:
    code, said = airborne.locate_until(PATTERN, lambda process: process.send_signal(signal.SIGINT))
    assert code == 1
    assert "aborted by the operator" in said
    assert airborne.comes_to_rest()
    assert airborne.autopilot.state()["mode"] == Mode.HOLD.value
    folder = airborne.newest_folder()
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    assert events[-1]["kind"] == "failed"
    assert "aborted" in json.loads((folder / "answer.json").read_text())["error"]


def test_video_that_stops_in_the_pattern_holds_and_says_so(airborne: Airborne) -> None:
    code, said = airborne.locate_until(PATTERN, lambda _: airborne.running.camera.fault("cut"))
    airborne.running.camera.fault("resume")
    assert code == 1
    assert "no picture for 1 s" in said
    assert airborne.comes_to_rest()


def test_the_pilot_takes_over_and_keeps_the_aircraft(airborne: Airborne) -> None:
    code, said = airborne.locate_until(PATTERN, lambda _: airborne.autopilot.switch(Mode.LAND))
    assert code == 1
    assert "no answer" not in said
    assert airborne.autopilot.state()["mode"] == Mode.LAND.value
