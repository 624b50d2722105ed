"""What becomes of an answer, as the settings say."""

from __future__ import annotations

import io
import json
import socket
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from rich.console import Console

from gcs_plugin.flight_report.flight_folder import FlightFolder
from gcs_plugin.geotags.log import GeotagLog, Provenance
from gcs_plugin.geotags.row import from_json
from gcs_plugin.publish.publisher import AnswerPublisher, Times
from gcs_plugin.terminal.progress import Progress
from mission.errors import Aborted, EstimateRefused, SidestepError
from mission.estimate.sightings_file import read_flights
from mission.procedure.result import LocateResult
from mission.records import CameraIntrinsics, FlightSightings, Sighting
from mission.settings import AnswerSettings
from tests.support.fake_autopilot import PX4, FakeLink, Vehicle, plan
from tests.support.fakes import FakeDrone
from tests.support.sample import NOON, estimate, origin


def located() -> LocateResult:
    sightings = tuple(
        Sighting(100.25 + 0.05 * i, (0.0, 0.0, 3.0), (0.5, -0.5, 0.5, -0.5), (320.0, 240.0)) for i in range(5)
    )
    camera = CameraIntrinsics(640, 480, 516.5, 516.5, 320.0, 240.0)
    flight = FlightSightings("flight-1", origin("amsl"), camera, sightings)
    return LocateResult(flight, estimate(), (), True, None, np.zeros((2, 4)), (), None, 106.25)


@dataclass
class Reported:
    """A flight's answer, and everybody who is told of it."""

    link: FakeLink
    folder: Path
    settings: AnswerSettings
    drone: FakeDrone = field(default_factory=lambda: FakeDrone(t_s=106.25))
    said: io.StringIO = field(default_factory=io.StringIO)
    ended: SidestepError | None = None

    def __post_init__(self) -> None:
        self.log = GeotagLog(self.folder / "geotags.gpkg", busy_timeout_s=0.05)

    @contextmanager
    def answer(self) -> Iterator[AnswerPublisher]:
        times = Times(lambda: 106.5, lambda: NOON)
        console = Console(file=self.said, width=300)
        with FlightFolder(self.folder, NOON) as flight_folder, Progress(console) as progress:
            given = Provenance("test", "1")
            answer = AnswerPublisher(
                self.drone, self.link, self.settings, flight_folder, self.log, progress, given, times
            )
            yield answer
            answer.close()

    def run(self, found: LocateResult) -> AnswerPublisher:
        with self.answer() as answer:
            answer.located(found)
            answer.keep(found)
            if self.ended is None:
                answer.finish(found)
            else:
                answer.failed(self.ended)
        return answer

    def sent(self) -> list[str]:
        return [message.get_type() for message in self.link.sent]

    def texts(self) -> str:
        return "".join(str(message.text) for message in self.link.sent if message.get_type() == "STATUSTEXT")

    def written(self) -> dict[str, Any]:
        (path,) = self.folder.glob("*/answer.json")
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return content


def answered(
    link: FakeLink, folder: Path, *, ended: str = "", as_reported: FlightSightings | None = None, **settings: object
) -> list[str]:
    """Give the answer to everybody; what the link was sent, by message name."""
    reported = Reported(link, folder, AnswerSettings.model_validate(settings))
    answer = reported.run(replace(located(), ended=ended, as_reported=as_reported))
    assert answer.geotag is not None
    assert answer.geotag.number == 1
    return reported.sent()


@pytest.fixture
def link() -> FakeLink:
    return FakeLink(Vehicle(PX4, plan(PX4)))


def test_an_aircraft_that_was_taken_is_told_nothing_and_the_geotag_stays(link: FakeLink, tmp_path: Path) -> None:
    before = len(link.vehicle.items)
    sent = answered(link, tmp_path, ended="the pilot took over", roi="automatic", waypoint="automatic")
    assert "COMMAND_INT" not in sent
    assert "COMMAND_LONG" not in sent
    assert "CAMERA_TRACKING_GEO_STATUS" in sent
    assert len(link.vehicle.items) == before


def test_what_the_aircraft_reported_is_kept_beside_what_the_answer_was_made_from(
    link: FakeLink, tmp_path: Path
) -> None:
    flight = located().flight
    moved = replace(flight, sightings=tuple(replace(one, position_enu_m=(9.0, 8.0, 7.0)) for one in flight.sightings))
    answered(link, tmp_path / "with", as_reported=moved)
    answered(link, tmp_path / "without")
    (kept,) = (tmp_path / "with").glob("*/as-reported.jsonl")
    (read,) = read_flights(kept)
    assert isinstance(read, FlightSightings)
    assert read.id == flight.id
    assert {one.position_enu_m for one in read.sightings} == {(9.0, 8.0, 7.0)}
    assert not list((tmp_path / "without").glob("*/as-reported.jsonl"))


