"""Targets on MAVProxy's map: an icon with the target's number, and its 95 % ellipse.

MAVProxy's map objects are imported when a map is there, so that a station without a GUI needs none of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.outline import ellipse_rings
from gcs_plugin.mavproxy.news import Fix

LAYER: Final = "Sidestep"
RED: Final = (255, 0, 0)
ICON: Final = "flag.png"
_CIRCLE_POINTS: Final = 48
_METRES_PER_DEGREE: Final = 111_320.0
_CIRCULAR_95: Final = math.sqrt(-2.0 * math.log(0.05) / 2.0)
"""Radius with probability 0.95, over the root of the sum of both variances, when these are equal."""

LatLon = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Marker:
    """A target as it is drawn."""

    number: int
    place: LatLon
    outlines: tuple[tuple[LatLon, ...], ...]
    """Of the 95 % ellipse; two where it crosses the antimeridian."""


def marker_of(geotag: Geotag) -> Marker:
    """Of a geotag in the log."""
    rings = tuple(tuple((lat, lon) for lon, lat in ring) for ring in ellipse_rings(geotag))
    return Marker(geotag.number, (geotag.place.lat_deg, geotag.place.lon_deg), rings)


def marker_of_fix(fix: Fix, number: int) -> Marker:
    """Of an answer that came over the wire, without a log: its accuracy is one number, so it becomes a circle."""
    place = (fix.lat_deg, fix.lon_deg)
    if math.isnan(fix.horizontal_sigma_m):
        return Marker(number, place, ())
    north = _CIRCULAR_95 * fix.horizontal_sigma_m / _METRES_PER_DEGREE
    east = north / max(math.cos(math.radians(fix.lat_deg)), 1e-3)
    angles = [2.0 * math.pi * i / _CIRCLE_POINTS for i in range(_CIRCLE_POINTS + 1)]
    ring = tuple((fix.lat_deg + north * math.cos(a), fix.lon_deg + east * math.sin(a)) for a in angles)
    return Marker(number, place, (ring,))


class TargetMap:
    """Keeps MAVProxy's map as it should be, also when the map is loaded later or anew."""

    def __init__(self) -> None:
        self._map: Any = None
        self._shown: tuple[Marker, ...] = ()
        self._keys: set[str] = set()

    def show(self, slipmap: Any, markers: Sequence[Marker]) -> None:
        """Draw these markers and no others.

        Args:
            slipmap: MAVProxy's MPSlipMap; None when no map is loaded.
            markers: of which each number occurs once.
        """
        if slipmap is not self._map:
            self._map, self._shown, self._keys = slipmap, (), set()
        if slipmap is None or tuple(markers) == self._shown:
            return
        objects = [part for marker in markers for part in _objects(slipmap, marker)]
        for key in self._keys - {part.key for part in objects}:
            slipmap.remove_object(key)
        for part in objects:
            slipmap.add_object(part)
        self._keys = {part.key for part in objects}
        self._shown = tuple(markers)

    def clear(self) -> None:
        """Take everything off the map."""
        self.show(self._map, ())


def _objects(slipmap: Any, marker: Marker) -> list[Any]:
    from MAVProxy.modules.mavproxy_map import mp_slipmap_util as slip

    key = f"{LAYER} {marker.number}"
    icon = slip.SlipIcon(key, marker.place, slipmap.icon(ICON), layer=LAYER, label=str(marker.number), colour=RED)
    ellipses = [
        slip.SlipPolygon(f"{key} ellipse {i}", list(outline), LAYER, RED, 1, showcircles=False)
        for i, outline in enumerate(marker.outlines)
    ]
    return [*ellipses, icon]
