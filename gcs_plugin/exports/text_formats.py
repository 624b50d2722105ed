"""Geotags for other programs: GeoJSON (RFC 7946), CSV (RFC 4180) and KML."""

from __future__ import annotations

import csv
import io
import json
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

from gcs_plugin.exports.kml import to_kml
from gcs_plugin.geotags.geotag import COLUMNS, Cell, Geotag, as_json, row
from gcs_plugin.geotags.outline import ellipse_rings, flat_position

# A spreadsheet runs a cell that begins so as a formula; notes and names come from outside.
_FORMULA_STARTS: Final = ("=", "+", "-", "@")
_COLUMNS: Final = [column for column in COLUMNS if column.name != "picture"]


def to_geojson(geotags: Iterable[Geotag]) -> str:
    """A FeatureCollection: of each geotag the point, with all its columns as properties, and the 95 % ellipse.

    Positions have a third coordinate only where the ellipsoid height is known, as RFC 7946 section 4 wants it. An
    ellipse across the antimeridian is cut in two (section 3.1.9).
    """
    features: list[Mapping[str, object]] = []
    for geotag in geotags:
        height = geotag.ellipsoid_height_m
        position = flat_position(geotag) if height is None else (*flat_position(geotag), height)
        features.append(
            {
                "type": "Feature",
                "geometry": {"type": "Point", "coordinates": position},
                "properties": {"kind": "target", **as_json(geotag)},
            }
        )
        rings = ellipse_rings(geotag)
        area = (
            {"type": "Polygon", "coordinates": rings}
            if len(rings) == 1
            else {"type": "MultiPolygon", "coordinates": [[ring] for ring in rings]}
        )
        features.append(
            {
                "type": "Feature",
                "geometry": area,
                "properties": {"kind": "error-ellipse", "number": geotag.number, "id": geotag.id, "probability": 0.95},
            }
        )
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False, ensure_ascii=False) + "\n"


def to_csv(geotags: Iterable[Geotag]) -> str:
    """One row for each geotag, with a header; everything but the picture."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["number", *(column.name for column in _COLUMNS)])
    for geotag in geotags:
        cells = row(geotag)
        writer.writerow([geotag.number, *(_harmless(cells[column.name]) for column in _COLUMNS)])
    return text.getvalue()


TEXT_FORMATS: Final[Mapping[str, Callable[[Sequence[Geotag]], str]]] = {
    "geojson": to_geojson,
    "kml": to_kml,
    "csv": to_csv,
}
"""Formats that are text, by name; `gcs_plugin.exports.formats` has all of them."""


def _harmless(cell: Cell) -> Cell:
    return f"'{cell}" if isinstance(cell, str) and _may_be_a_formula(cell) else cell


def _may_be_a_formula(text: str) -> bool:
    """Whether a spreadsheet may run it: blanks, marks and signs that nobody sees before the first letter do not help.

    Several strip them before they look; and where full-width signs are written, those begin a formula, too.
    """
    plain = unicodedata.normalize("NFKC", text)
    seen = next((i for i, c in enumerate(plain) if unicodedata.category(c)[0] not in "ZC"), len(plain))
    return plain[seen:].startswith(_FORMULA_STARTS) or text.startswith(("\t", "\r"))
