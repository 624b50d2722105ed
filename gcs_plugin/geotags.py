"""The log of geotags: a GeoPackage that QGIS and GDAL open, in which an acknowledged geotag survives `kill -9`.

A full disk, a power cut or a kill in the middle of an append leaves the file as it was before it: SQLite's rollback
journal undoes the half, at once or when the file is next opened.
"""

from __future__ import annotations

import json
import logging
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Final, get_args

from gcs_plugin import geopackage
from gcs_plugin.durable import make_folder
from gcs_plugin.geotag import COLUMNS, Geotag, Provenance, make_geotag, row
from mission.errors import AnswerError
from mission.geodesy import Geodetic
from mission.records import Datum

__all__ = ["Geotag", "GeotagLog", "Logged", "Provenance", "make_geotag", "read_geotags"]

LAYER: Final = "geotags"
_INSERT: Final = (
    f"INSERT INTO {LAYER} (geom, {', '.join(column.name for column in COLUMNS)}) VALUES (?{', ?' * len(COLUMNS)})"
)
_EXTENT: Final = (
    "UPDATE gpkg_contents SET last_change = strftime('%Y-%m-%dT%H:%M:%fZ', 'now'),"
    " min_x = min(coalesce(min_x, :x), :x), max_x = max(coalesce(max_x, :x), :x),"
    " min_y = min(coalesce(min_y, :y), :y), max_y = max(coalesce(max_y, :y), :y) WHERE table_name = :layer"
)

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Logged:
    """An acknowledged geotag: on the disk, numbered, in the file named."""

    geotag: Geotag
    path: Path
    warning: str = ""
    """Why it went to the fallback folder; empty when it did not."""


class GeotagLog:
    """Appends geotags to a GeoPackage. Every call opens the file anew, so a file that was moved or replaced is noticed.

    Args:
        path: of the GeoPackage; made, with its folders, at the first use.
        fallback: a folder, best on another disk, for geotags that cannot be written to `path`.
        busy_timeout_s: how long to wait for another program that is reading or writing the file.
    """

    def __init__(self, path: Path, *, fallback: Path | None = None, busy_timeout_s: float = 1.0) -> None:
        self.path = path
        self.fallback = None if fallback is None else fallback / path.name
        self._busy_timeout_s = busy_timeout_s

    def prepare(self) -> None:
        """Make the file if it is not there and see that it can be written: before the flight, not after it.

        Raises:
            AnswerError: it cannot.
        """
        with _named(self.path), self._transaction(self.path):
            pass

    def append(self, geotag: Geotag) -> Logged:
        """Log a geotag; when this returns, it is on the disk.

        Raises:
            AnswerError: it could be written neither to the log nor to the fallback folder; the log is as it was.
        """
        try:
            return self._append(geotag, self.path)
        except AnswerError as error:
            if self.fallback is None:
                raise
            _log.warning("%s", error)
            try:
                return replace(self._append(geotag, self.fallback), warning=str(error))
            except AnswerError as second:
                raise AnswerError(f"{error.cause}; and {second.cause}", error.remedy) from second

    def read(self) -> list[Geotag]:
        """All geotags of the log, oldest first; none when the file is not there yet.

        Raises:
            AnswerError: the file cannot be read.
        """
        return read_geotags(self.path, busy_timeout_s=self._busy_timeout_s) if self.path.exists() else []

    def _append(self, geotag: Geotag, path: Path) -> Logged:
        cells = row(geotag).values()
        geometry = geopackage.point(geotag.place.lon_deg, geotag.place.lat_deg, geotag.ellipsoid_height_m)
        with _named(path), self._transaction(path) as connection:
            number = connection.execute(_INSERT, [geometry, *cells]).lastrowid
            extent = {"x": geotag.place.lon_deg, "y": geotag.place.lat_deg, "layer": LAYER}
            connection.execute(_EXTENT, extent)
        return Logged(replace(geotag, number=number or 0), path)

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
        connection = geopackage.connect(path, busy_timeout_s=self._busy_timeout_s)
        try:
            connection.execute("BEGIN IMMEDIATE")
            _check_columns(connection, path)
            yield connection
            connection.execute("COMMIT")
        finally:
            connection.close()  # undoes what was not committed


def read_geotags(path: Path, *, busy_timeout_s: float = 1.0) -> list[Geotag]:
    """All geotags of a log, oldest first.

    Raises:
        AnswerError: it is not there, cannot be read or is no log of geotags.
    """
    if not path.is_file():
        raise AnswerError(f"There is no geotag log {path}", "Check the path.")
    with _named(path, "read"):
        connection = geopackage.connect(path, busy_timeout_s=busy_timeout_s)
        try:
            _check_columns(connection, path)
            connection.row_factory = sqlite3.Row
            found = connection.execute(f"SELECT * FROM {LAYER} ORDER BY fid").fetchall()
        finally:
            connection.close()
        return [_geotag(each) for each in found]


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
        if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_CONSTRAINT_UNIQUE:
            raise AnswerError(f"The geotag is in {path} already") from error
        why, remedy = _REASONS.get(getattr(error, "sqlite_errorcode", 0) & 0xFF, (str(error), "Check disk and file."))
        raise AnswerError(f"The geotag log {path} cannot be {verb}: {why}", remedy) from error
    except OSError as error:
        raise AnswerError(
            f"The geotag log {path} cannot be {verb}: {error.strerror or error}",
            "Free some space, check the permissions, or name another folder.",
        ) from error
    except (ValueError, TypeError, KeyError) as error:
        raise AnswerError(f"The geotag log {path} holds a row that is no geotag: {error}", "Restore a copy.") from error


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


def _geotag(found: sqlite3.Row) -> Geotag:
    def place(prefix: str = "") -> Geodetic | None:
        if found[f"{prefix}lat_deg"] is None:
            return None
        datum: Datum = found[f"{prefix}alt_datum"]
        if datum not in get_args(Datum):
            raise ValueError(f"unknown datum {datum!r}")
        return Geodetic(found[f"{prefix}lat_deg"], found[f"{prefix}lon_deg"], found[f"{prefix}alt_m"], datum)

    target = place()
    if target is None:
        raise ValueError(f"geotag {found['fid']} has no place")
    east, north, up = found["velocity_east_m_s"], found["velocity_north_m_s"], found["velocity_up_m_s"]
    return Geotag(
        id=found["id"],
        time_utc=datetime.fromisoformat(found["time_utc"]),
        place=target,
        covariance=tuple((a, b, c, d, e, f) for a, b, c, d, e, f in json.loads(found["covariance_enu"])),
        velocity_enu_m_s=None if east is None else (east, north, up),
        method=found["method"],
        model=found["model"],
        depth_m=found["depth_m"],
        sightings=found["sightings"],
        rejected=found["rejected"],
        chi2=found["chi2"],
        dof=found["dof"],
        drone=place("drone_"),
        provenance=Provenance(
            software=found["software"],
            flight_id=found["flight_id"],
            sightings_file=found["sightings_file"],
            video=found["video"],
            link=found["link"],
            choice=found["choice"],
            noise_preset=found["noise_preset"],
        ),
        geoid_separation_m=found["geoid_separation_m"],
        notes=tuple(json.loads(found["notes"])),
        picture=found["picture"] or b"",
        number=found["fid"],
    )
