"""Fly a scenario and score it: autopilot and camera in processes of their own, `sidestep locate` as any user runs it.

The only ties to the program under test are its command line, its settings file, MAVLink, the video stream, and the
folder that it writes.
"""

from __future__ import annotations

import json
import math
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from mission.camera import Camera, Mounting, write_camera
from mission.records import GeodeticOrigin, Matrix, Vector
from sitl.autopilot import AutopilotConfig, Wind, start_autopilot
from sitl.camera import start_camera
from sitl.external import start_external
from sitl.scenario import Scenario
from sitl.score import Score, score, truth_track
from sitl.truth import TruthRing

FLIGHT_TIMEOUT_S = 150.0
TRUTH_SPAN_S = 300.0
TRUTH_RATE_HZ = 250.0
SETTINGS = """\
[link]
url = "{link}"

[video]
url = "{video}"

[camera]
file = "camera.toml"

[answer]
folder = "flights"
"""


@dataclass(frozen=True, slots=True)
class Result:
    """One scenario, flown."""

    scenario: str
    seed: int
    noise: str
    error: str
    """Why there is no answer; empty when there is one."""
    exit_code: int
    score: Score | None
    answer: dict[str, object] | None
    """The output record of the sightings format."""
    timing: dict[str, object]
    flight_folder: str
    """Relative to the report."""


def fly(
    scenario: Scenario,
    report: Path,
    *,
    extra_settings: str = "",
    external: str | None = None,
    tell: Callable[[str], None] | None = None,
) -> Result:
    """Fly a scenario, score the answer and write `result.json` into the report folder.

    Args:
        scenario: what to fly.
        report: a folder; made when it is not there.
        external: ``px4:PATH`` or ``ardupilot:PATH``, a user's own autopilot binary instead of the simulated one.
        extra_settings: TOML that is appended to the mission's settings.
        tell: when given, gets each line that `sidestep locate` prints.

    Raises:
        SidestepError: the simulator did not start.
    """
    report.mkdir(parents=True, exist_ok=True)
    with _running(scenario, report, extra_settings, external) as ring:
        exit_code, said = _locate(scenario, report, tell)
        result = _scored(scenario, ring, report, exit_code, said)
    text = json.dumps(asdict(result), indent=2)
    (report / "result.json").write_text(text + "\n", encoding="utf-8")
    return result


@contextmanager
def _running(scenario: Scenario, report: Path, extra_settings: str, external: str | None) -> Iterator[TruthRing]:
    """Autopilot and camera, and the settings that lead to them."""
    video = f"udp://127.0.0.1:{_free_udp_port()}"
    write_camera(report / "camera.toml", camera_of(scenario))
    with ExitStack() as stack:
        ring = TruthRing.create(seconds=TRUTH_SPAN_S, rate_hz=TRUTH_RATE_HZ)
        stack.callback(ring.unlink)
        stack.callback(ring.close)
        config = _config(scenario)
        autopilot = start_external(external, config, ring.name) if external else start_autopilot(config, ring.name)
        stack.callback(autopilot.stop)
        text = SETTINGS.format(link=autopilot.url, video=video) + extra_settings
        (report / "sidestep.toml").write_text(text, encoding="utf-8")
        camera = start_camera(scenario, ring.name, video)
        stack.callback(camera.stop)
        yield ring


def _locate(scenario: Scenario, report: Path, tell: Callable[[str], None] | None) -> tuple[int, list[str]]:
    """Run `sidestep locate`, stopped by Ctrl-C when it takes too long."""
    command = [
        sys.executable,
        *__import__("os").environ.get("SIDESTEP_RUN", "-m gcs_plugin").split(),
        "locate",
        "--settings",
        str(report / "sidestep.toml"),
    ]
    command += ["--take-off", f"{scenario.vehicle.take_off_height_m}"]
    said: list[str] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        deadline = time.monotonic() + FLIGHT_TIMEOUT_S
        assert process.stdout is not None
        for line in process.stdout:
            said.append(line.rstrip())
            if tell is not None:
                tell(line.rstrip())
            if time.monotonic() > deadline:
                process.send_signal(signal.SIGINT)
        return process.wait(), said


def _scored(scenario: Scenario, ring: TruthRing, report: Path, exit_code: int, said: list[str]) -> Result:
    folders = sorted(path.parent for path in (report / "flights").glob("*/answer.json"))
    content = {**_json(folders[-1] / "answer.json"), **_json(folders[-1] / "estimate.json")} if folders else {}
    answer = content.get("estimate")
    timing = content.get("timing")
    found: Score | None = None
    error = str(content.get("error") or "")
    if isinstance(answer, dict):
        origin, first_s, first = _first_sighting(folders[-1] / "sightings.jsonl")
        found = score(scenario, ring, answer, first, origin)
        _draw(folders[-1], truth_track(scenario, ring, first_s, float(str(answer["t_s"])), first))
    elif not error:
        error = said[-1] if said else "sidestep locate said nothing"
    return Result(
        scenario=scenario.name,
        seed=scenario.seed,
        noise=scenario.autopilot.noise,
        error=error,
        exit_code=exit_code,
        score=found,
        answer=answer if isinstance(answer, dict) else None,
        timing=timing if isinstance(timing, dict) else {},
        flight_folder=str(folders[-1].relative_to(report)) if folders else "",
    )


def _json(path: Path) -> dict[str, object]:
    """A file of the flight; nothing when it is not there."""
    content = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return content if isinstance(content, dict) else {}


def _first_sighting(path: Path) -> tuple[GeodeticOrigin, float, Vector]:
    """Origin of a sightings file, and time and camera position of its first sighting."""
    with path.open(encoding="utf-8") as lines:
        header, first = json.loads(next(lines)), json.loads(next(lines))
    return GeodeticOrigin(**header["origin"]), float(first["t_s"]), np.array(first["position_enu_m"])


def _draw(folder: Path, truth: Matrix) -> None:
    """Have the flight's plan view drawn again, with the truth in it."""
    path = folder / "truth.csv"
    np.savetxt(path, truth, delimiter=",", header="t_s,east_m,north_m,up_m", comments="", fmt="%.4f")
    subprocess.run([sys.executable, "-m", "gcs_plugin", "draw", str(folder), "--truth", str(path)], check=True)


def camera_of(scenario: Scenario) -> Camera:
    """The camera as a good calibration would describe it; its latency is left for the flight to find out."""
    settings = scenario.camera
    mounting = Mounting.tilted(math.radians(settings.tilt_down_deg), settings.position_body_m)
    return Camera(
        settings.intrinsics,
        mounting,
        calibrated=True,
        readout_s=settings.readout_ms / 1000.0,
        provenance=f"as the scenario {scenario.name} says",
    )


def _config(scenario: Scenario) -> AutopilotConfig:
    autopilot = scenario.autopilot
    towards = math.radians(autopilot.wind_from_deg + 180.0)
    mean = (autopilot.wind_m_s * math.sin(towards), autopilot.wind_m_s * math.cos(towards), 0.0)
    return AutopilotConfig(
        flavour=autopilot.flavour,
        noise=autopilot.noise,
        seed=scenario.seed,
        home=scenario.home.origin,
        heading_rad=math.radians(scenario.vehicle.heading_deg),
        wind=Wind(mean, autopilot.gust_m_s),
        operator_port=None,
    )


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
