"""The log of geotags: a GeoPackage that QGIS and GDAL open, in which an acknowledged geotag survives `kill -9`.

A full disk, a power cut or a kill in the middle of an append leaves the file as it was before it: SQLite's rollback
journal undoes the half, at once or when the file is next opened.
"""

from __future__ import annotations

import logging
import sqlite3
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from gcs_plugin.durable import clean_drafts, make_folder
from gcs_plugin.geotags import geopackage
from gcs_plugin.geotags.geotag import COLUMNS, Geotag, Provenance, make_geotag, row
from gcs_plugin.geotags.row import geotag_of_row
from gcs_plugin.geotags.spool import GeotagSpool
from mission.errors import AnswerError
from mission.geodesy import Geodetic

__all__ = ["Geotag", "GeotagLog", "Logged", "Provenance", "make_geotag", "read_geotags"]

LAYER: Final = "geotags"
_INSERT: Final = (
    f"INSERT INTO {LAYER} (fid, geom, {', '.join(column.name for column in COLUMNS)})"
    f" VALUES (?, ?{', ?' * len(COLUMNS)})"
)
_EXTENT: Final = (
    "UPDATE gpkg_contents SET last_change = strftime('%Y-%m-%dT%H:%M:%fZ', 'now'),"
    " min_x = min(coalesce(min_x, :x), :x), max_x = max(coalesce(max_x, :x), :x),"
    " min_y = min(coalesce(min_y, :y), :y), max_y = max(coalesce(max_y, :y), :y) WHERE table_name = :layer"
)

_log = logging.getLogger(__name__)


class AlreadyLogged(AnswerError):
    """The log has a geotag of this name."""


@dataclass(frozen=True, slots=True)
class Logged:
    """An acknowledged geotag: on the disk, numbered, in the file named."""

    geotag: Geotag
    path: Path
    warning: str = ""
    """Why it is not in the log but waits beside it; empty when it is in the log."""