def test_automatic_points_the_nose_and_appends_the_waypoint(link: FakeLink, tmp_path: Path) -> None:
    before = len(link.vehicle.items)
    sent = answered(link, tmp_path)
    assert "CAMERA_TRACKING_GEO_STATUS" in sent
    assert [command[0] for command in link.commands] == [mavlink.MAV_CMD_DO_SET_ROI_LOCATION]
    assert len(link.vehicle.items) == before + 1


@pytest.mark.parametrize("when", ["on-request", "never"])
def test_otherwise_the_autopilot_is_left_alone_and_the_answer_is_sent_all_the_same(
    link: FakeLink, tmp_path: Path, when: str
) -> None:
    before = list(link.vehicle.items)
    sent = answered(link, tmp_path, roi=when, waypoint=when)
    assert "CAMERA_TRACKING_GEO_STATUS" in sent
    assert link.commands == []
    assert link.vehicle.items == before
    assert not any(name.startswith("MISSION") for name in sent)


def test_the_adsb_marker_goes_to_the_station_named_and_never_to_the_vehicles_link(
    link: FakeLink, tmp_path: Path
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(10.0)
        url = f"udpout://127.0.0.1:{station.getsockname()[1]}"
        sent = answered(link, tmp_path, adsb_url=url, adsb_lifetime_s=2.0)
        parser = mavlink.MAVLink(None)
        got = [parser.parse_buffer(station.recv(2000))[0] for _ in range(2)]
    assert [message.get_type() for message in got] == ["HEARTBEAT", "ADSB_VEHICLE"]
    assert got[1].callsign == "TGT1"
    assert "ADSB_VEHICLE" not in sent


def test_without_an_address_there_is_no_marker(link: FakeLink, tmp_path: Path) -> None:
    assert "ADSB_VEHICLE" not in answered(link, tmp_path)


# --- the place reaches the operator whatever else fails

PLACE = "37.22"


def lock(log: GeotagLog) -> Iterator[None]:
    log.prepare()
    other = sqlite3.connect(log.path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    yield
    other.close()


def trigger(log: GeotagLog) -> Iterator[None]:
    log.prepare()
    with sqlite3.connect(log.path) as connection:
        connection.execute("CREATE TRIGGER x BEFORE INSERT ON geotags BEGIN SELECT another_programs_function(); END")
    connection.close()
    yield


def damage(log: GeotagLog) -> Iterator[None]:
    log.prepare()
    content = bytearray(log.path.read_bytes())
    content[4096:] = bytes(len(content) - 4096)
    log.path.write_bytes(content)
    yield


def replaced(log: GeotagLog) -> Iterator[None]:
    log.path.mkdir(parents=True)
    yield


def nowhere(log: GeotagLog) -> Iterator[None]:
    log.path.mkdir(parents=True)
    log.path.with_name("geotags.gpkg.aside").write_text("in the way")
    yield


@pytest.mark.parametrize("fault", [lock, trigger, damage, replaced, nowhere])
def test_a_log_that_fails_costs_nobody_the_place(
    link: FakeLink, tmp_path: Path, fault: Callable[[GeotagLog], Iterator[None]]
) -> None:
    reported = Reported(link, tmp_path, AnswerSettings())
    with contextmanager(fault)(reported.log):
        answer = reported.run(located())
    assert answer.geotag is not None
    assert "CAMERA_TRACKING_GEO_STATUS" in reported.sent()
    assert [command[0] for command in link.commands] == [mavlink.MAV_CMD_DO_SET_ROI_LOCATION]
    assert PLACE in reported.texts()
    assert "target 1 not logged" in reported.texts()
    assert PLACE in reported.said.getvalue()
    assert "target 1 is not logged: The geotag log" in reported.said.getvalue()
    written = reported.written()
    assert written["lat_deg"] == answer.geotag.place.lat_deg
    assert written["outcome"]["logged"] is False
    assert "geotags.gpkg" in written["outcome"]["not_logged"]
    kept = list(tmp_path.glob("*.aside/unlogged-1.json"))
    assert [from_json(path.read_bytes()) for path in kept] == ([] if fault is nowhere else [answer.geotag])


def test_a_log_that_is_free_again_after_the_flight_gets_the_geotag(link: FakeLink, tmp_path: Path) -> None:
    reported, found = Reported(link, tmp_path, AnswerSettings()), located()
    with reported.answer() as answer:
        with contextmanager(lock)(reported.log):
            answer.located(found)
            answer.keep(found)
        answer.finish(found)
    assert reported.written()["outcome"]["logged"] is True
    assert "target 1 is in the log now" in reported.said.getvalue()
    assert [tag.number for tag in reported.log.read()] == [1]
    assert not list(tmp_path.glob("*.aside/unlogged-*"))


def test_the_place_is_told_before_any_disk_is_asked(
    link: FakeLink, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported = Reported(link, tmp_path, AnswerSettings())
    order: list[str] = []
    for owner, name in ((GeotagLog, "append"), (FlightFolder, "write_answer")):
        monkeypatch.setattr(owner, name, _noting(getattr(owner, name), name, order, link))
    reported.run(located())
    assert order[0] == "append after 2"  # the place as message 276 and as a text
    assert [message.get_type() for message in link.sent[:2]] == ["CAMERA_TRACKING_GEO_STATUS", "STATUSTEXT"]


def _noting(do: Callable[..., object], name: str, order: list[str], link: FakeLink) -> Callable[..., object]:
    def noted(*given: object) -> object:
        order.append(f"{name} after {len(link.sent)}")
        return do(*given)

    return noted


def test_an_abort_while_reporting_stores_the_answer_sends_nothing_more_and_says_so(
    link: FakeLink, tmp_path: Path
) -> None:
    reported = Reported(link, tmp_path, AnswerSettings(), ended=Aborted("aborted by the operator"))
    answer = reported.run(located())
    assert link.commands == []
    assert not any(name.startswith("MISSION") for name in reported.sent())
    assert [tag.number for tag in reported.log.read()] == [1]
    written = reported.written()
    assert answer.geotag is not None
    assert written["lat_deg"] == answer.geotag.place.lat_deg
    assert "error" not in written
    assert written["outcome"]["logged"] is True
    assert written["outcome"]["ended"] == "aborted by the operator"
    assert written["outcome"]["region_of_interest"] == "not sent: the flight is over (aborted by the operator)"
    assert "no answer" not in reported.texts()
    assert "target 1 stands" in reported.texts()


def test_a_later_pass_without_an_answer_does_not_deny_the_earlier_one(link: FakeLink, tmp_path: Path) -> None:
    reported = Reported(link, tmp_path, AnswerSettings(), ended=EstimateRefused("too little baseline"))
    reported.run(located())
    assert reported.written()["outcome"]["ended"] == "too little baseline"
    assert reported.written()["number"] == 1


def test_what_was_given_to_the_autopilot_stands_in_the_answer(link: FakeLink, tmp_path: Path) -> None:
    reported = Reported(link, tmp_path, AnswerSettings())
    reported.run(located())
    outcome = reported.written()["outcome"]
    assert outcome["region_of_interest"] == "set"
    assert outcome["waypoint"].startswith("appended to the mission as item 4")
    assert outcome["log"] == str(reported.log.path)


def test_nothing_is_given_to_the_autopilot_before_it_holds(link: FakeLink, tmp_path: Path) -> None:
    """ArduPilot forgets its region of interest at the next setpoint with a heading, and those go on until the hold."""
    reported, found = (
        Reported(link, tmp_path, AnswerSettings.model_validate({"roi": "automatic", "waypoint": "never"})),
        located(),
    )
    with reported.answer() as answer:
        answer.located(found)
        answer.keep(found)
        assert link.commands == []
        answer.finish(found)
    assert [command[0] for command in link.commands] == [mavlink.MAV_CMD_DO_SET_ROI_LOCATION]
    assert reported.written()["outcome"]["region_of_interest"] == "set"


def test_an_aircraft_whose_own_accuracy_is_unknown_does_not_make_the_circle_small(
    link: FakeLink, tmp_path: Path
) -> None:
    known = Reported(link, tmp_path / "known", AnswerSettings()).run(located()).geotag
    mute = FakeDrone(t_s=106.25)
    mute.pose_at = lambda *_: None  # type: ignore[method-assign]
    unknown = Reported(link, tmp_path / "unknown", AnswerSettings(), mute).run(located()).geotag
    assert known is not None
    assert unknown is not None
    assert unknown.ce90_m > 5.0 > known.ce90_m
    assert any("own place" in note for note in unknown.notes)
    assert unknown.drone is not None, "the camera's place at the last sighting is nearly the aircraft's"
