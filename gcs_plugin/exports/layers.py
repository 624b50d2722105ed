"""Geotags as a GeoPackage for GIS programs: layers of targets, ellipses and ways, with styles and pictures.

The program's own log (`gcs_plugin.geotags.log`) has one table, so that appending to it is one small write; this is the
copy for people: layers look right in QGIS as they are (`layer_styles`), and pictures are a related table (OGC 18-000).
"""

from __future__ import annotations

import sqlite3
import struct
import tempfile
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

from gcs_plugin.geotags import geopackage
from gcs_plugin.geotags.geotag import COLUMNS, Geotag, row
from gcs_plugin.geotags.outline import Ring, ellipse_rings, velocity_arrow
from gcs_plugin.geotags.words import moves, name_of

TARGETS, ELLIPSES, WAYS, PICTURES = "targets", "ellipses", "ways", "pictures"
_LINK: Final = "targets_pictures"
_FLAT: Final = 4326
_COLUMNS: Final = {"name": "TEXT NOT NULL", **{c.name: c.kind for c in COLUMNS if c.name != "picture"}}
_SPEC: Final = "http://docs.opengeospatial.org/is/18-000/18-000.html"
_MEDIA: Final = f"""
CREATE TABLE {PICTURES} (id INTEGER PRIMARY KEY AUTOINCREMENT, data BLOB NOT NULL, content_type TEXT NOT NULL);
CREATE TABLE {_LINK} (base_id INTEGER NOT NULL, related_id INTEGER NOT NULL);
CREATE TABLE gpkgext_relations (
  id INTEGER PRIMARY KEY AUTOINCREMENT, base_table_name TEXT NOT NULL,
  base_primary_column TEXT NOT NULL DEFAULT 'id', related_table_name TEXT NOT NULL,
  related_primary_column TEXT NOT NULL DEFAULT 'id', relation_name TEXT NOT NULL,
  mapping_table_name TEXT NOT NULL UNIQUE);
INSERT INTO gpkg_contents (table_name, data_type, identifier, description)
  VALUES ('{PICTURES}', 'attributes', '{PICTURES}', 'The targets in the video');
INSERT INTO gpkgext_relations VALUES (1, '{TARGETS}', 'fid', '{PICTURES}', 'id', 'media', '{_LINK}');
INSERT INTO gpkg_extensions VALUES ('gpkgext_relations', NULL, 'gpkg_related_tables', '{_SPEC}', 'read-write');
INSERT INTO gpkg_extensions VALUES ('{_LINK}', NULL, 'gpkg_related_tables', '{_SPEC}', 'read-write');
"""
# What QGIS makes for itself when a style is saved into a database.
_STYLES: Final = """
CREATE TABLE layer_styles (
  id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, f_table_catalog TEXT(256), f_table_schema TEXT(256),
  f_table_name TEXT(256), f_geometry_column TEXT(256), styleName TEXT(30), styleQML TEXT, styleSLD TEXT,
  useAsDefault BOOLEAN, description TEXT, owner TEXT(30), ui TEXT(30),
  update_time DATETIME DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')));
INSERT INTO gpkg_contents (table_name, data_type, identifier) VALUES ('layer_styles', 'attributes', 'layer_styles');
"""


def to_geopackage(geotags: Sequence[Geotag]) -> bytes:
    """The file's bytes."""
    with tempfile.TemporaryDirectory(prefix="sidestep-") as folder:
        path = Path(folder) / "targets.gpkg"
        geopackage.create(path, TARGETS, "Targets located by Sidestep", _COLUMNS)
        connection = sqlite3.connect(path)
        try:
            with connection:
                for layer, kind in ((ELLIPSES, "MULTIPOLYGON"), (WAYS, "LINESTRING")):
                    _add_layer(connection, layer, kind)
                connection.executescript(_MEDIA)
                connection.executescript(_STYLES)
                for layer in (TARGETS, ELLIPSES, WAYS):
                    _add_style(connection, layer)
                for index, geotag in enumerate(geotags, 1):
                    _add(connection, geotag.number or index, geotag)
                for layer, rings in _extents(geotags).items():
                    _set_extent(connection, layer, rings)
        finally:
            connection.close()
        return path.read_bytes()


