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

from gcs_plugin.export import FORMATS
from gcs_plugin.geotags import GeotagLog, read_geotags
from mission.errors import AnswerError
from tests.gcs_plugin.sample import estimate, geotag, jpeg, origin

WRITER = """
import sys
from pathlib import Path
from gcs_plugin.geotags import GeotagLog
from tests.gcs_plugin.sample import geotag, jpeg
log, picture = GeotagLog(Path(sys.argv[1])), jpeg(200)
for i in range(100000):
    logged = log.append(geotag(f"tag-{i}", picture=picture))
    print(logged.geotag.id, flush=True)
"""

FILLER = """
import json, resource, sys
from pathlib import Path
from gcs_plugin.geotags import GeotagLog
from mission.errors import AnswerError
from tests.gcs_plugin.sample import geotag, jpeg
path, limit = Path(sys.argv[1]), int(sys.argv[2])
fallback = Path(sys.argv[3]) if len(sys.argv) > 3 else None
log, picture, acknowledged, warning = GeotagLog(path, fallback=fallback), jpeg(150), [], ""
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
cause = remedy = ""
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
    for export in FORMATS.values():
        assert b"flight-1" in export([odd]).encode("utf-8")


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


def test_a_file_size_limit_stops_the_log_and_keeps_what_was_acknowledged(tmp_path: Path) -> None:
    path = tmp_path / "disk" / "log.gpkg"
    path.parent.mkdir()
    report = _fill([sys.executable, "-c", FILLER, str(path), str(200_000)])
    assert "cannot be written" in report["cause"]
    assert report["remedy"]
    assert len(report["acknowledged"]) >= 2
    assert report["readable"] == [name for name, _ in report["acknowledged"]]
    assert integrity(path) == [("ok",)]


SMALL_DISK = ["unshare", "-rm", "sh", "-c", 'mount -t tmpfs -o size="$1" tmpfs "$2" && shift 2 && exec "$@"', "sh"]


def _small_disk_can_be_mounted(folder: Path) -> bool:
    if shutil.which("unshare") is None:
        return False
    return subprocess.run([*SMALL_DISK, "64k", str(folder), "true"], check=False, capture_output=True).returncode == 0


@pytest.mark.parametrize("size", ["150k", "300k"])
def test_a_full_disk_stops_the_log_and_keeps_what_was_acknowledged(tmp_path: Path, size: str) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    if not _small_disk_can_be_mounted(disk):
        pytest.skip("this system lets nobody mount a small disk")
    report = _fill([*SMALL_DISK, size, str(disk), sys.executable, "-c", FILLER, str(disk / "log.gpkg"), "0"])
    assert "the disk is full" in report["cause"]
    assert "Free some space" in report["remedy"]
    assert report["readable"] == [name for name, _ in report["acknowledged"]] != []
    assert report["left"] == ["log.gpkg"]


def test_a_log_that_does_not_fit_on_the_disk_is_not_begun(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    if not _small_disk_can_be_mounted(disk):
        pytest.skip("this system lets nobody mount a small disk")
    report = _fill([*SMALL_DISK, "24k", str(disk), sys.executable, "-c", FILLER, str(disk / "log.gpkg"), "0"])
    assert "the disk is full" in report["cause"]
    assert (report["acknowledged"], report["readable"], report["left"]) == ([], [], [])


def test_when_the_disk_is_full_the_geotag_goes_to_the_fallback_folder(tmp_path: Path) -> None:
    path, other = tmp_path / "disk" / "log.gpkg", tmp_path / "other"
    path.parent.mkdir()
    if not _small_disk_can_be_mounted(path.parent):
        pytest.skip("this system lets nobody mount a small disk")
    script = [sys.executable, "-c", FILLER, str(path), "0", str(other)]
    report = _fill([*SMALL_DISK, "300k", str(path.parent), *script])
    assert "the disk is full" in report["warning"]
    *earlier, last = report["acknowledged"]
    assert last[1] == str(other / "log.gpkg")
    assert [tag.id for tag in read_geotags(other / "log.gpkg")] == [last[0]]
    assert report["readable"] == [name for name, _ in earlier]


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


def test_when_both_folders_fail_both_are_named(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    log = GeotagLog(blocked / "log.gpkg", fallback=blocked / "too")
    with pytest.raises(AnswerError, match=r"file/log\.gpkg.*file/too/log\.gpkg"):
        log.append(geotag())


def test_another_program_that_reads_does_not_stop_the_log_for_long_and_one_that_writes_is_named(tmp_path: Path) -> None:
    log = GeotagLog(tmp_path / "log.gpkg", busy_timeout_s=0.1)
    log.append(geotag("a"))
    other = sqlite3.connect(log.path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(AnswerError, match="another program holds it"):
        log.append(geotag("b"))
    other.execute("ROLLBACK")
    other.close()
    assert log.append(geotag("b")).geotag.number == 2


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
    for action in (log.prepare, log.read, lambda: log.append(geotag())):
        with pytest.raises(AnswerError, match=message):
            action()
    assert path.read_bytes() == content


def test_a_geopackage_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.gpkg"
    GeotagLog(path).append(geotag())
    with sqlite3.connect(path) as connection:
        connection.execute("ALTER TABLE geotags RENAME COLUMN ce90_m TO something_else")
    connection.close()
    with pytest.raises(AnswerError, match="no column ce90_m"):
        GeotagLog(path).append(geotag("b"))


def test_a_row_that_is_no_geotag_is_a_clear_error(tmp_path: Path) -> None:
    path = tmp_path / "log.gpkg"
    GeotagLog(path).append(geotag())
    for spoiled in ("covariance_enu = '[[1]]'", "covariance_enu = '{'", "alt_datum = 'moon'"):
        copy = tmp_path / "copy.gpkg"
        shutil.copy(path, copy)
        with sqlite3.connect(copy) as connection:
            connection.execute(f"UPDATE geotags SET {spoiled}")
        connection.close()
        with pytest.raises(AnswerError, match="no geotag"):
            read_geotags(copy)


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
