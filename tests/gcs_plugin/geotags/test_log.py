"""The log: what was acknowledged is there, after `kill -9`, a full disk, and another program's lock."""

from __future__ import annotations

import json
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import TypedDict

import pytest

from gcs_plugin.exports.formats import FORMATS
from gcs_plugin.geotags.geotag import row
from gcs_plugin.geotags.log import GeotagLog, read_geotags
from gcs_plugin.geotags.row import from_json
from gcs_plugin.geotags.spool import GeotagSpool
from mission.errors import AnswerError
from tests.support.sample import estimate, geotag, jpeg, origin

WRITER = """
import sys
from pathlib import Path
from gcs_plugin.geotags.log import GeotagLog
from tests.support.sample import geotag, jpeg
log, picture = GeotagLog(Path(sys.argv[1])), jpeg(200)
for i in range(100000):
    logged = log.append(geotag(f"tag-{i}", picture=picture))
    print(logged.geotag.id, flush=True)
"""

FILLER = """
import json, resource, sys
from pathlib import Path
from gcs_plugin.geotags.log import GeotagLog
from mission.errors import AnswerError
from tests.support.sample import geotag, jpeg
path, limit = Path(sys.argv[1]), int(sys.argv[2])
log, picture, acknowledged, warning = GeotagLog(path), jpeg(150), [], ""
cause = remedy = ""
if len(sys.argv) > 3:
    try:
        log.prepare()
    except AnswerError as error:
        cause, remedy, warning = error.cause, error.remedy, "not begun"
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    while not warning:
        logged = log.append(geotag(f"tag-{len(acknowledged)}", picture=picture))
        acknowledged.append([logged.geotag.id, str(logged.path)])
        warning = logged.warning
except AnswerError as error:
    cause, remedy = error.cause, error.remedy
print(json.dumps({
    "acknowledged": acknowledged, "cause": cause, "remedy": remedy, "warning": warning,
    "readable": [tag.id for tag in log.read()], "left": sorted(p.name for p in path.parent.iterdir()),
}))
"""


def integrity(path: Path) -> list[tuple[str]]:
    connection = sqlite3.connect(path)
    try:
        return connection.execute("PRAGMA integrity_check").fetchall()
    finally:
        connection.close()


def test_what_goes_in_comes_out(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "new" / "folder" / "log.gpkg")
    assert log.read() == []
    tags = [
        geotag("a", picture=jpeg()),
        geotag("b", at=origin("amsl"), geoid_separation_m=None),
        replace(geotag("c", where=estimate(velocity=None)), drone=None, chi2=None, dof=None, notes=("ü", "x\ny")),
    ]
    logged = [log.append(tag) for tag in tags]
    assert [entry.geotag.number for entry in logged] == [1, 2, 3]
    assert all(entry.path == log.path and not entry.warning for entry in logged)
    assert log.read() == [replace(tag, number=i + 1) for i, tag in enumerate(tags)]