def _add_layer(connection: sqlite3.Connection, layer: str, kind: str) -> None:
    connection.execute(
        f"CREATE TABLE {layer} (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom {kind}, target INTEGER NOT NULL,"
        " name TEXT NOT NULL, time_utc DATETIME NOT NULL, ce90_m DOUBLE NOT NULL, speed_m_s DOUBLE)"
    )
    connection.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES (?, 'features', ?, ?)",
        (layer, layer, _FLAT),
    )
    connection.execute("INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, 0, 0)", (layer, kind, _FLAT))


def _add_style(connection: sqlite3.Connection, layer: str) -> None:
    qml = files("gcs_plugin").joinpath("data", f"{layer}.qml").read_text(encoding="utf-8")
    connection.execute(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName,"
        " styleQML, styleSLD, useAsDefault, description, owner) VALUES ('', '', ?, 'geom', ?, ?, '', 1, '', '')",
        (layer, layer, qml),
    )


def _add(connection: sqlite3.Connection, number: int, geotag: Geotag) -> None:
    cells = {"name": name_of(geotag), **{name: cell for name, cell in row(geotag).items() if name != "picture"}}
    marks = ", ".join("?" * (2 + len(cells)))
    geometry = geopackage.point(geotag.place.lon_deg, geotag.place.lat_deg, geotag.ellipsoid_height_m)
    connection.execute(
        f"INSERT INTO {TARGETS} (fid, geom, {', '.join(cells)}) VALUES ({marks})", [number, geometry, *cells.values()]
    )
    common = [number, cells["name"], cells["time_utc"], geotag.ce90_m, geotag.speed_m_s]
    insert = "INSERT INTO {} (geom, target, name, time_utc, ce90_m, speed_m_s) VALUES (?, ?, ?, ?, ?, ?)"
    connection.execute(insert.format(ELLIPSES), [_multi_polygon(ellipse_rings(geotag)), *common])
    arrow = velocity_arrow(geotag) if moves(geotag) else None
    if arrow is not None:
        connection.execute(insert.format(WAYS), [_header() + _line(arrow[:2]), *common])
    if geotag.picture:
        media = "INSERT INTO pictures (data, content_type) VALUES (?, ?)"
        related = connection.execute(media, [geotag.picture, geotag.picture_type]).lastrowid
        connection.execute(f"INSERT INTO {_LINK} VALUES (?, ?)", [number, related])


def _extents(geotags: Sequence[Geotag]) -> Mapping[str, Sequence[Ring]]:
    arrows = [velocity_arrow(geotag) if moves(geotag) else None for geotag in geotags]
    return {
        TARGETS: [[(geotag.place.lon_deg, geotag.place.lat_deg)] for geotag in geotags],
        ELLIPSES: [ring for geotag in geotags for ring in ellipse_rings(geotag)],
        WAYS: [arrow[:2] for arrow in arrows if arrow is not None],
    }


def _set_extent(connection: sqlite3.Connection, layer: str, rings: Sequence[Ring]) -> None:
    positions = [position for ring in rings for position in ring]
    if positions:
        lon, lat = [p[0] for p in positions], [p[1] for p in positions]
        connection.execute(
            "UPDATE gpkg_contents SET min_x = ?, min_y = ?, max_x = ?, max_y = ? WHERE table_name = ?",
            [min(lon), min(lat), max(lon), max(lat), layer],
        )


def _header() -> bytes:
    """Clause 2.1.3: little endian, no envelope."""
    return struct.pack("<2sBBi", b"GP", 0, 0b0000_0001, _FLAT)


def _line(positions: Ring) -> bytes:
    points = b"".join(struct.pack("<dd", p[0], p[1]) for p in positions)
    return struct.pack("<BII", 1, 2, len(positions)) + points


def _multi_polygon(rings: Sequence[Ring]) -> bytes:
    polygons = b"".join(
        struct.pack("<BIII", 1, 3, 1, len(ring)) + b"".join(struct.pack("<dd", p[0], p[1]) for p in ring)
        for ring in rings
    )
    return _header() + struct.pack("<BII", 1, 6, len(rings)) + polygons
