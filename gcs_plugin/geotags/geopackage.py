"""An OGC GeoPackage 1.3 (OGC 12-128r18) with one layer of points, through the standard library's SQLite.

The layer is in EPSG:4979 (latitude, longitude, ellipsoid height): a point carries its height only where the ellipsoid
height is known, so that what a GIS reads as z is what the coordinate reference system says it is.

What is committed is on the disk: a rollback journal with `synchronous = EXTRA` flushes the file, the journal and the
folder at every commit. A GIS that opened the file may have switched it to a write-ahead log, which is flushed likewise.
"""

from __future__ import annotations

import errno
import math
import os
import sqlite3
import struct
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from pyproj import CRS

from gcs_plugin.durable import sync
from mission.errors import AnswerError

APPLICATION_ID: Final = 0x47504B47  # "GPKG", requirement 2
USER_VERSION: Final = 10300
SRS_ID: Final = 4979

# Tables of annex C; `definition_12_063` is the extension gpkg_crs_wkt (annex F.10), which a 3D reference system needs.
SCHEMA: Final = """
CREATE TABLE gpkg_spatial_ref_sys (
  srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT,
  definition_12_063 TEXT NOT NULL);
CREATE TABLE gpkg_contents (
  table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, description TEXT DEFAULT '',
  last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')),
  min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
  CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
  table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL,
  z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name), CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE gpkg_extensions (
  table_name TEXT, column_name TEXT, extension_name TEXT NOT NULL, definition TEXT NOT NULL, scope TEXT NOT NULL,
  CONSTRAINT ge_tce UNIQUE (table_name, column_name, extension_name));
INSERT INTO gpkg_extensions VALUES ('gpkg_spatial_ref_sys', 'definition_12_063', 'gpkg_crs_wkt',
  'http://www.geopackage.org/spec130/#extension_crs_wkt', 'read-write');
"""


