"""The paper's twelve rows on its own aircraft: the simulated AR.Drone 2.0, closed loop, without GPS.

Each row is flown twice by `sidestep locate`. First with the paper's pattern: the sightings of its images 0, 1 (half a
second later) and n (the last that shows the person) go to the formula of the row's class, as in Kim & Yow 2015, Tables
III to V: equation (5) for a walk parallel to the flight, equation (2) for who stands or walks along the line of sight.
Then with the default pattern and the batch estimate, which is told no class. The camera's place is what the aircraft
reckons from its own velocity, so its drift is in all figures; the batch is also asked with the true poses.

On the perpendicular rows the formula gives the depth at the last image (the person walks along the line of sight), so
its result is held against the truth of that instant, as the paper does; all others against that of the first image.

The paper's people walk evenly in all its images. So here somebody tells them to go when `sidestep locate` says that the
target is centred, about a second before the pattern begins.
"""

from __future__ import annotations

import json
import math
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import sitl
from mission.errors import EstimateRefused
from mission.estimate import ESTIMATORS
from mission.estimate.sightings_file import FlightProblem, read_flights
from mission.records import FlightSightings, Vector
from sitl.aircraft.truth import TruthRing
from sitl.camera.process import WALK_MARK
from sitl.evaluation.ardrone.truth import drift_m, true_camera, with_true_poses
from sitl.people.world import World
from sitl.scenario.schema import Scenario, read_scenario
from sitl.simulation.processes import Simulation, simulation
from sitl.simulation.run import locate, scored

INTERVAL_S = 0.5
"""Between the paper's images."""
IMAGES = 11

_SCENARIOS = Path(sitl.__file__).parent / "scenarios" / "ardrone"
_CENTRED = ("behind telemetry", "latency is used as it is", "not quite centred")
"""What `sidestep locate` says last before a pattern."""
_PAPER_SETTINGS = '\n[pattern]\nkind = "paper"\n'


@dataclass(frozen=True, slots=True)
class ArdroneRow:
    """A row of the paper's tables."""

    motion: str
    depth_m: float
    """Where the person is when the flight begins."""
    paper_depth_m: float
    """The depth that the paper's table names; of the perpendicular rows it is the one at the last image."""
    paper_depth_percent: float
    paper_position_percent: float

    @property
    def scenario(self) -> Path:
        """The file that flies it."""
        return _SCENARIOS / (f"{self.motion}-{self.depth_m:.2f}".replace(".", "-") + ".toml")


ARDRONE_ROWS = (
    ArdroneRow("stationary", 2.75, 2.75, 14.5, 16.5),
    ArdroneRow("stationary", 5.5, 5.5, 9.3, 18.0),
    ArdroneRow("stationary", 7.25, 7.25, 3.6, 12.2),
    ArdroneRow("stationary", 9.0, 9.0, 0.4, 7.2),
    ArdroneRow("perpendicular", 2.75, 4.5, 9.3, 9.4),
    ArdroneRow("perpendicular", 5.5, 7.6, 12.0, 12.9),
    ArdroneRow("perpendicular", 7.25, 5.45, 2.2, 5.86),
    ArdroneRow("perpendicular", 9.0, 6.9, 2.2, 2.2),
    ArdroneRow("parallel", 2.75, 2.75, 24.7, 27.7),
    ArdroneRow("parallel", 5.5, 5.5, 12.3, 12.7),
    ArdroneRow("parallel", 7.25, 7.25, 14.2, 22.8),
    ArdroneRow("parallel", 9.0, 9.0, 9.1, 11.7),
)
"""Tables III, IV and V."""


@dataclass(frozen=True, slots=True)
class Found:
    """Errors of one method on one flight; percent of the true depth, equations (9) and (10)."""

    depth_m: float
    depth_truth_m: float
    depth_percent: float
    position_percent: float
    inside_95: bool | None = None
    """Whether the 95 % ellipse held the truth, for a method that has one."""
    drift_m: float | None = None
    """How far the reckoned way of the camera was from the true one between the first and the last sighting."""
    undrifted_percent: float | None = None
    """The depth error of the same pixels with the true poses instead of the reckoned ones."""


@dataclass(frozen=True, slots=True)
class FlownArdroneRow:
    """A row, flown both ways; a text instead of a figure says why there is none."""

    row: ArdroneRow
    three_image: Found | str
    batch: Found | str


def fly_ardrone_row(
    row: ArdroneRow,
    report: Path,
    *,
    seed: int | None = None,
    noise: str | None = None,
    tell: Callable[[str], None] | None = None,
) -> FlownArdroneRow:
    """Fly a row with both patterns.

    Args:
        row: the case.
        report: gets a folder for each flight; what was there is removed.
        seed: instead of the scenario's own.
        noise: of the aircraft's sensors (good or rough), instead of the scenario's own.
        tell: gets each line that `sidestep locate` prints.

    Raises:
        SidestepError: the simulator did not start.
    """
    scenario = _changed(read_scenario(row.scenario), seed, noise)
    folder = report / row.scenario.stem
    if folder.exists():
        shutil.rmtree(folder)

    def by_formula(running: Simulation, where: Path, ended: _Ended) -> Found | str:
        return judge_three_image(row, running, where, ended)

    three_image = _fly(scenario, folder / "paper", _PAPER_SETTINGS, by_formula, tell)
    return FlownArdroneRow(row, three_image, _fly(scenario, folder / "default", "", _batch, tell))


