"""One GeoPackage over all results of an archive; one flight is in memory at a time."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from gcs_plugin.archive.layers import Layer, write_layers
from gcs_plugin.archive.result import (
    DESCRIPTIONS,
    ELLIPSE_COLUMNS,
    GEOPACKAGE,
    PATH_COLUMNS,
    RAY_COLUMNS,
    RESULT,
    TARGET_COLUMNS,
)
from gcs_plugin.archive.run import RESULTS
from gcs_plugin.durable import sync, unwritable, write_whole
from mission.errors import InputError

_LAYERS: Final = (
    ("targets", "POINT", TARGET_COLUMNS),
    ("ellipses", "POLYGON", ELLIPSE_COLUMNS),
    ("rays", "LINESTRING", RAY_COLUMNS),
    ("paths", "LINESTRING", PATH_COLUMNS),
)
_NO_DATE: Final = "1970-01-01T00:00:00.000Z"


def results_of(out: Path) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Folder and content of each result, in the order of the keys.

    Raises:
        InputError: there are none.
    """
    found = False
    for path in sorted((out / RESULTS).glob(f"*/*/{RESULT}")):
        if path.parent.name.startswith("."):
            continue
        found = True
        yield path.parent, json.loads(path.read_text(encoding="utf-8"))
    if not found:
        raise InputError(f"there are no results in {out}", "Run `sidestep archive run` first, or name its folder.")


def merge(out: Path, target: Path) -> int:
    """Put the layers of all results into one GeoPackage.

    Args:
        out: folder of an archive's run.
        target: replaced where it is there.

    Returns:
        Number of people who were located.

    Raises:
        InputError: there are no results.
        AnswerError: it cannot be written.
    """
    flights = sorted((told["flight"], folder) for folder, told in results_of(out))
    draft = target.with_name(f".{target.name}.{os.getpid()}.merge")
    try:
        layers = [Layer(name, DESCRIPTIONS[name], kind, cols, ()) for name, kind, cols in _LAYERS]  # type: ignore[arg-type]  # names are literals there
        write_layers(draft, layers, _NO_DATE)
        connection = sqlite3.connect(draft, isolation_level=None)
        try:
            connection.execute("PRAGMA journal_mode = MEMORY")
            for _, folder in flights:
                if (folder / GEOPACKAGE).is_file():
                    _add(connection, folder / GEOPACKAGE)
            (number,) = connection.execute("SELECT count(*) FROM targets").fetchone()
        finally:
            connection.close()
        sync(draft)
        draft.replace(target)
        sync(target.parent)
    except OSError as error:
        raise unwritable(target, error) from error
    except sqlite3.Error as error:
        raise unwritable(target, OSError(0, str(error))) from error
    finally:
        draft.unlink(missing_ok=True)
    return int(number)


def _add(connection: sqlite3.Connection, path: Path) -> None:
    connection.execute("ATTACH ? AS one", (str(path),))
    try:
        connection.execute("BEGIN")
        for name, _, columns in _LAYERS:
            names = ", ".join(f'"{column}"' for column, _ in columns)
            connection.execute(
                f'INSERT INTO main."{name}" (geom, {names}) SELECT geom, {names} FROM one."{name}" ORDER BY fid'
            )
            connection.execute(
                "UPDATE main.gpkg_contents SET (min_x, min_y, max_x, max_y, last_change) = ("
                " SELECT min(coalesce(a.min_x, b.min_x), coalesce(b.min_x, a.min_x)),"
                " min(coalesce(a.min_y, b.min_y), coalesce(b.min_y, a.min_y)),"
                " max(coalesce(a.max_x, b.max_x), coalesce(b.max_x, a.max_x)),"
                " max(coalesce(a.max_y, b.max_y), coalesce(b.max_y, a.max_y)), max(a.last_change, b.last_change)"
                " FROM main.gpkg_contents a, one.gpkg_contents b WHERE a.table_name = ? AND b.table_name = ?)"
                " WHERE table_name = ?",
                (name, name, name),
            )
        connection.execute("COMMIT")
    finally:
        connection.execute("DETACH one")


def merge_geojson(out: Path, target: Path) -> int:
    """Everybody who was located, as a GeoJSON FeatureCollection (RFC 7946) of points; one line a person.

    Args:
        out: folder of an archive's run.
        target: replaced where it is there.

    Returns:
        Number of people.

    Raises:
        InputError: there are no results.
        AnswerError: it cannot be written.
    """
    people = [(told["flight"], one["number"], one) for _, told in results_of(out) for one in told.get("targets", ())]
    people.sort(key=lambda row: row[:2])
    lines = []
    for flight, _, one in people:
        properties = {"flight": flight, **{name: one[name] for name in _PROPERTIES}}
        point = {"type": "Point", "coordinates": [one["lon_deg"], one["lat_deg"]]}
        lines.append(json.dumps({"type": "Feature", "geometry": point, "properties": properties}, ensure_ascii=False))
    text = '{"type": "FeatureCollection", "features": [\n' + ",\n".join(lines) + "\n]}\n"
    write_whole(target, text.encode())
    return len(lines)


_PROPERTIES: Final = (
    *("number", "time_utc", "video_s", "alt_m", "alt_datum", "ce90_m", "le90_m", "ellipse95", "velocity_enu_m_s"),
    *("distance_m", "relative_sigma", "picture"),
)
