"""The programme's rows through camera and detector: `sidestep locate` flown in the simulator, each row several times.

A row becomes a scenario (`row_scenario`), is flown as `sidestep sitl` flies it, and the sightings that the flight wrote
go to every method, beside the truth that the simulator knows. The person begins to walk when the drone begins to fly
sideways, so that the row's depth is the depth at which the pattern starts. Everything that may matter and is not in the
row (heading, side, clothes, stature, light, wind) is drawn from the flight's own seed.
"""

from __future__ import annotations

import json
import math
import shutil
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mission.errors import AnswerError, SightingsFormatError
from mission.estimate.sightings_file import FlightProblem, read_flights
from mission.records import FlightSightings, Matrix
from sitl.evaluation.accuracy.flights import SimulatedFlight
from sitl.evaluation.accuracy.programme import BOUND, MethodOutcome, available_methods, outcome
from sitl.evaluation.accuracy.rows import PatternName, Row
from sitl.scenario.schema import Scenario
from sitl.simulation.run import Result, fly

_PATTERN_KINDS = {"out-and-back": "out-and-back", "S": "s", "paper": "paper"}
_FAR_M = 11.0
"""Beyond this the drone flies higher and looks down less, to have the ground's edge out of the way."""


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """What is flown, apart from the row."""

    pattern: PatternName = "out-and-back"
    noise: str = "good"
    """The autopilot's preset."""
    seed: int = 1


@dataclass(frozen=True, slots=True)
class FlownRow:
    """One flight of one row, judged."""

    row: Row
    number: int
    """Which of the row's flights."""
    setting: ClosedLoop
    depth_m: float | None
    """True depth at the first sighting; None where the flight gave no sightings."""
    error: str
    """Why there is no answer; empty when there is one."""
    outcomes: tuple[MethodOutcome, ...]


def row_scenario(row: Row, number: int, setting: ClosedLoop) -> Scenario:
    """The scenario of one flight of a row.

    Args:
        row: how far away the person is and how they walk.
        number: which of the row's flights; another number is another person, heading, wind and noise.
        setting: what is the same for all.
    """
    motion = math.degrees(math.atan2(row.velocity_m_s[0], row.velocity_m_s[1])) % 360.0
    speed = math.hypot(*row.velocity_m_s)
    # The same draws for each row would make the rows' errors alike, so a row's own figures are part of the seed.
    entropy = (setting.seed, number, round(100.0 * row.depth_m), round(motion), round(100.0 * speed))
    rng = np.random.default_rng(entropy)
    heading = float(rng.uniform(0.0, 360.0))
    aside = float(rng.choice((-1.0, 1.0)) * rng.uniform(3.0, 9.0))
    far = row.depth_m > _FAR_M
    person: dict[str, object] = {
        "distance_m": row.depth_m,
        "bearing_deg": (heading + aside) % 360.0,
        "height_m": float(rng.uniform(1.6, 1.9)),
    }
    if speed > 0.0:
        person |= {"speed_m_s": speed, "walk_from_line_of_sight_deg": motion, "when": "drone-moves"}
    return Scenario.model_validate(
        {
            "name": flight_name(row, number),
            "seed": int(rng.integers(2**31)),
            "autopilot": {
                "noise": setting.noise,
                "wind_m_s": float(rng.uniform(0.0, 2.0)),
                "wind_from_deg": float(rng.uniform(0.0, 360.0)),
                "gust_m_s": 0.2,
            },
            "vehicle": {"heading_deg": heading, "take_off_height_m": 2.5 if far else 1.6},
            "camera": {
                "fx": 516.5,
                "fy": 516.5,
                "cx": 322.0,
                "cy": 238.5,
                "distortion": {"k1": -0.06, "k2": 0.012, "p1": 0.0004, "p2": -0.0003},
                "tilt_down_deg": 5.0 if far else 14.0,
                "position_body_m": (0.10, 0.0, 0.03),
                "exposure_ms": 8.0,
                "readout_ms": 16.0,
                "extra_latency_ms": 80.0,
            },
            "light": {"sun_azimuth_deg": float(rng.uniform(0.0, 360.0)), "brightness": float(rng.uniform(0.8, 1.2))},
            "people": (person,),
        }
    )


