"""One flight in, one folder out: whole, the same each time, and with a reason where there is nothing."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gcs_plugin.archive.job import Job, JobSettings, is_done, job_key, run_job
from gcs_plugin.archive.pairs import find_jobs, log_beside
from mission.errors import AnswerError, LogError
from mission.observation.reprocess import Means
from tests.gcs_plugin.archive.small_flights import BEFORE_S, small_flight


@pytest.fixture(scope="module")
def means() -> Means:
    return Means.usual()


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Job:
    folder = tmp_path_factory.mktemp("card")
    small_flight(folder, "one")
    (job,) = find_jobs(folder)
    assert isinstance(job, Job)
    return job


def told(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "result.json").read_text())
    return found


def test_a_flight_with_nobody_in_it(flight: Job, means: Means, tmp_path: Path) -> None:
    assert run_job(flight, JobSettings(), tmp_path / "a", means=means) == ""
    assert is_done(tmp_path / "a")
    result = told(tmp_path / "a")
    assert result["time"]["offset_s"] == pytest.approx(-BEFORE_S, abs=0.02)
    assert result["time"]["measured"]
    assert result["targets"] == []
    with sqlite3.connect(tmp_path / "a" / "targets.gpkg") as layers:
        names = [name for (name,) in layers.execute("SELECT table_name FROM gpkg_contents")]
        assert sorted(names) == ["ellipses", "paths", "rays", "targets"]
        assert layers.execute("PRAGMA integrity_check").fetchone() == ("ok",)


def test_the_same_bytes_again(flight: Job, means: Means, tmp_path: Path) -> None:
    for name in ("a", "b"):
        run_job(flight, JobSettings(), tmp_path / name, means=means)
    for one in sorted((tmp_path / "a").iterdir()):
        assert one.read_bytes() == (tmp_path / "b" / one.name).read_bytes()


def test_key_is_of_content_settings_and_name(flight: Job) -> None:
    key = job_key(flight, JobSettings())
    assert key == job_key(flight, JobSettings())
    assert key != job_key(flight, JobSettings(wanted=0.1))
    assert key != job_key(replace(flight, name="two"), JobSettings())
    assert key != job_key(replace(flight, camera=None), JobSettings())


@pytest.mark.parametrize(
    ("spoilt", "content", "why"),
    [("video", b"no video at all", "cannot be read"), ("log", b"t_s,lat_deg,lon_deg,amsl_m\n1,0,0,3\n", "0 positions")],
)
def test_what_cannot_be_used_has_a_result_that_says_why(
    spoilt: str, content: bytes, why: str, flight: Job, means: Means, tmp_path: Path
) -> None:
    broken = tmp_path / f"broken{getattr(flight, spoilt).suffix}"
    broken.write_bytes(content)
    job = Job("x", broken, flight.log) if spoilt == "video" else Job("x", flight.video, broken, flight.camera)
    assert why in run_job(job, JobSettings(), tmp_path / "out", means=means)
    assert why in told(tmp_path / "out")["error"]


def test_a_video_that_ends_in_the_middle_is_used_so_far(flight: Job, means: Means, tmp_path: Path) -> None:
    """MP4 keeps its index at the end: cut, it is unreadable, and said to be."""
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(flight.video.read_bytes()[:-2000])
    assert "cannot be read" in run_job(Job("x", cut, flight.log), JobSettings(), tmp_path / "out", means=means)


def test_another_flight_s_log(flight: Job, means: Means, tmp_path: Path) -> None:
    small_flight(tmp_path, "other", seed=5)
    text = (tmp_path / "other.csv").read_text().splitlines()
    head, rows = text[0], [line.split(",") for line in text[1:]]
    yaw = head.split(",").index("yaw_deg")
    for row in rows:
        row[yaw] = "10.0"
    (tmp_path / "other.csv").write_text("\n".join([head, *(",".join(row) for row in rows)]))
    why = run_job(replace(flight, log=tmp_path / "other.csv"), JobSettings(), tmp_path / "out", means=means)
    assert "cannot be put together" in why


def test_a_place_that_cannot_be_written(flight: Job, means: Means, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(AnswerError):
        run_job(flight, JobSettings(), tmp_path / "file" / "out", means=means)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_pairs_by_name(flight: Job, tmp_path: Path) -> None:
    for name in ("DJI_0001.MP4", "DJI_0001.SRT", "DJI_0002.MP4", "DJI_0002.SRT", "sub.mp4"):
        (tmp_path / name).write_bytes(b"")
    assert log_beside(tmp_path / "DJI_0002.MP4").name == "DJI_0002.SRT"
    with pytest.raises(LogError, match="which log"):
        log_beside(tmp_path / "sub.mp4")
    found = list(find_jobs(tmp_path))
    assert [one.name for one in found if isinstance(one, Job)] == ["DJI_0001", "DJI_0002"]
    assert len(found) == 3
