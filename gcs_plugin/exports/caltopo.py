"""Geotags as GeoJSON with CalTopo's own properties (title, description, marker and line styles): SARTopo, too."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.outline import ARROW_S, ellipse_rings, flat_position, velocity_arrow
from gcs_plugin.geotags.words import description, moves, name_of

_RED, _AMBER = "#FF0000", "#FFA500"


def to_caltopo(geotags: Sequence[Geotag]) -> bytes:
    """A FeatureCollection of markers, error ellipses and velocity arrows."""
    features: list[Mapping[str, object]] = []
    for geotag in geotags:
        name = name_of(geotag)
        features.append(
            _feature(
                {"type": "Point", "coordinates": flat_position(geotag)},
                {
                    "class": "Marker",
                    "title": name,
                    "description": description(geotag),
                    "marker-symbol": "point",
                    "marker-color": _RED.removeprefix("#"),
                    "marker-size": "1",
                },
            )
        )
        features += [
            _feature(
                {"type": "Polygon", "coordinates": [ring]},
                {
                    "class": "Shape",
                    "title": f"{name}, 95 % ellipse",
                    "stroke": _AMBER,
                    "stroke-width": 2,
                    "stroke-opacity": 1,
                    "fill": _AMBER,
                    "fill-opacity": 0.15,
                },
            )
            for ring in ellipse_rings(geotag)
        ]
        arrow = velocity_arrow(geotag) if moves(geotag) else None
        if arrow is not None:
            features.append(
                _feature(
                    {"type": "LineString", "coordinates": arrow[:2]},
                    {
                        "class": "Shape",
                        "title": f"{name}, the way of {ARROW_S:.0f} s",
                        "stroke": _RED,
                        "stroke-width": 2,
                        "stroke-opacity": 1,
                        "pattern": "M-5 5L0 -5M5 5L0 -5,8,100%,T",
                    },
                )
            )
    collection = {"type": "FeatureCollection", "features": features}
    return f"{json.dumps(collection, allow_nan=False, ensure_ascii=False)}\n".encode("utf-8", "backslashreplace")


def _feature(geometry: Mapping[str, object], properties: Mapping[str, object]) -> Mapping[str, object]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}
