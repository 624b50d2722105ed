"""What a geotag looks like on a map: its ellipse and its velocity arrow, in longitude and latitude.

Valid wherever a person may stand but within a few metres of a pole, where an ellipse may hold every longitude.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gcs_plugin.geotags.geotag import Geotag
from mission.geodesy import enu_to_geodetic
from mission.records import GeodeticOrigin, Matrix

Position = tuple[float, ...]
"""Longitude, latitude and, where it is known, a height."""
Ring = list[Position]
"""A closed outline: the first position is the last."""

ARROW_S: Final = 10.0
"""The velocity arrow ends where the target will be after this time."""


def flat_position(geotag: Geotag) -> Position:
    """Longitude and latitude."""
    return geotag.place.lon_deg, geotag.place.lat_deg


def ellipse_rings(geotag: Geotag) -> list[Ring]:
    """The 95 % ellipse as a closed, counter-clockwise ring; two of them where it crosses the antimeridian."""
    outline = _around(geotag, geotag.ellipse.outline())
    return [[*part, part[0]] for part in _cut(outline)]


def velocity_arrow(geotag: Geotag) -> Ring | None:
    """A line from the target to where it will be, with two barbs; None when it does not move."""
    if not geotag.speed_m_s or geotag.velocity_enu_m_s is None:
        return None
    tip = ARROW_S * np.array(geotag.velocity_enu_m_s[:2])
    side = np.array([-tip[1], tip[0]])
    return _around(geotag, np.array([np.zeros(2), tip, 0.8 * tip + 0.1 * side, tip, 0.8 * tip - 0.1 * side]))


def _around(geotag: Geotag, offsets_m: Matrix) -> Ring:
    """Positions at offsets (east, north) from the target; longitudes run on beyond 180 degrees rather than jump."""
    centre = GeodeticOrigin(geotag.place.lat_deg, geotag.place.lon_deg, 0.0)  # on the map heights do not matter
    places = [enu_to_geodetic(np.array([east, north, 0.0]), centre) for east, north in offsets_m]
    return [(centre.lon_deg + math.remainder(place.lon_deg - centre.lon_deg, 360.0), place.lat_deg) for place in places]


def _cut(outline: Ring) -> list[Ring]:
    """The outline, or its two parts where it crosses the antimeridian, each with longitudes from -180 to 180."""
    longitudes = [position[0] for position in outline]
    if min(longitudes) >= -180.0 and max(longitudes) <= 180.0:
        return [outline]
    border = 180.0 if max(longitudes) > 180.0 else -180.0
    parts = (_clipped(outline, border, 1.0), _clipped(outline, border, -1.0))
    return [[(_within(lon, part), lat) for lon, lat in part] for part in parts if len(part) >= 3]


def _clipped(outline: Ring, border_deg: float, side: float) -> Ring:
    """The part of a convex outline on one side of a meridian (Sutherland & Hodgman, one edge)."""
    kept: Ring = []
    for (lon, lat), (next_lon, next_lat) in zip(outline, [*outline[1:], outline[0]], strict=True):
        here, there = side * (lon - border_deg), side * (next_lon - border_deg)
        if here >= 0.0:
            kept.append((lon, lat))
        if here * there < 0.0:
            share = here / (here - there)
            kept.append((border_deg, lat + share * (next_lat - lat)))
    return kept


def _within(lon_deg: float, part: Ring) -> float:
    """A part that lies beyond the antimeridian is moved back by a turn, its border with it."""
    middle = sum(position[0] for position in part) / len(part)
    return lon_deg - 360.0 * math.floor((middle + 180.0) / 360.0)