def test_a_file_name_that_is_no_utf8_does_not_cost_the_geotag(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    tag = geotag()
    odd = replace(tag, provenance=replace(tag.provenance, sightings_file="fl\udcffght"), notes=("n\udcff",))
    log.append(odd)
    (found,) = log.read()
    assert found.provenance.sightings_file == r"fl\udcffght"
    for name in ("geojson", "kml", "csv"):
        assert b"flight-1" in FORMATS[name]([odd])


def test_the_same_geotag_is_not_logged_twice(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    log.append(geotag())
    with pytest.raises(AnswerError, match="already"):
        log.append(geotag())
    assert len(log.read()) == 1


def test_every_acknowledged_geotag_survives_kill_9(tmp_path: Path) -> None:
    path = tmp_path / "log.gpkg"
    for moment in (1, 4, 9):  # killed at whatever instant follows the n-th acknowledgement
        path.unlink(missing_ok=True)
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True)
        assert writer.stdout is not None
        acknowledged = [writer.stdout.readline().strip() for _ in range(moment)]
        writer.send_signal(signal.SIGKILL)
        acknowledged += writer.stdout.read().split()
        writer.wait()
        writer.stdout.close()
        found = [tag.id for tag in read_geotags(path)]
        assert found[: len(acknowledged)] == acknowledged
        assert len(found) <= len(acknowledged) + 1  # the last may have been committed and not yet said
        assert integrity(path) == [("ok",)]


def test_a_half_written_geotag_is_undone_when_the_file_is_next_opened(tmp_path: Path) -> None:
    path = tmp_path / "log.gpkg"
    GeotagLog(path).append(geotag("whole"))
    # A writer that has begun to change the file itself (its cache is too small to wait for the commit) and is killed.
    torn = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sqlite3, os, signal, sys\n"
            "c = sqlite3.connect(sys.argv[1], isolation_level=None)\n"
            "c.execute('PRAGMA cache_size = 1'); c.execute('PRAGMA cache_spill = 1'); c.execute('BEGIN')\n"
            "c.execute('UPDATE geotags SET id = ?', ('torn',))\n"
            "c.execute('CREATE TABLE junk (x)')\n"
            "for _ in range(50): c.execute('INSERT INTO junk VALUES (zeroblob(9000))')\n"
            "os.kill(os.getpid(), signal.SIGKILL)",
            str(path),
        ],
        check=False,
    )
    assert torn.returncode == -signal.SIGKILL
    assert path.with_name("log.gpkg-journal").stat().st_size > 0
    assert [tag.id for tag in read_geotags(path)] == ["whole"]
    assert integrity(path) == [("ok",)]


def test_a_log_that_reached_a_size_limit_keeps_what_was_acknowledged_and_the_next_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "disk" / "log.gpkg"
    path.parent.mkdir()
    report = _fill([sys.executable, "-c", FILLER, str(path), str(200_000)])
    assert "cannot be written" in report["warning"]
    *earlier, last = report["acknowledged"]
    assert len(earlier) >= 2
    assert Path(last[1]).parent == tmp_path / "disk" / "log.gpkg.aside"
    assert report["readable"] == [name for name, _ in report["acknowledged"]]
    assert integrity(path) == [("ok",)]


SMALL_DISK = ["unshare", "-rm", "sh", "-c", 'mount -t tmpfs -o size="$1" tmpfs "$2" && shift 2 && exec "$@"', "sh"]


def _small_disk_can_be_mounted(folder: Path) -> bool:
    if shutil.which("unshare") is None:
        return False
    return subprocess.run([*SMALL_DISK, "64k", str(folder), "true"], check=False, capture_output=True).returncode == 0


@pytest.mark.parametrize("size", ["400k", "500k"])
def test_on_a_full_disk_the_geotag_takes_the_room_that_was_reserved_and_goes_into_the_log_later(
    tmp_path: Path, size: str
) -> None:
    disk, saved = tmp_path / "disk", tmp_path / "saved"
    disk.mkdir()
    if not _small_disk_can_be_mounted(disk):
        pytest.skip("this system lets nobody mount a small disk")
    run = [sys.executable, "-c", FILLER, str(disk / "log.gpkg"), "0", "prepare"]
    then = ["sh", "-c", 'from=$1 to=$2 && shift 2 && "$@" && cp -r "$from" "$to"', "sh", str(disk), str(saved), *run]
    report = _fill([*SMALL_DISK, size, str(disk), *then])
    assert "the disk is full" in report["warning"]
    *earlier, last = report["acknowledged"]
    assert earlier
    assert "aside" in last[1]
    assert report["readable"] == [name for name, _ in report["acknowledged"]]
    saved_log = saved / "log.gpkg"  # the disk is full no more
    assert integrity(saved_log) == [("ok",)]
    GeotagLog(saved_log).prepare()
    assert not list(saved.glob("log.gpkg.aside/unlogged-*"))
    assert [tag.number for tag in read_geotags(saved_log)] == list(range(1, len(report["acknowledged"]) + 1))
    assert read_geotags(saved_log)[-1].picture


