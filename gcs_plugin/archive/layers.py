"""A GeoPackage of several layers, written in one go: the same content gives the same bytes."""

from __future__ import annotations

import os
import sqlite3
import struct
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from gcs_plugin.durable import sync, unwritable
from gcs_plugin.geotags.geopackage import APPLICATION_ID, SCHEMA, SRS_ID, USER_VERSION, point, reference_systems

Shape = Literal["POINT", "POLYGON", "LINESTRING"]
Cell = str | float | int | None
Corner = tuple[float, float]
"""Longitude and latitude, degrees."""
_CODES: Final[dict[Shape, int]] = {"POINT": 1, "LINESTRING": 2, "POLYGON": 3}


@dataclass(frozen=True, slots=True)
class Feature:
    """One row of a layer."""

    corners: tuple[Corner, ...]
    """One for a point; a polygon's outline, not closed."""
    cells: tuple[Cell, ...]
    height_m: float | None = None
    """Of a point, above the ellipsoid."""


@dataclass(frozen=True, slots=True)
class Layer:
    """A table of features; an EMPTY layer is written, too, so that every file has the same ones."""

    name: str
    description: str
    shape: Shape
    columns: tuple[tuple[str, str], ...]
    """Name and SQL type."""
    features: Sequence[Feature]


def write_layers(path: Path, layers: Iterable[Layer], changed_utc: str) -> None:
    """Write a GeoPackage, whole or not at all.

    Args:
        path: replaced where it is there.
        layers: in their order.
        changed_utc: ISO 8601 with Z: when the content is from.

    Raises:
        AnswerError: it cannot be written.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.new")
    try:
        draft.unlink(missing_ok=True)
        try:
            connection = sqlite3.connect(draft, isolation_level=None)
            try:
                connection.execute("PRAGMA journal_mode = MEMORY")
                connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                connection.execute(f"PRAGMA user_version = {USER_VERSION}")
                connection.execute("BEGIN")
                for statement in SCHEMA.split(";\n"):
                    connection.execute(statement)
                connection.executemany(
                    "INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?, ?)", reference_systems()
                )
                for layer in layers:
                    _write(connection, layer, changed_utc)
                connection.execute("COMMIT")
            finally:
                connection.close()
            sync(draft)
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)
        sync(path.parent)
    except OSError as error:
        raise unwritable(path, error) from error
    except sqlite3.Error as error:
        raise unwritable(path, OSError(0, str(error))) from error


def _write(connection: sqlite3.Connection, layer: Layer, changed_utc: str) -> None:
    fields = "".join(f', "{name}" {kind}' for name, kind in layer.columns)
    connection.execute(
        f'CREATE TABLE "{layer.name}" (fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom {layer.shape}{fields})'
    )
    corners = [corner for feature in layer.features for corner in feature.corners]
    box: tuple[float | None, ...] = (None, None, None, None)
    if corners:
        lon, lat = [c[0] for c in corners], [c[1] for c in corners]
        box = min(lon), min(lat), max(lon), max(lat)
    connection.execute(
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, description, last_change, min_x, min_y, max_x,"
        " max_y, srs_id) VALUES (?, 'features', ?, ?, ?, ?, ?, ?, ?, ?)",
        (layer.name, layer.name, layer.description, changed_utc, *box, SRS_ID),
    )
    connection.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, 2, 0)", (layer.name, layer.shape, SRS_ID)
    )
    holes = ", ".join("?" * (len(layer.columns) + 1))
    names = ", ".join(f'"{name}"' for name, _ in layer.columns)
    connection.executemany(
        f'INSERT INTO "{layer.name}" (geom, {names}) VALUES ({holes})',
        ((geometry(layer.shape, feature), *feature.cells) for feature in layer.features),
    )


def geometry(shape: Shape, feature: Feature) -> bytes:
    """GeoPackage binary (clause 2.1.3), little endian, without envelope."""
    if shape == "POINT":
        (lon, lat) = feature.corners[0]
        return point(lon, lat, feature.height_m)
    corners = feature.corners if shape == "LINESTRING" else (*feature.corners, feature.corners[0])
    body = struct.pack("<I", len(corners)) + b"".join(struct.pack("<dd", *corner) for corner in corners)
    rings = struct.pack("<I", 1) if shape == "POLYGON" else b""
    header = struct.pack("<2sBBi", b"GP", 0, 0b0000_0001, SRS_ID)
    return header + struct.pack("<BI", 1, _CODES[shape]) + rings + body
