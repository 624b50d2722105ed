"""Orders carried out one after another on a flight without wires: whatever comes of one, the next is taken."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from io import StringIO
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink
from rich.console import Console

from gcs_plugin.authority import Authority
from gcs_plugin.component import CameraComponent, Identity
from gcs_plugin.component.commands import CANCELLED
from gcs_plugin.geotags.log import GeotagLog, read_geotags
from gcs_plugin.publish.publisher import Times
from gcs_plugin.serve.session import ServeContext, ServeSession
from mission.camera import Camera
from mission.errors import LinkError, VideoError
from mission.records import Frame
from mission.settings import AnswerSettings, AuthoritySettings, MissionSettings, VideoSettings
from mission.track import Track
from mission.video import VideoSource, VideoState, VideoStats
from tests.support.component_bench import PICTURE, Bench, Wire
from tests.support.fakes import CAMERA, FakeDrone, FakeVideo, Sight, Walker

USER_1, USER_2, USER_3, USER_4 = 31010, 31011, 31012, 31013
ACCEPTED, TEMPORARILY_REJECTED, FAILED, IN_PROGRESS = 0, 1, 4, 5
PATIENCE_S = 90.0


class Obeyed(Wire):
    """The autopilot takes what it is told."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[int] = []

    def command_int(self, command: int, params: Sequence[float], x: int, y: int, z: float, *, frame: int) -> int:
        self.told.append(command)
        return 0


Step = tuple[Callable[[], bool], Callable[[], object]]
"""What is waited for, and what is done then."""


@dataclass
class Ended:
    """The end of the program: when all steps are done."""

    steps: list[Step] = field(default_factory=list)
    in_flight: bool = False
    deadline: float = field(default_factory=lambda: time.monotonic() + PATIENCE_S)

    def asked(self) -> bool:
        if self.steps and self.steps[0][0]():
            self.steps.pop(0)[1]()
        return not self.steps or time.monotonic() > self.deadline


ADDRESS = "rtsp://pilot:s3cr3t@camera/live?token=s3cr3t"


class Service(Bench):
    """A session, with a station that gives orders at chosen times of the flight."""

    def __init__(self, folder: Path, walker: Walker | None = None, keep_open_s: float = 0.0) -> None:
        answer = AnswerSettings(folder=folder, roi="on-request", waypoint="never")
        settings = MissionSettings(
            answer=answer,
            video=VideoSettings(url=ADDRESS, check_offset=False, keep_open_s=keep_open_s),
            authority=AuthoritySettings(flights_per_minute=60.0),
        )
        super().__init__(settings)
        self.drone = FakeDrone()
        self.video = Video(self.drone, self)
        self.sight = Sight(self.drone, walker or Walker(np.array([0.5, 6.0, 0.9]), np.array([0.3, 0.0, 0.0])))
        self.wire = self.obeyed = Obeyed()
        clock = self.clock
        self.component = CameraComponent(
            self.wire,
            Identity(1),
            PICTURE,
            settings,
            Authority(settings.authority),
            lambda _: self.refusal,
            clock,
        )
        self.component.__enter__()
        self.log = folder / "geotags.gpkg"
        self.end = Ended()
        self.opened = 0
        self.said_before_opening = ""
        self.printed = StringIO()
        self.no_video: VideoError | None = None
        self.camera_begins = Event()
        self.camera_begins.set()
        self.crew = ServeContext(
            self.sight,
            GeotagLog(self.log),
            Console(file=self.printed, width=200),
            Times(clock, lambda: datetime(2026, 11, 22, tzinfo=UTC)),
            self.end,
            lambda: self.sight,
            self._open,
        )
        self.plans: list[tuple[float, Callable[[], object]]] = []

    def clock(self) -> float:
        return self.drone.t_s

    def at(self, seconds: float, act: Callable[[], object]) -> None:
        """Do something when the flight's time has come."""
        self.plans.append((self.drone.t_s + seconds, act))

    def later(self, seconds: float) -> None:
        """Let time go by in which nothing flies."""
        self.drone.t_s += seconds

    def final(self) -> list[tuple[int, int]]:
        """Acknowledgements so far, without progress."""
        acks = [(m.command, m.result) for m in self.wire.sent if m.get_type() == "COMMAND_ACK"]
        return [ack for ack in acks if ack[1] != IN_PROGRESS]

    def serve(self, satisfied: Callable[[], bool], *before: Step) -> None:
        """Until satisfied, after some steps before that."""
        self.end.steps = [*before, (satisfied, lambda: None)]
        ServeSession(self.crew, self.drone, self.wire, self.component).run()
        assert self.end.steps == []

    def then(self, result: tuple[int, int], *params: float, command: int = USER_1) -> Step:
        """When an order has ended so, give the next one."""
        return lambda: self.final()[-1:] == [result], lambda: self.command(command, *params)

    def _open(self, settings: MissionSettings, warn: Callable[[str], None]) -> tuple[VideoSource, Camera]:
        self.opened += 1
        self.said_before_opening = "".join(m.text for m in self.wire.sent if m.get_type() == "STATUSTEXT")
        assert self.camera_begins.wait(PATIENCE_S)
        if self.no_video is not None:
            raise self.no_video
        return self.video, CAMERA