class GeotagLog:
    """Appends geotags to a GeoPackage. Every call opens the file anew, so a file that was moved or replaced is noticed.

    A geotag that the log cannot take now is kept beside it and goes into the log with the next one that it takes.

    Args:
        path: of the GeoPackage; made, with its folders, at the first use.
        busy_timeout_s: how long to wait for another program that is reading or writing the file.
    """

    def __init__(self, path: Path, *, busy_timeout_s: float = 1.0) -> None:
        self.path = path
        self._spool = GeotagSpool(path)
        self._busy_timeout_s = busy_timeout_s
        self._highest = 0

    def prepare(self) -> None:
        """Make the file if it is not there and see that it takes a geotag: before the flight, not after it.

        What waits beside the log goes into it.

        Raises:
            AnswerError: it cannot be written, or does not take a geotag.
        """
        clean_drafts(self.path.parent)
        with _named(self.path), self._transaction(self.path) as connection:
            self._highest = max(self._highest, _highest(connection))
            self._try(connection)
        with _named(self._spool.folder):
            self._spool.prepare(self._highest)
        self.merge()

    def numbered(self, geotag: Geotag) -> Geotag:
        """With the number that it will have in the log; none is ever given twice, also when an older log is put back.

        Quick: the log itself, which another program may hold, is not asked.
        """
        return replace(geotag, number=self._spool.claim(self._highest))

    def append(self, geotag: Geotag) -> Logged:
        """Log a geotag; when this returns, it is on the disk: in the log, or beside it until the log can take it.

        Raises:
            AnswerError: it is in the log already, or it could be written to neither place; the log is as it was.
        """
        if geotag.number == 0:
            self._look()
            geotag = self.numbered(geotag)
        try:
            logged = self._append(geotag)
        except AlreadyLogged:
            raise
        except AnswerError as error:
            _log.warning("%s", error)
            try:
                return Logged(geotag, self._spool.put(geotag), str(error))
            except AnswerError as second:
                raise AnswerError(f"{error.cause}; and {second.cause}", error.remedy) from second
        self.merge()
        return logged

    def merge(self) -> int:
        """Put what waits beside the log into it, as far as the log takes it now; how many still wait."""
        left = 0
        for path, geotag in self._spool.waiting():
            try:
                self._append(geotag)
            except AlreadyLogged:
                _log.info("%s is in the log", path)
            except AnswerError as error:
                _log.warning("%s still waits: %s", path, error)
                left += 1
                continue
            try:
                self._spool.logged(path)
            except OSError as error:
                _log.warning("%s is in the log and cannot be removed: %s", path, error)
        return left

    def read(self) -> list[Geotag]:
        """All geotags of the log, oldest first; none when the file is not there yet.

        Raises:
            AnswerError: the file cannot be read.
        """
        return read_geotags(self.path, busy_timeout_s=self._busy_timeout_s) if self.path.exists() else []

    def _look(self) -> None:
        """Learn the highest number in the log, where it can be read."""
        try:
            if self.path.exists():
                with _named(self.path, "read"), _opened(self.path, self._busy_timeout_s) as connection:
                    self._highest = max(self._highest, _highest(connection))
        except AnswerError as error:
            _log.info("%s", error)

    def _append(self, geotag: Geotag) -> Logged:
        with _named(self.path), self._transaction(self.path) as connection:
            if _has(connection, "id", geotag.id):
                raise AlreadyLogged(f"The geotag is in {self.path} already")
            if _has(connection, "fid", geotag.number):  # somebody wrote rows of their own into the log
                self._highest = max(self._highest, _highest(connection))
                before, geotag = geotag.number, self.numbered(geotag)
                _log.warning("the log has another geotag %d: this one is number %d", before, geotag.number)
            _insert(connection, geotag)
        self._highest = max(self._highest, geotag.number)
        return Logged(geotag, self.path)

    def _try(self, connection: sqlite3.Connection) -> None:
        """Append a geotag and take it back: triggers, columns and constraints that others added show themselves."""
        connection.execute("SAVEPOINT trial")
        _insert(connection, _trial(self._highest + 1))
        connection.execute("ROLLBACK TO trial")
        connection.execute("RELEASE trial")

    @contextmanager
    def _transaction(self, path: Path) -> Iterator[sqlite3.Connection]:
        """A durable write: committed at the end, or undone."""
        if not path.exists():
            make_folder(path.parent)
            try:
                kinds = {column.name: column.kind for column in COLUMNS}
                geopackage.create(path, LAYER, "Targets located by Sidestep", kinds)
            except FileExistsError:
                _log.info("%s was made by another process meanwhile", path)
        with _opened(path, self._busy_timeout_s) as connection:
            connection.execute("BEGIN IMMEDIATE")
            _check_columns(connection, path)
            yield connection
            connection.execute("COMMIT")


def read_geotags(
    path: Path, *, busy_timeout_s: float = 1.0, told: Callable[[str], None] = _log.warning
) -> list[Geotag]:
    """All geotags of a log, and those that wait beside it, lowest number first.

    Args:
        path: of the log.
        busy_timeout_s: how long to wait for another program that is writing it.
        told: is told of a row that is no geotag (any more), which is left out.

    Raises:
        AnswerError: it is not there, cannot be read or is no log of geotags.
    """
    if not path.is_file():
        raise AnswerError(f"There is no geotag log {path}", "Check the path.")
    with _named(path, "read"), _opened(path, busy_timeout_s) as connection:
        _check_columns(connection, path)
        connection.row_factory = sqlite3.Row
        rows = [dict(each) for each in connection.execute(f"SELECT * FROM {LAYER} ORDER BY fid")]
    found = []
    for each in rows:
        try:
            found.append(geotag_of_row(each, each["fid"]))
        except ValueError as error:
            told(f"row {each['fid']} of the geotag log {path} is no geotag and is left out: {error}")
    names = {geotag.id for geotag in found}
    waiting = [geotag for _, geotag in GeotagSpool(path).waiting() if geotag.id not in names]
    return sorted([*found, *waiting], key=lambda geotag: geotag.number)


@contextmanager
def _opened(path: Path, busy_timeout_s: float) -> Iterator[sqlite3.Connection]:
    """Closed at the end, which undoes what was not committed."""
    connection = geopackage.connect(path, busy_timeout_s=busy_timeout_s)
    try:
        yield connection
    finally:
        connection.close()


