"""What becomes of an answer, as the settings say."""

from __future__ import annotations

import io
import socket
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from rich.console import Console

from gcs_plugin.answer import Answer, Times
from gcs_plugin.flight_folder import FlightFolder
from gcs_plugin.geotags import GeotagLog, Provenance
from gcs_plugin.progress import Progress
from mission.estimate.sightings_file import read_flights
from mission.located import Located
from mission.records import CameraIntrinsics, FlightSightings, Sighting
from mission.settings import AnswerSettings
from tests.gcs_plugin.fake_vehicle import PX4, FakeLink, Vehicle, plan
from tests.gcs_plugin.sample import NOON, estimate, origin
from tests.mission.fakes import FakeDrone


def located() -> Located:
    sightings = tuple(
        Sighting(100.25 + 0.05 * i, (0.0, 0.0, 3.0), (0.5, -0.5, 0.5, -0.5), (320.0, 240.0)) for i in range(5)
    )
    camera = CameraIntrinsics(640, 480, 516.5, 516.5, 320.0, 240.0)
    flight = FlightSightings("flight-1", origin("amsl"), camera, sightings)
    return Located(flight, estimate(), (), True, None, np.zeros((2, 4)), (), None, 106.25)


def answered(
    link: FakeLink, folder: Path, *, ended: str = "", as_reported: FlightSightings | None = None, **settings: object
) -> list[str]:
    """Give the answer to everybody; what the link was sent, by message name."""
    times = Times(lambda: 106.5, lambda: NOON)
    said = Console(file=io.StringIO())
    with FlightFolder(folder, NOON) as flight_folder, Progress(said) as progress:
        log = GeotagLog(folder / "geotags.gpkg")
        chosen = AnswerSettings.model_validate(settings)
        answer = Answer(
            FakeDrone(t_s=106.25), link, chosen, flight_folder, log, progress, Provenance("test", "1"), times
        )
        found = replace(located(), ended=ended, as_reported=as_reported)
        answer.located(found)
        answer.finish(found)
        answer.close()
    assert answer.geotag is not None
    assert answer.geotag.number == 1
    return [message.get_type() for message in link.sent]


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