def flight_name(row: Row, number: int) -> str:
    """The flight's name, which is also that of its folder."""
    motion = "".join(letter for letter in row.motion.replace(" ", "-") if letter.isalnum() or letter == "-")
    return f"{motion}-{row.depth_m:.2f}".replace(".", "-") + f"-{number}"


def fly_row(
    row: Row,
    number: int,
    setting: ClosedLoop,
    report: Path,
    *,
    methods: Sequence[str] = (),
    tell: Callable[[str], None] | None = None,
) -> FlownRow:
    """Fly one flight of a row and judge every method on its sightings.

    Args:
        row: the case.
        number: which of the row's flights.
        setting: what is the same for all.
        report: the flight gets a folder in it; what an interrupted flight left there is removed.
        methods: names out of `METHODS`, all that are available when empty.
        tell: gets each line that `sidestep locate` prints.

    Raises:
        SidestepError: the simulator did not start.
    """
    folder = report / flight_name(row, number)
    if folder.exists():
        shutil.rmtree(folder)
    kind = json.dumps(_PATTERN_KINDS[setting.pattern])
    result = fly(row_scenario(row, number, setting), folder, extra_settings=f"\n[pattern]\nkind = {kind}\n", tell=tell)
    return judged(row, number, setting, result, folder, methods)


def judged(
    row: Row, number: int, setting: ClosedLoop, result: Result, folder: Path, methods: Sequence[str] = ()
) -> FlownRow:
    """A flown flight's sightings through every method, beside the truth.

    Args:
        row: the case.
        number: which of the row's flights.
        setting: what is the same for all.
        result: of the flight.
        folder: the flight's report.
        methods: names out of `METHODS`, all that are available when empty.
    """
    names = (*(methods or available_methods()), BOUND)
    unanswered = tuple(MethodOutcome(name, None, None) for name in names)
    if result.score is None:
        return FlownRow(row, number, setting, None, result.error, unanswered)
    try:
        sim = flown(folder / result.flight_folder)
    except (AnswerError, SightingsFormatError) as error:
        return FlownRow(row, number, setting, None, str(error), unanswered)
    return FlownRow(row, number, setting, sim.depth_m, "", tuple(outcome(name, sim) for name in names))


def flown(folder: Path) -> SimulatedFlight:
    """A flight that was flown, as the comparison wants it.

    The truth is in the frame of the answer (moved so that the first reported camera place is the true one), and the
    reported path stands for the true one: the bound does not feel the difference.

    Args:
        folder: of the flight, with `sightings.jsonl` and the simulator's `truth.csv`.

    Raises:
        AnswerError: one of them is not there or cannot be used.
    """
    flight = _last_flight(folder / "sightings.jsonl")
    truth = _truth(folder / "truth.csv")
    t_s = np.array([s.t_s for s in flight.sightings])
    target = np.column_stack([np.interp(t_s, truth[:, 0], truth[:, axis]) for axis in (1, 2, 3)])
    velocity = (truth[-1, 1:] - truth[0, 1:]) / (truth[-1, 0] - truth[0, 0])
    camera = np.array([s.position_enu_m for s in flight.sightings])
    return SimulatedFlight(
        flight, target, np.tile(velocity, (len(t_s), 1)), camera, wrong=np.zeros(len(t_s), dtype=bool)
    )


def _last_flight(path: Path) -> FlightSightings:
    flights = list(read_flights(path))
    last = flights[-1]
    if isinstance(last, FlightProblem) or len(last.sightings) < 2:
        raise AnswerError(f"{path} holds no flight to compare with")
    return last


def _truth(path: Path) -> Matrix:
    """Rows of time, east, north, up; (n, 4)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that there are no lines is told below
            truth = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except (OSError, ValueError) as error:
        raise AnswerError(f"{path} cannot be read: {error}") from error
    if len(truth) < 2 or truth.shape[1] != 4 or not truth[-1, 0] > truth[0, 0]:
        raise AnswerError(f"{path} holds no truth")
    return np.asarray(truth, dtype=np.float64)
