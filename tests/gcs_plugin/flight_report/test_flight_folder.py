"""Each flight has a folder of its own, and what is in it stays."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

from gcs_plugin.flight_report.flight_folder import FlightFolder
from gcs_plugin.flight_report.outcome import Outcome
from mission.errors import AnswerError, EstimateRefused
from mission.estimate.sightings_file import read_flights
from mission.records import CameraIntrinsics, FlightSightings, Sighting
from tests.support.sample import NOON, ORIGIN, geotag, jpeg

FLIGHT = FlightSightings(
    "flight-1",
    ORIGIN,
    CameraIntrinsics(640, 480, 516.5, 516.5, 320.0, 240.0),
    (Sighting(0.05, (0.0, 0.0, 1.5), (0.5, -0.5, 0.5, -0.5), (318.2, 251.7), 97.3),),
)


def test_it_is_named_after_the_time_in_utc(tmp_path: Path) -> None:
    seoul = NOON.astimezone(timezone(timedelta(hours=9)))
    with FlightFolder(tmp_path / "flights", seoul, new_id=lambda: "abc123") as folder:
        assert folder.path == tmp_path / "flights" / "20261122T120006Z-abc123"
        assert folder.path.is_dir()
        assert folder.id == "20261122T120006Z-abc123"
    with pytest.raises(ValueError, match="time zone"):
        FlightFolder(tmp_path, datetime(2026, 1, 1))


def test_two_flights_of_one_second_have_two_folders(tmp_path: Path) -> None:
    ids = iter(["same", "same", "same", "other"])
    with (
        FlightFolder(tmp_path, NOON, new_id=lambda: next(ids)) as one,
        FlightFolder(tmp_path, NOON, new_id=lambda: next(ids)) as two,
    ):
        assert {one.id[-4:], two.id[-5:]} == {"same", "other"}
    paths = set()
    for _ in range(20):
        with FlightFolder(tmp_path, NOON) as folder:
            paths.add(folder.path)
    assert len(paths) == 20


def test_events_are_on_the_disk_as_they_happen(tmp_path: Path) -> None:
    folder = FlightFolder(tmp_path, NOON)
    folder.event(NOON, "pilot", "took over\nin mode LOITER")
    folder.event(NOON + timedelta(seconds=1), "statustext", "ü")
    lines = (folder.path / "events.jsonl").read_text().splitlines()  # before it is closed
    folder.close()
    folder.close()
    assert [json.loads(line) for line in lines] == [
        {"time_utc": "2026-11-22T12:00:06.250Z", "kind": "pilot", "text": "took over\nin mode LOITER"},
        {"time_utc": "2026-11-22T12:00:07.250Z", "kind": "statustext", "text": "ü"},
    ]


def test_the_sightings_can_be_read_back(tmp_path: Path) -> None:
    with FlightFolder(tmp_path, NOON) as folder:
        folder.write_sightings([FLIGHT])
        assert list(read_flights(folder.sightings_path)) == [FLIGHT]


def test_the_answer_and_the_pictures_are_kept(tmp_path: Path) -> None:
    with FlightFolder(tmp_path, NOON) as folder:
        folder.write_answer(replace(geotag(picture=jpeg()), number=3), Outcome(not_logged="the disk is full"))
        folder.write_plan_view(b"png")
        folder.write_contact_sheet(b"jpeg")
        answer = json.loads((folder.path / "answer.json").read_text())
        assert (answer["number"], answer["id"], answer["alt_datum"]) == (3, "tag-1", "ellipsoid")
        assert len(answer["covariance_enu"]) == 6
        assert answer["outcome"] == {
            "logged": False,
            "log": "",
            "not_logged": "the disk is full",
            "region_of_interest": "",
            "waypoint": "",
            "ended": "",
        }
        assert sorted(entry.name for entry in folder.path.iterdir()) == [
            "answer.json",
            "contact-sheet.jpg",
            "events.jsonl",
            "plan.png",
        ]


def test_where_there_is_no_answer_it_says_why(tmp_path: Path) -> None:
    with FlightFolder(tmp_path, NOON) as folder:
        folder.write_no_answer(EstimateRefused("Too little baseline", "Fly a longer pattern."))
        assert json.loads((folder.path / "answer.json").read_text()) == {
            "error": "Too little baseline",
            "remedy": "Fly a longer pattern.",
        }


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    blocked = tmp_path / "flights"
    blocked.write_text("")
    with pytest.raises(AnswerError, match="flights cannot be written"):
        FlightFolder(blocked, NOON)


FULL = """
import json, resource, sys
from datetime import datetime, UTC
from pathlib import Path
from gcs_plugin.flight_report.flight_folder import FlightFolder
from mission.errors import AnswerError
folder, noted, causes = FlightFolder(Path(sys.argv[1]), datetime.now(UTC)), 0, []
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
for action in (lambda: folder.write_plan_view(bytes(5000)), lambda: folder.write_plan_view(b"small")):
    try:
        action()
    except AnswerError as error:
        causes.append(error.cause)
try:
    while True:
        folder.event(datetime.now(UTC), "mode", "x" * 60)
        noted += 1
except AnswerError as error:
    causes.append(error.cause)
print(json.dumps([str(folder.path), noted, causes]))
"""


def test_a_full_disk_loses_nothing_that_was_there(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", FULL, str(tmp_path)], check=True, capture_output=True, text=True)
    path, noted, causes = json.loads(done.stdout)
    assert len(causes) == 2
    assert "plan.png cannot be written" in causes[0]
    assert "events.jsonl cannot be written" in causes[1]
    assert noted > 5
    lines = (Path(path) / "events.jsonl").read_text().splitlines()
    assert [json.loads(line)["kind"] for line in lines] == ["mode"] * noted
    assert (Path(path) / "plan.png").read_bytes() == b"small"