def test_a_log_that_does_not_fit_on_the_disk_is_not_begun(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    if not _small_disk_can_be_mounted(disk):
        pytest.skip("this system lets nobody mount a small disk")
    for size in ("24k", "120k"):  # too small for the log, and for what is reserved beside it
        run = [sys.executable, "-c", FILLER, str(disk / "log.gpkg"), "0", "prepare"]
        report = _fill([*SMALL_DISK, size, str(disk), *run])
        assert "cannot be written" in report["cause"]
        assert report["remedy"]
        assert report["acknowledged"] == []


class Filled(TypedDict):
    acknowledged: list[tuple[str, str]]
    readable: list[str]
    left: list[str]
    cause: str
    remedy: str
    warning: str


def _fill(command: list[str]) -> Filled:
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    report: Filled = json.loads(done.stdout)
    return report


def test_when_both_places_fail_both_are_named(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    with pytest.raises(AnswerError, match=r"file/log\.gpkg .*file/log\.gpkg\.aside/unlogged"):
        GeotagLog(blocked / "log.gpkg").append(geotag())


def test_a_geotag_that_meets_a_lock_is_kept_beside_the_log_and_goes_into_it_with_the_next(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg", busy_timeout_s=0.1)
    log.append(geotag("a"))
    other = sqlite3.connect(log.path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    kept = log.append(geotag("b", picture=jpeg()))
    assert "another program holds it" in kept.warning
    assert kept.geotag.number == 2
    assert [tag.id for tag in log.read()] == ["a", "b"], "who reads the log sees it already"
    with pytest.raises(AnswerError, match="another program holds it"):
        log.prepare()
    other.execute("ROLLBACK")
    other.close()
    assert log.append(geotag("c")).geotag.number == 3
    assert log.read()[1] == kept.geotag
    with sqlite3.connect(log.path) as connection:
        assert sorted(connection.execute("SELECT fid, id FROM geotags")) == [(1, "a"), (2, "b"), (3, "c")]
    connection.close()
    assert not list(log.path.parent.glob("*.aside/unlogged-*"))


def test_what_was_logged_and_not_removed_before_a_crash_is_not_logged_twice(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    tag = log.append(geotag("a")).geotag
    GeotagSpool(log.path).put(tag)
    assert [each.id for each in log.read()] == ["a"]
    assert log.merge() == 0
    assert [each.id for each in log.read()] == ["a"]
    assert not list(log.path.parent.glob("*.aside/unlogged-*"))


def test_a_spoilt_file_beside_the_log_takes_nothing_else_with_it(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    log.append(geotag("a"))
    (tmp_path / "log.gpkg.aside" / "unlogged-9.json").write_text('{"number": 9')
    log.prepare()
    assert log.append(geotag("b")).geotag.number == 10
    assert [tag.id for tag in log.read()] == ["a", "b"]


# --- numbers


def test_numbers_go_on_after_a_backup_of_the_log_is_put_back_or_the_log_begun_anew(tmp_path: Path) -> None:
    path, backup = tmp_path / "log.gpkg", tmp_path / "backup.gpkg"
    GeotagLog(path).append(geotag("a"))
    shutil.copy(path, backup)
    assert [GeotagLog(path).append(geotag(name)).geotag.number for name in ("b", "c")] == [2, 3]
    shutil.copy(backup, path)
    assert GeotagLog(path).append(geotag("d")).geotag.number == 4
    path.unlink()
    log = GeotagLog(path)
    log.prepare()
    assert log.append(geotag("e")).geotag.number == 5


def test_the_number_of_a_row_that_was_deleted_is_not_given_again(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    for name in "abc":
        log.append(geotag(name))
    with sqlite3.connect(log.path) as connection:
        connection.execute("DELETE FROM geotags WHERE fid > 1")
    connection.close()
    shutil.rmtree(tmp_path / "log.gpkg.aside")  # a log of the version before had none
    again = GeotagLog(log.path)
    again.prepare()
    assert again.append(geotag("d")).geotag.number == 4


def test_a_row_that_somebody_else_wrote_moves_the_number_and_loses_nothing(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    log.append(geotag("a"))
    numbered = log.numbered(geotag("b"))
    with sqlite3.connect(log.path) as connection:
        names = ", ".join(row(geotag()))
        connection.execute(
            f"INSERT INTO geotags (fid, {names}) SELECT 2, {names.replace('id,', quoted('copy') + ',', 1)} FROM geotags"
        )
    connection.close()
    assert log.append(numbered).geotag.number == 3
    assert [tag.number for tag in log.read()] == [1, 2, 3]


def quoted(text: str) -> str:
    return f"'{text}'"


def test_two_logs_of_one_file_never_give_the_same_number(tmp_path: Path) -> None:
    logs = [GeotagLog(tmp_path / "log.gpkg") for _ in range(2)]
    for log in logs:
        log.prepare()
    given = [log.numbered(geotag()).number for log in logs * 3]
    assert given == [1, 2, 3, 4, 5, 6]


# --- what other programs do to the log


def test_a_file_that_a_gis_switched_to_a_write_ahead_log_goes_on(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    log.append(geotag("a"))
    gis = sqlite3.connect(log.path)
    assert gis.execute("PRAGMA journal_mode = WAL").fetchone() == ("wal",)
    assert gis.execute("SELECT count(*) FROM geotags").fetchone() == (1,)  # and it keeps the file open
    assert log.append(geotag("b")).geotag.number == 2
    assert [tag.id for tag in log.read()] == ["a", "b"]
    gis.close()


def test_several_threads_may_append(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg", busy_timeout_s=10.0)
    threads = [
        threading.Thread(target=lambda k=k: [log.append(geotag(f"{k}-{i}")) for i in range(5)]) for k in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(tag.number for tag in log.read()) == list(range(1, 21))


@pytest.mark.parametrize(
    ("content", "message"), [(b"no database at all" * 100, "no GeoPackage"), (b"", "not a GeoPackage")]
)
def test_a_file_of_another_kind_is_refused_and_left_as_it_is(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "holiday.jpg"
    path.write_bytes(content)
    log = GeotagLog(path)
    for action in (log.prepare, log.read):
        with pytest.raises(AnswerError, match=message):
            action()
    assert message in log.append(geotag()).warning
    assert path.read_bytes() == content


def test_a_geopackage_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.gpkg"
    GeotagLog(path).append(geotag())
    with sqlite3.connect(path) as connection:
        connection.execute("ALTER TABLE geotags RENAME COLUMN ce90_m TO something_else")
    connection.close()
    with pytest.raises(AnswerError, match="no column ce90_m"):
        GeotagLog(path).prepare()
    assert "no column ce90_m" in GeotagLog(path).append(geotag("b")).warning


@pytest.mark.parametrize(
    ("spoiled", "named"),
    [
        ("covariance_enu = '[[1]]'", "covariance_enu"),
        ("covariance_enu = '{'", "covariance_enu"),
        ("covariance_enu = '" + "[" * 5000 + "'", "covariance_enu"),
        ("alt_datum = 'moon'", "moon"),
        ("lat_deg = 'north'", "lat_deg"),
        ("lat_deg = 9e999", "lat_deg"),
        ("lat_deg = 91.0", "no place on earth"),
        ("time_utc = 'noon'", "noon"),
        ("time_utc = '2026-11-22T12:00:06.250'", "time zone"),
        ("notes = '{}'", "notes"),
        ("picture = 'none'", "picture"),
        ("sightings = 1.5", "sightings"),
        ("velocity_up_m_s = 'fast'", "velocity_up_m_s"),
        ("method = x'ff00'", "method"),
        ("id = cast(x'ff' as text)", ""),
    ],
)
def test_a_row_that_was_edited_by_hand_costs_itself_and_is_told(tmp_path: Path, spoiled: str, named: str) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    log.append(geotag("a"))
    log.append(geotag("b"))
    with sqlite3.connect(log.path) as connection:
        connection.execute(f"UPDATE geotags SET {spoiled} WHERE fid = 1")
    connection.close()
    log.prepare()
    log.append(geotag("c"))
    told: list[str] = []
    found = read_geotags(log.path, told=told.append)
    assert [tag.id for tag in found][-2:] == ["b", "c"]
    assert len(found) == 3 - len(told)
    assert all("row 1 of the geotag log" in text and named in text for text in told)
    assert told or not named
    for name, export in FORMATS.items():
        assert name == "jpg" or export(found)


RTREE = (
    "CREATE VIRTUAL TABLE rtree_geotags_geom USING rtree(id, minx, maxx, miny, maxy);"
    'CREATE TRIGGER rtree_geotags_geom_insert AFTER INSERT ON "geotags"'
    ' WHEN (new."geom" NOT NULL AND NOT ST_IsEmpty(NEW."geom")) BEGIN'
    ' INSERT OR REPLACE INTO rtree_geotags_geom VALUES (NEW."fid", ST_MinX(NEW."geom"), ST_MaxX(NEW."geom"),'
    ' ST_MinY(NEW."geom"), ST_MaxY(NEW."geom")); END;'
)
"""What a GIS adds with a spatial index (OGC 12-128r18, annex F.3), as far as inserting goes."""


def test_a_spatial_index_that_a_gis_added_is_kept_up(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    log.append(geotag("a"))
    with sqlite3.connect(log.path) as connection:
        connection.executescript(RTREE)
    connection.close()
    log.prepare()
    tag = log.append(geotag("b", geoid_separation_m=None)).geotag
    assert not (tmp_path / "log.gpkg.aside" / "unlogged-2.json").exists()
    with sqlite3.connect(log.path) as connection:
        ((number, west, east, south, north),) = connection.execute("SELECT * FROM rtree_geotags_geom")
    connection.close()
    assert number == tag.number
    assert west <= tag.place.lon_deg <= east
    assert south <= tag.place.lat_deg <= north


@pytest.mark.parametrize(
    "change",
    [
        "CREATE TRIGGER of_another BEFORE INSERT ON geotags BEGIN SELECT another_programs_function(); END",
        "CREATE TRIGGER strict BEFORE INSERT ON geotags BEGIN SELECT RAISE(ABORT, 'read only, said the GIS'); END",
        "CREATE UNIQUE INDEX only_one ON geotags (coalesce(1, fid))",
        "ALTER TABLE geotags RENAME COLUMN ce90_m TO something_else",
    ],
)
def test_what_keeps_the_log_from_being_appended_to_is_found_before_the_flight(tmp_path: Path, change: str) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    log.append(geotag("a"))
    with sqlite3.connect(log.path) as connection:
        connection.execute(change)
    connection.close()
    with pytest.raises(AnswerError, match=r"log\.gpkg"):
        log.prepare()
    kept = log.append(geotag("b"))
    assert kept.warning
    assert from_json(kept.path.read_bytes()) == kept.geotag


def test_the_trial_before_the_flight_leaves_nothing_behind(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    for _ in range(3):
        log.prepare()
    with sqlite3.connect(log.path) as connection:
        (extent,) = connection.execute("SELECT min_x, max_x FROM gpkg_contents")
    connection.close()
    assert extent == (None, None)
    assert log.read() == []
    assert log.append(geotag()).geotag.number == 1


def test_prepare_finds_before_the_flight_that_the_log_cannot_be_written(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg")
    log.prepare()
    assert log.read() == []
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(AnswerError, match="cannot be written"):
        GeotagLog(blocked / "log.gpkg").prepare()


def test_a_log_that_is_not_there_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(AnswerError, match="no geotag log"):
        read_geotags(tmp_path / "none.gpkg")


def test_appending_is_quick(tmp_path: Path) -> None:
    # The log's share of the 0.5 s from the last frame to the geotag, in processor time: the disk's does not count.
    log = GeotagLog(tmp_path / "log.gpkg")
    log.prepare()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    for i in range(10):
        log.append(geotag(f"{i}", picture=b"\xff\xd8\xff" + bytes(50_000)))
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_utime - before) / 10 < 0.1