def _insert(connection: sqlite3.Connection, geotag: Geotag) -> None:
    geometry = geopackage.point(geotag.place.lon_deg, geotag.place.lat_deg, geotag.ellipsoid_height_m)
    connection.execute(_INSERT, [geotag.number, geometry, *row(geotag).values()])
    connection.execute(_EXTENT, {"x": geotag.place.lon_deg, "y": geotag.place.lat_deg, "layer": LAYER})


def _has(connection: sqlite3.Connection, column: str, value: str | int) -> bool:
    (rows,) = connection.execute(f"SELECT count(*) FROM {LAYER} WHERE {column} = ?", [value]).fetchone()
    return bool(rows)


def _highest(connection: sqlite3.Connection) -> int:
    """The highest number that the log has given away; rows that were deleted count."""
    (number,) = connection.execute(
        f"SELECT max(coalesce((SELECT max(fid) FROM {LAYER}), 0),"
        " coalesce((SELECT max(seq) FROM sqlite_sequence WHERE name = ?), 0))",
        [LAYER],
    ).fetchone()
    return int(number)


def _trial(number: int) -> Geotag:
    """A geotag for a trial, which nobody ever sees."""
    nothing = (0.0,) * 6
    return Geotag(
        id=f"trial-{uuid.uuid4().hex}",
        time_utc=datetime(2000, 1, 1, tzinfo=UTC),
        place=Geodetic(0.0, 0.0, 0.0, "ellipsoid"),
        covariance=((1.0, *nothing[1:]), (0.0, 1.0, *nothing[2:]), *(nothing,) * 4),
        velocity_enu_m_s=None,
        method="trial",
        model="trial",
        depth_m=0.0,
        sightings=0,
        rejected=0,
        chi2=None,
        dof=None,
        drone=None,
        provenance=Provenance("trial", "trial"),
        number=number,
    )


def _check_columns(connection: sqlite3.Connection, path: Path) -> None:
    there = {str(row[1]) for row in connection.execute(f"PRAGMA table_info({LAYER})")}
    if missing := {column.name for column in COLUMNS} - there:
        raise AnswerError(
            f"{path} is a GeoPackage, but not a log of this program (no column {min(missing)} in the layer {LAYER})",
            "Give another file name; this one is left as it is.",
        )


@contextmanager
def _named(path: Path, verb: str = "written") -> Iterator[None]:
    """Says in an operator's words what SQLite and the operating system say in theirs."""
    try:
        yield
    except sqlite3.Error as error:
        why, remedy = _REASONS.get(getattr(error, "sqlite_errorcode", 0) & 0xFF, (str(error), "Check disk and file."))
        raise AnswerError(f"The geotag log {path} cannot be {verb}: {why}", remedy) from error
    except OSError as error:
        raise AnswerError(
            f"The geotag log {path} cannot be {verb}: {error.strerror or error}",
            "Free some space, check the permissions, or name another folder.",
        ) from error


_REASONS: Final = {
    sqlite3.SQLITE_FULL: ("the disk is full", "Free some space or name another folder; earlier geotags are safe."),
    sqlite3.SQLITE_IOERR: ("the disk refuses", "Check the disk or name another folder; earlier geotags are safe."),
    sqlite3.SQLITE_BUSY: ("another program holds it", "Close it there (QGIS: stop editing) and try again."),
    sqlite3.SQLITE_LOCKED: ("another program holds it", "Close it there (QGIS: stop editing) and try again."),
    sqlite3.SQLITE_READONLY: ("it is write-protected", "Change its permissions or name another file."),
    sqlite3.SQLITE_CANTOPEN: ("it cannot be opened", "Check that it is a file and its permissions."),
    sqlite3.SQLITE_PERM: ("the permissions forbid it", "Change its permissions or name another file."),
    sqlite3.SQLITE_NOTADB: ("it is no GeoPackage", "Give another file name; this one is left as it is."),
    sqlite3.SQLITE_CORRUPT: ("it is damaged", "Give another file name, and restore this one from a copy."),
}