class Video(FakeVideo):
    """Lets the plans come true as its time goes on."""

    def __init__(self, drone: FakeDrone, service: Service) -> None:
        super().__init__(drone)
        self._service = service
        self.closed = 0
        self.broken = False

    def stats(self) -> VideoStats:
        state = VideoState.RECONNECTING if self.broken else VideoState.PLAYING
        return replace(super().stats(), state=state)

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        frame = super().latest(after_index, timeout_s)
        due = [plan for plan in self._service.plans if plan[0] <= self.drone.t_s]
        for plan in due:
            self._service.plans.remove(plan)
            plan[1]()
        return frame

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def service(tmp_path: Path) -> Service:
    return Service(tmp_path)


def test_an_order_brings_an_answer_on_the_link_and_on_the_disk(service: Service) -> None:
    service.command(USER_1)
    service.serve(lambda: service.final() == [(USER_1, ACCEPTED)] and service.video.closed == 1)
    (answer,) = [m for m in service.wire.sent if m.get_type() == "CAMERA_TRACKING_GEO_STATUS"]
    (geotag,) = read_geotags(service.log)
    assert answer.lat == pytest.approx(geotag.place.lat_deg * 1e7, abs=2)
    beats = [m for m in service.wire.sent if m.get_type() == "HEARTBEAT"]
    assert len(beats) >= 6  # the flight's own loop sends them
    statuses = [m.tracking_status for m in service.wire.sent if m.get_type() == "CAMERA_TRACKING_IMAGE_STATUS"]
    assert statuses == [1] * (len(statuses) - 1) + [0]  # the box follows the target, and goes at the end


def test_an_abort_holds_and_the_next_order_is_taken(service: Service) -> None:
    service.command(USER_1)
    service.at(3.0, lambda: service.command(USER_2))
    service.serve(lambda: service.drone.calls.count("hover") == 2, service.then((USER_1, CANCELLED)))
    assert service.drone.calls[:4] == ["begin", "hover", "path", "hold"]


def test_the_pilot_takes_over_and_the_next_order_is_taken(service: Service) -> None:
    service.command(USER_1)
    service.at(3.0, lambda: service.drone.seize())
    calls: list[str] = []
    service.serve(
        lambda: service.drone.calls.count("hover") == 2,
        (lambda: service.final() == [(USER_1, FAILED)], lambda: calls.extend(service.drone.calls)),
        service.then((USER_1, FAILED)),
    )
    assert "hover" in calls
    assert "hold" not in calls
    assert "the pilot chose LOITER" in service.texts()


def test_a_flight_that_the_aircraft_refuses_is_a_temporary_rejection(service: Service) -> None:
    service.drone.refuse = "the height leaves the limits"
    service.command(USER_1)
    service.serve(lambda: service.final() == [(USER_1, TEMPORARILY_REJECTED)])
    assert "the height leaves the limits" in service.texts()


def test_nobody_in_view_is_told_with_what_helps_on_the_terminal(service: Service) -> None:
    service.sight.absent = True
    service.command(USER_1)
    service.serve(lambda: service.final() == [(USER_1, FAILED)])
    assert "no person found" in service.texts()


def test_no_video_is_told_and_nothing_flies(service: Service) -> None:
    service.no_video = VideoError("Nothing arrives at udp://:5600", "Start the camera.")
    service.command(USER_1)
    service.serve(lambda: service.final() == [(USER_1, FAILED)])
    assert "Nothing arrives" in service.texts()
    assert service.drone.calls == []


def test_a_fault_of_the_program_in_one_order_leaves_the_aircraft_holding_and_takes_the_next(service: Service) -> None:
    class Faulty(Sight):
        def update(self, *_: object, **__: object) -> Track:
            raise ZeroDivisionError

    faulty = Faulty(service.drone, service.sight.walker)
    service.crew = replace(service.crew, tracker=lambda: faulty)
    service.command(USER_1)
    service.serve(
        lambda: service.final() == [(USER_1, FAILED), (USER_1, FAILED)],
        service.then((USER_1, FAILED)),
    )
    assert service.drone.calls == ["begin", "hover", "hold"] * 2
    assert "internal error" in service.texts()


def test_the_next_candidate_is_tracked_without_flying_and_then_located(service: Service) -> None:
    service.command(USER_3)
    service.at(2.0, lambda: service.command(USER_1))
    service.serve(lambda: "ordered to locate the operator's box" in service.printed.getvalue())
    assert service.final()[0] == (USER_3, ACCEPTED)
    assert service.opened == 1  # the video that was open goes on


