"""A flight that was taped is run again through the procedure, and says the same, bit for bit."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from mission.clock import ClockMap
from mission.errors import InputError, SidestepError, VideoError
from mission.estimate.sightings_file import flight_lines
from mission.observation.file_video import FileVideo
from mission.observation.recording import RecordedDrone, RecordedVideo
from mission.observation.replay import ReplayedDrone, ReplayedVideo
from mission.observation.tape import Tape, read_tape, write_tape
from mission.pose.buffer import Pose, PoseAt, PoseBuffer
from mission.pose.history import PoseHistory
from mission.procedure.locate import Locate
from mission.procedure.result import LocateResult, TargetChoice
from mission.records import Frame, Image, NoiseModel
from mission.settings import MissionSettings
from mission.vehicle.drone import Drone
from sitl.recorded.video_file import write_video
from tests.mission.procedure.test_locate import Notes
from tests.support.fakes import CAMERA, FakeDrone, FakeVideo, Sight, Walker

FRAMES = 500
SETTINGS = MissionSettings.model_validate({"video": {"check_offset": False}})


def numbered() -> Iterator[Image]:
    for k in range(FRAMES):
        picture = np.zeros((480, 640, 3), np.uint8)
        picture[:, : k + 1] = (k % 250, 120, 60)
        yield picture


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "video.ts"
    assert write_video(path, numbered(), 20.0, 400_000) == FRAMES
    return path


class TapedDrone(FakeDrone):
    """Tells all its poses as a real aircraft does."""

    def poses(self) -> PoseAt:
        buffer = PoseBuffer(keep_s=1000.0, max_messages=100000)
        for pose in self._poses:
            buffer.add_position(pose.t_s, pose.position_enu_m, pose.velocity_enu_m_s)
            buffer.add_attitude(pose.t_s, pose.world_from_body_wxyz)
        last = self._poses[-1]
        clock = ClockMap.on_line((0.0, 0.0, 0.0))
        return PoseHistory(buffer, clock, last.position_covariance_m2, last.attitude_covariance_rad2).at

    def noise(self) -> NoiseModel:
        return NoiseModel(heading_sigma_rad=0.0123)


class Film(FakeVideo):
    """The pictures of the film, some of them passed over as a busy machine does."""

    pictures: Iterator[Frame]

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        frame = super().latest(after_index, timeout_s)
        if frame is None:
            return None
        if frame.index % 7 == 0:
            next(self.pictures)
            self.index += 1
        image = next(self.pictures).image
        return Frame(image, frame.t_s, self.index)


@dataclass
class ThenAndThere:
    """Where the aircraft was at the time of the replay."""

    drone: FakeDrone
    video: ReplayedVideo

    @property
    def t_s(self) -> float:
        return self.video._tape.given[self.video.number - 1].t_s

    def pose_at(self, t_s: float) -> Pose | None:
        return self.drone.pose_at(t_s)


def located(procedure: Locate, notes: Notes) -> LocateResult | SidestepError:
    try:
        return procedure.run(TargetChoice(), "flight")
    except SidestepError as error:
        return error


def hurried(drone: FakeDrone) -> Callable[[], float]:
    """A clock that goes on while the procedure works: a hundredth of a second from one reading to the next."""
    reads = 0

    def clock() -> float:
        nonlocal reads
        reads += 1
        return drone.t_s + 0.01 * (reads % 5)

    return clock


def flown(film: Path, folder: Path, first_index: int = 0, seized: bool = False) -> tuple[Notes, Walker, FakeDrone]:
    drone = TapedDrone()
    walker = Walker(np.array([1.0, 6.0, 0.9]), np.array([0.4, 0.1, 0.0]))
    video = Film(drone)
    video.pictures = (picture.frame() for picture in FileVideo(film).pictures())
    tape = Tape("flight", SETTINGS.model_dump(mode="json"), "", {"box": None, "point": None}, "test")
    tape.begun_clock_s, tape.video_first_index = drone.t_s, first_index + 1
    sight, notes = Sight(drone, walker), Notes()

    def aborted() -> bool:
        if seized and len(notes.stages) and drone.t_s > 104.0 and not drone._events:
            drone.seize()
        return False

    recorded = cast(Drone, RecordedDrone(cast(Drone, drone), tape))
    video_tape = RecordedVideo(video, tape, hurried(drone))
    located(Locate(recorded, video_tape, CAMERA, sight, sight, SETTINGS, notes, aborted, video_tape.clock), notes)
    write_tape(folder, tape)
    return notes, walker, drone


def again(film: Path, folder: Path, walker: Walker, drone: FakeDrone, settings: MissionSettings = SETTINGS) -> Notes:
    tape = read_tape(folder)
    video = ReplayedVideo(film, tape, (640, 480))
    sight = Sight(cast(FakeDrone, ThenAndThere(drone, video)), walker)
    notes = Notes()
    replayed = cast(Drone, ReplayedDrone(tape, video))
    located(Locate(replayed, video, CAMERA, sight, sight, settings, notes, lambda: False, video.clock), notes)
    return notes


def lines(notes: Notes) -> list[str]:
    return [line for flight in notes.flights for line in flight_lines(flight)]


@pytest.fixture(scope="module")
def flight(film: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Notes, Walker, FakeDrone]:
    folder = tmp_path_factory.mktemp("flight")
    return folder, *flown(film, folder)


Flown = tuple[Path, Notes, Walker, FakeDrone]


def test_same_sightings_and_answer(film: Path, flight: Flown) -> None:
    folder, notes, walker, drone = flight
    assert len(notes.answers) == 1
    replayed = again(film, folder, walker, drone)
    assert lines(replayed) == lines(notes)
    assert len(lines(notes)) > 50
    (one,), (other,) = notes.answers, replayed.answers
    assert one.estimate.position_enu_m.tolist() == other.estimate.position_enu_m.tolist()
    assert one.estimate.covariance is not None
    assert other.estimate.covariance is not None
    assert one.estimate.covariance.tolist() == other.estimate.covariance.tolist()
    assert one.flight.noise == other.flight.noise


def test_pictures_that_a_decoder_held_back_are_found(film: Path, flight: Flown, tmp_path: Path) -> None:
    folder, notes, walker, drone = flight
    shutil.copytree(folder, tmp_path / "shifted")
    tape = json.loads((folder / "tape.json").read_text())
    tape["video_first_index"] += 3
    (tmp_path / "shifted" / "tape.json").write_text(json.dumps(tape))
    assert lines(again(film, tmp_path / "shifted", walker, drone)) == lines(notes)


def test_a_flight_that_the_pilot_ended(film: Path, tmp_path: Path) -> None:
    notes, walker, drone = flown(film, tmp_path, seized=True)
    assert not notes.answers
    replayed = again(film, tmp_path, walker, drone)
    assert not replayed.answers
    assert lines(replayed) == lines(notes)


def test_other_settings_say_otherwise(film: Path, flight: Flown) -> None:
    folder, notes, walker, drone = flight
    known = {"video": {"check_offset": False}, "prior": {"height_m": 1.75, "height_sigma_m": 0.02}}
    replayed = again(film, folder, walker, drone, MissionSettings.model_validate(known))
    (one,), (other,) = notes.answers, replayed.answers
    assert one.estimate.covariance is not None
    assert other.estimate.covariance is not None
    assert np.trace(other.estimate.covariance[:2, :2]) < np.trace(one.estimate.covariance[:2, :2])


def test_another_video_is_refused(flight: Flown, tmp_path: Path) -> None:
    other = tmp_path / "other.ts"
    write_video(other, (np.full((480, 640, 3), 90, np.uint8) for _ in range(60)), 20.0)
    video = ReplayedVideo(other, read_tape(flight[0]), (640, 480))
    with pytest.raises(VideoError, match="not those of the flight"):
        video.latest(-1, 0.0)


def test_no_tape_and_damaged_ones(flight: Flown, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_tape(tmp_path)
    shutil.copytree(flight[0], tmp_path / "spoilt")
    path = tmp_path / "spoilt" / "tape.json"
    whole = path.read_text()
    for spoilt in ("", "{}", whole[:-100], whole.replace('"given"', '"taken"'), whole.replace("[", "3", 1)):
        path.write_text(spoilt)
        with pytest.raises(InputError, match="damaged"):
            read_tape(tmp_path / "spoilt")
