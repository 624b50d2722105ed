"""Geotags as GPX 1.1, for hand-held receivers and phones: a waypoint each, and the way of a target that moves.

https://www.topografix.com/GPX/1/1/. GPX has no place for an accuracy in metres: the description says CE90.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from datetime import timedelta

from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.outline import ARROW_S, velocity_arrow
from gcs_plugin.geotags.words import description, moves, name_of
from gcs_plugin.xml_text import document, element, zulu


def to_gpx(geotags: Sequence[Geotag]) -> bytes:
    """The file; elevations only where the height above mean sea level is known."""
    root = ET.Element("gpx", version="1.1", creator="Sidestep", xmlns="http://www.topografix.com/GPX/1/1")
    for geotag in geotags:
        point = _point(root, "wpt", geotag.place.lat_deg, geotag.place.lon_deg, geotag)
        element(point, "name", name_of(geotag))
        element(point, "desc", description(geotag))
        element(point, "sym", "Flag, Red")
    for geotag in geotags:
        arrow = velocity_arrow(geotag) if moves(geotag) else None
        if arrow is None:
            continue
        track = element(root, "trk")
        element(track, "name", f"{name_of(geotag)}, the way of {ARROW_S:.0f} s")
        segment = element(track, "trkseg")
        for (lon, lat, *_), after_s in zip(arrow[:2], (0.0, ARROW_S), strict=True):
            _point(segment, "trkpt", lat, lon, geotag, after_s)
    return document(root)


def _point(
    parent: ET.Element, tag: str, lat_deg: float, lon_deg: float, geotag: Geotag, after_s: float = 0.0
) -> ET.Element:
    lon_deg = (lon_deg + 180.0) % 360.0 - 180.0  # an arrow runs on beyond the antimeridian
    point = element(parent, tag, lat=f"{lat_deg:.8f}", lon=f"{lon_deg:.8f}")
    if geotag.amsl_m is not None:
        element(point, "ele", f"{geotag.amsl_m:.2f}")
    element(point, "time", zulu(geotag.time_utc + timedelta(seconds=after_s)))
    return point