def test_tracking_alone_never_flies_and_ends_on_request(service: Service) -> None:
    service.command(USER_3)
    service.at(2.0, lambda: service.command(USER_2))
    service.serve(lambda: service.video.closed == 1)
    assert service.drone.calls == []


def test_the_answer_is_given_to_the_autopilot_when_asked_for(service: Service) -> None:
    told: list[int] = []
    service.command(USER_4, 1.0)
    service.serve(
        lambda: service.final()[-1:] == [(USER_4, ACCEPTED)],
        service.then((USER_4, FAILED)),
        (lambda: (USER_1, ACCEPTED) in service.final(), lambda: told.extend(service.obeyed.told)),
        service.then((USER_1, ACCEPTED), 1.0, command=USER_4),
    )
    assert "There is no answer yet" in service.texts()
    assert told == []
    assert len(service.obeyed.told) == 1


def test_a_pilot_process_that_is_gone_is_an_end_of_the_session(service: Service) -> None:
    service.drone.seize("pilot-process-lost", "the pilot process is gone")
    with pytest.raises(LinkError, match="the pilot process is gone"):
        service.serve(lambda: False)


def test_the_order_is_confirmed_in_words_before_the_video_is_opened(service: Service) -> None:
    service.command(USER_1)
    service.serve(lambda: service.final() == [(USER_1, ACCEPTED)])
    assert "order taken, opening the video" in service.said_before_opening


def test_the_next_order_finds_the_video_open_and_it_is_closed_when_no_order_comes(tmp_path: Path) -> None:
    service = Service(tmp_path, keep_open_s=60.0)
    service.command(USER_1)
    service.serve(
        lambda: service.video.closed == 1,
        (lambda: len(service.final()) == 1, lambda: service.later(59.0)),
        (lambda: True, lambda: service.command(USER_1)),
        (lambda: len(service.final()) == 2, lambda: service.later(61.0)),
    )
    assert service.opened == 1
    assert service.texts().count("opening the video") == 1


def _no_longer_plays(service: Service) -> None:
    service.video.broken = True


def _another_camera(service: Service) -> None:
    service.say(mavlink.MAVLink_param_set_message(1, 100, b"CAMERA_HFOV_DEG", 50.0, mavlink.MAV_PARAM_TYPE_REAL32))


@pytest.mark.parametrize("change", [_no_longer_plays, _another_camera])
def test_a_video_that_broke_or_is_set_otherwise_is_opened_again(
    tmp_path: Path, change: Callable[[Service], None]
) -> None:
    service = Service(tmp_path, keep_open_s=60.0)
    service.command(USER_1)
    service.serve(
        lambda: service.opened == 2,
        (lambda: len(service.final()) == 1, lambda: change(service)),
        (lambda: True, lambda: service.later(30.0)),
        (lambda: True, lambda: service.command(USER_1)),
    )
    assert service.video.closed >= 1


def test_an_operator_who_waits_for_the_first_picture_is_told_why(service: Service) -> None:
    service.camera_begins.clear()
    service.command(USER_1)
    service.serve(
        lambda: service.final() == [(USER_1, ACCEPTED)],
        (lambda: service.opened == 1, lambda: service.later(2.1)),
        (lambda: "waiting for the camera's first picture" in service.texts(), service.camera_begins.set),
    )
    assert "let it send one every second" in service.printed.getvalue()


def test_the_videos_password_is_in_no_file_message_or_line_of_a_flight(service: Service, tmp_path: Path) -> None:
    service.command(USER_1)
    service.serve(lambda: service.final() == [(USER_1, ACCEPTED)])
    service.no_video = VideoError(f"No video arrives at {ADDRESS}", f"Look at {ADDRESS}.")
    service.now += 60.0
    service.command(USER_1, 0.1, 0.1, 0.9, 0.9)
    service.serve(lambda: len(service.final()) == 2)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {"geotags.gpkg", "answer.json"} <= {path.name for path in files}
    assert [path for path in files if b"s3cr3t" in path.read_bytes()] == []
    assert not any(b"s3cr3t" in bytes(message.get_msgbuf()) for message in service.wire.sent)
    assert "s3cr3t" not in service.printed.getvalue()
    (geotag,) = read_geotags(service.log)
    assert geotag.provenance.video == "rtsp://***@camera/live?***"


def test_an_autopilot_that_does_not_answer_does_not_hold_up_the_programs_end(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits, over = Event(), Event()

    def command_int(*_: object, **__: object) -> int:
        waits.set()
        over.wait(60.0)
        return ACCEPTED

    monkeypatch.setattr(service.wire, "command_int", command_int)
    service.command(USER_1)
    try:
        service.serve(waits.is_set, service.then((USER_1, ACCEPTED), 1.0, command=USER_4))
        assert not over.is_set()
    finally:
        over.set()