def paper_images(flight: FlightSightings) -> FlightSightings:
    """The sightings nearest to the paper's three images: 0, 1, and n, the last in which the person is still seen.

    Images are half a second apart from the first sighting on, eleven at most.

    Raises:
        EstimateRefused: the person was lost before there were three.
    """
    times = np.array([s.t_s for s in flight.sightings])
    last = min(IMAGES - 1, math.floor((times[-1] - times[0]) / INTERVAL_S + 0.5))
    chosen = {int(np.argmin(np.abs(times - times[0] - k * INTERVAL_S))) for k in (0, 1, last)}
    if len(chosen) < 3:
        raise EstimateRefused("the person was lost before the third image")
    return replace(flight, sightings=tuple(flight.sightings[i] for i in sorted(chosen)))


_Ended = tuple[int, list[str]]
"""Exit code of `sidestep locate` and the lines that it printed."""
_Judge = Callable[[Simulation, Path, _Ended], Found | str]


def _fly(
    scenario: Scenario, folder: Path, settings: str, judge: _Judge, tell: Callable[[str], None] | None
) -> Found | str:
    with simulation(scenario, folder, extra_settings=settings) as running:
        options = ["--take-off", f"{scenario.vehicle.take_off_height_m}"]
        return judge(running, folder, locate(running, options, starter(running.ring, tell)))


def starter(ring: TruthRing, tell: Callable[[str], None] | None) -> Callable[[str], None]:
    """Who listens to what `sidestep locate` says, and tells the people to go once the target is centred.

    Args:
        ring: of the simulation; its first mark lets them walk.
        tell: gets each line as well.
    """

    def hear(line: str) -> None:
        if ring.mark(WALK_MARK) is None and any(words in line for words in _CENTRED):
            ring.set_mark(WALK_MARK, time.monotonic())
        if tell is not None:
            tell(line)

    return hear


def _batch(running: Simulation, folder: Path, ended: _Ended) -> Found | str:
    result = scored(running, folder, *ended)
    if result.score is None:
        return result.error
    found = result.score
    flight = _sightings(folder)
    return Found(
        found.depth_m,
        found.depth_truth_m,
        found.depth_error_pct,
        found.position_error_pct,
        found.inside_95,
        None if flight is None else drift_m(running, flight),
        None if flight is None else _undrifted_percent(running, flight),
    )


def _undrifted_percent(running: Simulation, flight: FlightSightings) -> float | None:
    """Depth error of the batch estimate at the first sighting, had the poses been true; None where it has no answer."""
    try:
        estimate = ESTIMATORS["batch"].estimate(with_true_poses(running, flight))
    except EstimateRefused:
        return None
    first_s = flight.sightings[0].t_s
    depth = _true_depth_m(running, first_s, first_s)
    return 100.0 * abs(estimate.depth_m - depth) / depth


def judge_three_image(row: ArdroneRow, running: Simulation, folder: Path, ended: _Ended) -> Found | str:
    """What the three-image formula makes of the newest flight of a folder, beside the truth; or why it makes nothing.

    Args:
        row: the case that the formula is told.
        running: the simulation that was flown.
        folder: its report.
        ended: exit code of `sidestep locate` and the lines that it printed.
    """
    flight = _sightings(folder)
    if flight is None:
        return scored(running, folder, *ended).error
    try:
        images = paper_images(flight)
        estimate = ESTIMATORS["three-image" if row.motion == "parallel" else "stereo"].estimate(images)
    except EstimateRefused as refused:
        return str(refused)
    if estimate.first is None:
        return "the formula gave no position"
    first, last = images.sightings[0], images.sightings[-1]
    held_s = (last if row.motion == "perpendicular" else first).t_s
    target = _true_target(running, held_s) - true_camera(running, first.t_s)
    depth = float(np.linalg.norm(target[:2]))
    miss = (np.asarray(estimate.first.position_enu_m) - np.array(first.position_enu_m)) - target
    return Found(
        estimate.depth_m,
        depth,
        100.0 * abs(estimate.depth_m - depth) / depth,
        100.0 * float(np.linalg.norm(miss[:2])) / depth,
        drift_m=drift_m(running, images),
    )


def _sightings(folder: Path) -> FlightSightings | None:
    """The newest flight's last pass; None when none was logged."""
    for path in sorted(folder.glob("flights/*/sightings.jsonl"), reverse=True):
        for flight in reversed(list(read_flights(path))):
            if not isinstance(flight, FlightProblem) and len(flight.sightings) >= 3:
                return flight
    return None


def _true_target(running: Simulation, t_s: float) -> Vector:
    return World(running.scenario).person_centroid(0, t_s, running.ring.mark(0), running.ring.mark(1))


def _true_depth_m(running: Simulation, held_s: float, first_s: float) -> float:
    """Horizontal distance of the target at one time from where the camera was at another."""
    return float(np.linalg.norm((_true_target(running, held_s) - true_camera(running, first_s))[:2]))


def _changed(scenario: Scenario, seed: int | None, noise: str | None) -> Scenario:
    content = json.loads(scenario.model_dump_json())
    if seed is not None:
        content["seed"] = seed
    if noise is not None:
        content["autopilot"]["noise"] = noise
    return Scenario.model_validate(content)


def chosen_rows(names: Sequence[str]) -> tuple[ArdroneRow, ...]:
    """Rows by ``MOTION:METRES``; all of them when no name is given.

    Raises:
        KeyError: a name is of no row.
    """
    known = {f"{row.motion}:{row.depth_m:g}": row for row in ARDRONE_ROWS}
    return tuple(known[name] for name in names) if names else ARDRONE_ROWS