def create(path: Path, layer: str, description: str, columns: Mapping[str, str]) -> None:
    """Make a GeoPackage with one empty layer of points; whole or not there at all, and durable on return.

    Args:
        path: must not exist; its folder must.
        layer: name of the table and of the layer.
        description: shown by a GIS.
        columns: SQL type of each column beside `fid` (the key) and `geom` (the point).

    Raises:
        FileExistsError: somebody else made the file meanwhile.
        OSError: the folder cannot be written.
        sqlite3.Error: the disk is full.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.new")
    draft.unlink(missing_ok=True)
    try:
        connection = sqlite3.connect(draft, isolation_level=None)
        try:
            connection.execute("PRAGMA journal_mode = MEMORY")  # a draft needs no journal: it is renamed when whole
            connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            connection.execute(f"PRAGMA user_version = {USER_VERSION}")
            connection.execute("BEGIN")
            for statement in SCHEMA.split(";\n"):
                connection.execute(statement)
            connection.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?, ?)", reference_systems())
            fields = "".join(f', "{name}" {kind}' for name, kind in columns.items())
            connection.execute(
                f'CREATE TABLE "{layer}" (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POINT{fields})'
            )
            connection.execute(
                "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, srs_id)"
                " VALUES (?, 'features', ?, ?, ?)",
                (layer, layer, description, SRS_ID),
            )
            # z = 2: a height is optional.
            connection.execute(
                "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', 'POINT', ?, 2, 0)", (layer, SRS_ID)
            )
            connection.execute("COMMIT")
        finally:
            connection.close()
        sync(draft)
        _name_once(draft, path)
    finally:
        draft.unlink(missing_ok=True)
    sync(path.parent)


def connect(path: Path, *, busy_timeout_s: float) -> sqlite3.Connection:
    """Open an existing GeoPackage for durable writes (reads only, where the file is write-protected).

    A journal that a killed writer left is rolled back here.

    Raises:
        sqlite3.Error: it cannot be opened, or is no database.
        AnswerError: it is a database of another kind.
    """
    connection = sqlite3.connect(
        f"{path.resolve().as_uri()}?mode=rw",
        uri=True,
        timeout=busy_timeout_s,
        isolation_level=None,
        check_same_thread=False,
    )
    try:
        (application_id,) = connection.execute("PRAGMA application_id").fetchone()
        if application_id != APPLICATION_ID:
            raise AnswerError(f"{path} is not a GeoPackage", "Give another file name; this one is left as it is.")
        connection.execute("PRAGMA synchronous = EXTRA")
        connection.execute("PRAGMA foreign_keys = ON")
        connection.text_factory = _text
        for name, function in _GEOMETRY_FUNCTIONS.items():
            connection.create_function(name, 1, function, deterministic=True)
    except BaseException:
        connection.close()
        raise
    return connection


def point(lon_deg: float, lat_deg: float, ellipsoid_height_m: float | None) -> bytes:
    """A point in GeoPackage binary format (clause 2.1.3): header without envelope, then ISO WKB; little endian."""
    header = struct.pack("<2sBBi", b"GP", 0, 0b0000_0001, SRS_ID)
    if ellipsoid_height_m is None:
        return header + struct.pack("<BIdd", 1, 1, lon_deg, lat_deg)
    return header + struct.pack("<BIddd", 1, 1001, lon_deg, lat_deg, ellipsoid_height_m)


def position(geometry: bytes) -> tuple[float, float] | None:
    """Longitude and latitude (degrees) of a point in GeoPackage binary format; None of an empty or another geometry.

    Raises:
        ValueError: it is no geometry of a GeoPackage.
    """
    if len(geometry) < 8 or geometry[:2] != b"GP":
        raise ValueError("no GeoPackage geometry")
    envelope = {0: 0, 1: 32, 2: 48, 3: 48, 4: 64}.get(geometry[3] >> 1 & 0b111)
    if envelope is None:
        raise ValueError("no GeoPackage geometry")
    wkb = geometry[8 + envelope :]
    if len(wkb) < 5:
        raise ValueError("a geometry without its end")
    order = "<" if wkb[0] else ">"
    (kind,) = struct.unpack_from(f"{order}I", wkb, 1)
    if kind % 1000 != 1:
        return None
    if len(wkb) < 21:
        raise ValueError("a geometry without its end")
    x, y = struct.unpack_from(f"{order}dd", wkb, 5)
    return None if math.isnan(x) or math.isnan(y) else (x, y)


def _bound(axis: int) -> Callable[[bytes | None], float | None]:
    def of(geometry: bytes | None) -> float | None:
        found = None if geometry is None else position(geometry)
        return None if found is None else found[axis]

    return of


def _is_empty(geometry: bytes | None) -> int | None:
    return None if geometry is None else int(position(geometry) is None)


# What the triggers of a spatial index call (annex F.3, extension gpkg_rtree_index), which a GIS may have added.
_GEOMETRY_FUNCTIONS: Final[dict[str, Callable[[bytes | None], float | None]]] = {
    "ST_IsEmpty": _is_empty,
    "ST_MinX": _bound(0),
    "ST_MaxX": _bound(0),
    "ST_MinY": _bound(1),
    "ST_MaxY": _bound(1),
}


def _text(content: bytes) -> str:
    """A text that another program spoilt costs its cell, not the whole reading."""
    return content.decode("utf-8", "backslashreplace")


def _name_once(draft: Path, path: Path) -> None:
    """Give the finished draft its name without ever replacing a file that another process made meanwhile."""
    try:
        os.link(draft, path)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS):
            raise
        if path.exists():  # a file system without hard links (FAT): the check and the rename are two steps
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from error
        draft.rename(path)


def reference_systems() -> list[tuple[str, int, str, int, str, str, str]]:
    """Requirement 11's three, and the layer's own."""
    flat, solid = CRS.from_epsg(4326), CRS.from_epsg(SRS_ID)
    wkt2 = "WKT2_2015"  # OGC 12-063
    return [
        ("Undefined Cartesian SRS", -1, "NONE", -1, "undefined", "undefined Cartesian reference system", "undefined"),
        ("Undefined geographic SRS", 0, "NONE", 0, "undefined", "undefined geographic reference system", "undefined"),
        ("WGS 84", 4326, "EPSG", 4326, flat.to_wkt("WKT1_GDAL"), "latitude and longitude", flat.to_wkt(wkt2)),
        # WKT 1 cannot say it.
        ("WGS 84 (3D)", SRS_ID, "EPSG", SRS_ID, "undefined", "with ellipsoid height", solid.to_wkt(wkt2)),
    ]
