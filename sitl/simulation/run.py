"""Fly a scenario and score it: autopilot and camera in processes of their own, `sidestep locate` as any user runs it.

The only ties to the program under test are its command line, its settings file, MAVLink, the video stream, and the
folder that it writes.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from mission.records import GeodeticOrigin, Matrix, Vector
from sitl.scenario.schema import Scenario
from sitl.simulation.external import ExternalAutopilot
from sitl.simulation.processes import Simulation, simulation
from sitl.simulation.score import Score, earth_error_m, score, truth_track

FLIGHT_TIMEOUT_S = 150.0


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
    as_reported: Score | None = None
    """Of what the answer would have been with the poses as the autopilot reported them, where the background's were
    used and the others would have given one."""


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
    with simulation(scenario, report, extra_settings=extra_settings, external=external) as running:
        exit_code, said = locate(running, ["--take-off", f"{scenario.vehicle.take_off_height_m}"], tell)
        if isinstance(running.autopilot, ExternalAutopilot):
            running.autopilot.check_alive()
        result = scored(running, report, exit_code, said)
    text = json.dumps(asdict(result), indent=2)
    (report / "result.json").write_text(text + "\n", encoding="utf-8")
    return result


def locate(
    running: Simulation, options: Sequence[str] = (), tell: Callable[[str], None] | None = None
) -> tuple[int, list[str]]:
    """Run `sidestep locate` on a simulation, stopped by Ctrl-C when it takes too long.

    Args:
        running: the simulation.
        options: of the command, beside its settings.
        tell: when given, gets each line as it is printed.

    Returns:
        The command's exit code and the lines that it printed.
    """
    command = [sys.executable, "-m", "gcs_plugin", "locate", "--settings", str(running.settings), *options]
    said: list[str] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        stop = threading.Timer(FLIGHT_TIMEOUT_S, process.send_signal, (signal.SIGINT,))
        stop.start()
        try:
            for line in process.stdout or ():
                said.append(line.rstrip())
                if tell is not None:
                    tell(line.rstrip())
        finally:
            stop.cancel()
        return process.wait(), said


def scored(running: Simulation, report: Path, exit_code: int, said: list[str]) -> Result:
    """The newest flight of a report folder beside the truth, with its plan view drawn again with the truth in it.

    Args:
        running: the simulation that was flown.
        report: the folder that holds its flights.
        exit_code: of `sidestep locate`.
        said: the lines that it printed.
    """
    scenario, ring = running.scenario, running.ring
    # A local answer, without a place on the earth, has no geotag and so no answer.json.
    told = [path for name in ("answer.json", "estimate.json") for path in (report / "flights").glob(f"*/{name}")]
    folders = sorted({path.parent for path in told})
    content = {**_json(folders[-1] / "answer.json"), **_json(folders[-1] / "estimate.json")} if folders else {}
    answer = content.get("estimate")
    timing = content.get("timing")
    found, as_reported = None, None
    error = str(content.get("error") or "")
    if isinstance(answer, dict):
        origin, first_s, first = _first_sighting(folders[-1] / "sightings.jsonl", str(answer["id"]))
        if scenario.vehicle.kind == "ardrone" and not scenario.ardrone.gps:
            origin = scenario.home.origin  # its frame is its own: it reckons from where it stood
        found = score(scenario, ring, answer, first, origin)
        if "ce90_m" in content:
            lat_deg, lon_deg, ce90_m = (float(str(content[name])) for name in ("lat_deg", "lon_deg", "ce90_m"))
            found = replace(found, earth_error_m=earth_error_m(scenario, found, lat_deg, lon_deg), ce90_m=ce90_m)
        without = _estimated_again(folders[-1] / "as-reported.jsonl")
        if without is not None:
            _, _, reported = _first_sighting(folders[-1] / "as-reported.jsonl", str(without["id"]))
            as_reported = score(scenario, ring, without, reported, origin)
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
        as_reported=as_reported,
    )


def _json(path: Path) -> dict[str, object]:
    """A file of the flight; nothing when it is not there."""
    content = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return content if isinstance(content, dict) else {}


def _first_sighting(path: Path, flight_id: str) -> tuple[GeodeticOrigin, float, Vector]:
    """Origin of one flight of a sightings file, and time and camera position of its first sighting."""
    with path.open(encoding="utf-8") as lines:
        records = map(json.loads, lines)
        header = next(record for record in records if record.get("id") == flight_id)
        first = next(records)
    return GeodeticOrigin(**header["origin"]), float(first["t_s"]), np.array(first["position_enu_m"])


def _estimated_again(path: Path) -> dict[str, object] | None:
    """The answer of `sidestep estimate` to a file with one flight; None where it gives none."""
    if not path.exists():
        return None
    command = [sys.executable, "-m", "gcs_plugin", "estimate", str(path)]
    said = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False).stdout
    answer = json.loads(said.splitlines()[0]) if said.strip() else {}
    return answer if "depth_m" in answer else None


def _draw(folder: Path, truth: Matrix) -> None:
    """Have the flight's plan view drawn again, with the truth in it."""
    path = folder / "truth.csv"
    np.savetxt(path, truth, delimiter=",", header="t_s,east_m,north_m,up_m", comments="", fmt="%.4f")
    subprocess.run([sys.executable, "-m", "gcs_plugin", "draw", str(folder), "--truth", str(path)], check=True)
