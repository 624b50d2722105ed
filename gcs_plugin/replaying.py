"""`sidestep replay`: a recorded flight of our own through the procedure that flew it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from mission.camera import read_camera
from mission.detect import make_detector
from mission.errors import SidestepError
from mission.estimate.answer_line import error_line, estimate_line
from mission.estimate.sightings_file import flight_lines
from mission.observation.replay import ReplayedDrone, ReplayedVideo
from mission.observation.tape import FOLDER, VIDEO, Tape, read_tape
from mission.procedure.locate import LOCAL_ORIGIN, Locate
from mission.procedure.result import LocateResult, Stage, TargetChoice
from mission.records import Box, FlightSightings, Frame
from mission.settings import MissionSettings
from mission.track import Track, Tracker


@dataclass(slots=True, eq=False)
class Replay:
    """What came of a replayed flight; a `Watcher`."""

    told: Callable[[str], None]
    flights: list[FlightSightings] = field(default_factory=list)
    answers: list[LocateResult] = field(default_factory=list)
    error: SidestepError | None = None

    def stage(self, stage: Stage, text: str) -> None:
        """See `Watcher`."""
        self.told(f"{stage.value}: {text}")

    def frame(self, frame: Frame, track: Track | None) -> None:
        """See `Watcher`."""

    def sightings(self, flight: FlightSightings) -> None:
        """See `Watcher`."""
        self.flights.append(flight)

    def located(self, located: LocateResult) -> None:
        """See `Watcher`."""
        self.answers.append(located)

    def keep(self, located: LocateResult) -> None:
        """See `Watcher`."""

    def sightings_text(self) -> str:
        """As in the flight's sightings.jsonl."""
        return "".join(f"{line}\n" for flight in self.flights for line in flight_lines(flight))

    def answer_lines(self) -> list[str]:
        """One line of JSON for each sidestep, as `sidestep estimate` prints them."""
        lines = [
            estimate_line(one.estimate, one.flight.origin if one.geodetic else LOCAL_ORIGIN) for one in self.answers
        ]
        return lines if self.error is None else [*lines, error_line(None, str(self.error))]


def replay(folder: Path, settings: MissionSettings | None, told: Callable[[str], None]) -> Replay:
    """Run the procedure on a recorded flight.

    Args:
        folder: of the flight.
        settings: in place of the flight's own.
        told: of each stage.

    Raises:
        InputError: it was not recorded, or the recording is damaged.
        VideoError: the recording holds no pictures of the flight.
    """
    recording = folder / FOLDER
    tape = read_tape(recording)
    used = settings or own_settings(tape)
    camera = read_camera(recording / "camera.toml")
    video = ReplayedVideo(recording / VIDEO, tape, (camera.intrinsics.width_px, camera.intrinsics.height_px))
    drone = ReplayedDrone(tape, video)
    found = Replay(told)
    procedure = Locate(
        drone,
        video,
        camera,
        make_detector(used.detect.detector),
        Tracker(),
        used,
        found,
        lambda: False,
        video.clock,
    )
    try:
        procedure.run(_choice(tape), tape.flight_id)
    except SidestepError as error:
        found.error = error
    return found


def own_settings(tape: Tape) -> MissionSettings:
    """The settings of the flight, as far as they decide its answer."""
    return MissionSettings.model_validate(tape.settings)


def _choice(tape: Tape) -> TargetChoice:
    box, point = tape.choice["box"], tape.choice["point"]
    return TargetChoice(None if box is None else Box(*box), None if point is None else (point[0], point[1]))


def same_as_flown(folder: Path, found: Replay) -> bool:
    """Whether the replay gave the very sightings that the flight kept."""
    try:
        kept = (folder / "sightings.jsonl").read_text(encoding="utf-8")
    except OSError:
        kept = ""
    return [json.loads(line) for line in kept.splitlines()] == [
        json.loads(line) for line in found.sightings_text().splitlines()
    ]
