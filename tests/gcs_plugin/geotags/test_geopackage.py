"""The file follows the GeoPackage rules (OGC 12-128r18; the requirement's number is in each test)."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from pyproj import CRS

from gcs_plugin.geotags import geopackage
from gcs_plugin.geotags.log import GeotagLog
from mission.errors import AnswerError
from tests.support.sample import geotag, jpeg, origin


@pytest.fixture
def log(tmp_path: Path) -> Iterator[sqlite3.Connection]:
    path = tmp_path / "log.gpkg"
    tags = GeotagLog(path)
    tags.append(geotag("a", picture=jpeg()))
    tags.append(geotag("b", at=origin("amsl"), geoid_separation_m=None))
    connection = sqlite3.connect(path)
    yield connection
    connection.close()


def test_header_and_integrity(log: sqlite3.Connection, tmp_path: Path) -> None:
    raw = (tmp_path / "log.gpkg").read_bytes()
    assert raw[:16] == b"SQLite format 3\x00"  # requirement 1
    assert raw[68:72] == b"GPKG"  # requirement 2
    assert int.from_bytes(raw[60:64], "big") == 10300
    assert log.execute("PRAGMA integrity_check").fetchall() == [("ok",)]  # requirement 6
    assert log.execute("PRAGMA foreign_key_check").fetchall() == []  # requirement 7


def test_reference_systems_are_the_three_required_and_the_layers_own(log: sqlite3.Connection) -> None:
    rows = {
        row[0]: row[1:]
        for row in log.execute(
            "SELECT srs_id, organization, organization_coordsys_id, definition, definition_12_063"
            " FROM gpkg_spatial_ref_sys"
        )
    }
    assert set(rows) == {-1, 0, 4326, 4979}  # requirement 11
    assert rows[-1] == ("NONE", -1, "undefined", "undefined")
    assert rows[0] == ("NONE", 0, "undefined", "undefined")
    assert CRS.from_wkt(rows[4326][2]).to_epsg() == 4326
    assert CRS.from_wkt(rows[4979][3]).to_epsg() == 4979
    assert log.execute("SELECT table_name, column_name, extension_name, scope FROM gpkg_extensions").fetchall() == [
        ("gpkg_spatial_ref_sys", "definition_12_063", "gpkg_crs_wkt", "read-write")
    ]


def test_contents_name_the_layer_its_extent_and_the_time_of_the_last_change(log: sqlite3.Connection) -> None:
    ((table, kind, srs, *extent, change),) = log.execute(
        "SELECT table_name, data_type, srs_id, min_x, min_y, max_x, max_y, last_change FROM gpkg_contents"
    ).fetchall()
    assert (table, kind, srs) == ("geotags", "features", 4979)  # requirements 10, 13, 14
    ((lon0, lat0, lon1, lat1),) = log.execute(
        "SELECT min(lon_deg), min(lat_deg), max(lon_deg), max(lat_deg) FROM geotags"
    )
    assert extent == [lon0, lat0, lon1, lat1]
    assert len(change) == 24  # requirement 15: YYYY-MM-DDTHH:MM:SS.SSSZ
    assert change.endswith("Z")


def test_the_layer_has_an_integer_key_one_geometry_column_and_allowed_types(log: sqlite3.Connection) -> None:
    assert log.execute("SELECT * FROM gpkg_geometry_columns").fetchall() == [
        ("geotags", "geom", "POINT", 4979, 2, 0)  # requirements 21 to 28
    ]
    columns = log.execute("PRAGMA table_info(geotags)").fetchall()
    assert [(name, kind) for _, name, kind, _, _, key in columns if key] == [("fid", "INTEGER")]  # requirement 29
    assert [name for _, name, kind, *_ in columns if kind == "POINT"] == ["geom"]  # requirements 30, 31
    assert {kind for _, _, kind, *_ in columns} <= {"INTEGER", "POINT", "TEXT", "DOUBLE", "DATETIME", "BLOB"}


def test_times_are_in_the_standards_form(log: sqlite3.Connection) -> None:
    assert log.execute("SELECT DISTINCT time_utc FROM geotags").fetchall() == [("2026-11-22T12:00:06.250Z",)]


def test_geometry_is_a_geopackage_blob_with_a_height_only_where_it_is_an_ellipsoid_height(
    log: sqlite3.Connection,
) -> None:
    rows = log.execute("SELECT geom, lon_deg, lat_deg, ellipsoid_height_m FROM geotags ORDER BY fid").fetchall()
    (solid, lon, lat, height), (flat, _, _, no_height) = rows
    assert solid[:8] == b"GP\x00\x01" + struct.pack("<i", 4979)  # requirement 19; flags: little endian, no envelope
    assert struct.unpack("<BIddd", solid[8:]) == (1, 1001, lon, lat, height)  # ISO WKB point Z
    assert no_height is None
    assert struct.unpack("<BIdd", flat[8:])[:2] == (1, 1)


def test_a_file_that_is_there_already_is_never_replaced(tmp_path: Path) -> None:
    path = tmp_path / "log.gpkg"
    path.write_bytes(b"mine")
    with pytest.raises(FileExistsError):
        geopackage.create(path, "geotags", "", {})
    assert path.read_bytes() == b"mine"
    assert [entry.name for entry in tmp_path.iterdir()] == ["log.gpkg"]


def test_another_kind_of_database_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "other.gpkg"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE t (x)")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(AnswerError, match="not a GeoPackage"):
        geopackage.connect(path, busy_timeout_s=0.1)
    assert path.read_bytes() == before
