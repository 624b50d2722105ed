"""`sidestep calibrate baseline` on the simulated AR.Drone: the table that it writes beside what was truly flown.

    python -m sitl.evaluation.ardrone.wall REPORT_FOLDER

takes off in front of the simulated wall, runs the command as an operator would, and compares. The wall is seen by the
camera, so neither the aircraft's drift nor the scale of its velocity is in the table; the command's other figure, the
scale, is held against the ratio of true and reckoned travel that it should be.
"""

from __future__ import annotations

import math
import subprocess
import sys
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import typer

import sitl
from mission.calibration.baseline import INTERVAL_S
from mission.errors import AnswerError, FlightEnded
from mission.records import Matrix, Vector
from mission.vehicle.drone import Bounds, OrderState
from mission.vehicle.make import make_drone
from sitl.scenario.schema import read_scenario
from sitl.simulation.processes import Simulation, simulation

SCENARIO = Path(sitl.__file__).parent / "scenarios" / "ardrone-wall" / "wall.toml"
RUNS = 3
_TAKE_OFF_S = 30.0
_COMMAND_S = 240.0
_APART_S = 8.0
"""Two runs begin at least this far apart: each lasts 6.5 s, and then it flies back."""
_STEP_S = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class WallTable:
    """Travel since image 0, (images,) m."""

    written_m: Vector
    """By the command, mean of its runs."""
    true_m: Vector
    """Mean of what was truly flown."""
    runs: int
    """How many runs were recognised in the truth."""

    @property
    def worst_m(self) -> float:
        """Largest difference."""
        return float(np.abs(self.written_m - self.true_m).max())


def fly_wall(report: Path, runs: int = RUNS) -> tuple[WallTable, str]:
    """Fly the calibration.

    Args:
        report: a folder; gets the settings and the camera file.
        runs: along the wall.

    Returns:
        The comparison, and what the command printed.

    Raises:
        SidestepError: the simulator does not start, or the command fails.
    """
    with simulation(read_scenario(SCENARIO), report) as running:
        url = str(tomllib.loads(running.settings.read_text("utf-8"))["link"]["url"])
        _take_off(url, running.scenario.vehicle.take_off_height_m)
        written = report / "baseline.toml"
        said = _calibrate(running, url, report / "camera.toml", written, runs)
        table = np.cumsum(tomllib.loads(written.read_text("utf-8"))["pattern"]["baseline_m"])
        return compare(table, *_lateral(running), runs), said


def compare(written_m: Vector, times_s: Vector, along_m: Vector, runs: int) -> WallTable:
    """Find the runs in the truth, and average them.

    When a run began is not written down: it is where the truth fits the table best.

    Args:
        written_m: (images,) travel.
        times_s: (n,) evenly spaced.
        along_m: (n,) true place along the wall, in the direction of the runs.
        runs: how many to look for.

    Raises:
        AnswerError: nothing in the truth looks like the table.
    """
    after_s = INTERVAL_S * np.arange(len(written_m))
    starts = times_s[times_s <= times_s[-1] - after_s[-1]]
    travels: Matrix = np.interp(starts[:, None] + after_s, times_s, along_m)
    travels = travels - travels[:, :1]
    misses: Vector = np.sqrt(np.mean((travels - written_m) ** 2, axis=1))
    found: list[int] = []
    for index in np.argsort(misses):
        if misses[index] > 0.3 * written_m[-1] or len(found) == runs:
            break
        if all(abs(starts[index] - starts[other]) > _APART_S for other in found):
            found.append(int(index))
    if not found:
        raise AnswerError("no flight in the truth looks like the table", "Look at the report's files.")
    return WallTable(written_m, np.mean(travels[found], axis=0), len(found))


def _lateral(running: Simulation) -> tuple[Vector, Vector]:
    """Evenly spaced times and the lens' true place to the left of the wall's bearing."""
    history = running.ring.history()
    bearing = math.radians(running.scenario.vehicle.heading_deg)
    left = np.array([-math.cos(bearing), math.sin(bearing)])
    times = np.arange(history[0].t_s, history[-1].t_s, _STEP_S)
    along = np.array([truth.position_enu_m[:2] @ left for truth in history])
    return times, np.interp(times, [truth.t_s for truth in history], along)


def _take_off(url: str, height_m: float) -> None:
    """To where the command wants the aircraft: in the air, looking at the wall.

    Raises:
        FlightEnded: it does not get there.
    """
    drone = make_drone(url)
    try:
        drone.connect(_TAKE_OFF_S)
        drone.begin(Bounds(min_height_m=0.5))
        order = drone.take_off(height_m)
        deadline = time.monotonic() + _TAKE_OFF_S
        while order.state in (OrderState.PENDING, OrderState.FLYING):
            drone.telemetry()
            if time.monotonic() > deadline:
                raise FlightEnded("the take-off was not done in time", "Let nothing else run beside it.")
            time.sleep(0.02)  # paces the keep-alive; the order's own state ends the loop
        if order.state is not OrderState.DONE:
            raise FlightEnded(f"the take-off failed: {order.reason}")
    finally:
        drone.close()


def _calibrate(running: Simulation, url: str, camera: Path, output: Path, runs: int) -> str:
    wall = running.scenario.marker_wall
    if wall is None:
        raise AnswerError(f"{running.scenario.name} has no wall", "Give it a [marker_wall].")
    command = [sys.executable, "-m", "gcs_plugin", "calibrate", "baseline", "--drone", url, "--camera", str(camera)]
    command += ["--marker-mm", f"{1000.0 * wall.marker_m:g}", "--spacing-mm", f"{1000.0 * wall.spacing_m:g}"]
    command += ["--runs", str(runs), "--output", str(output)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_COMMAND_S, check=False)
    if done.returncode != 0 or not output.exists():
        raise AnswerError(f"calibrate baseline failed: {(done.stdout + done.stderr).strip()}", "See its message.")
    return done.stdout


def main(report: Path) -> None:
    """Fly, and print both tables."""
    table, said = fly_wall(report)
    typer.echo(said)
    typer.echo(f"image   written   truth (m), mean of {table.runs} runs")
    for image, (written, true) in enumerate(zip(table.written_m, table.true_m, strict=True)):
        typer.echo(f"{image:5d} {written:9.3f} {true:7.3f}")
    typer.echo(f"largest difference {table.worst_m:.3f} m")


if __name__ == "__main__":
    typer.run(main)
