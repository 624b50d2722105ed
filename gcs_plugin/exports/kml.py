"""Geotags as KML 2.2 (OGC 12-007r2): the target with its picture, the 95 % ellipse and the velocity arrow."""

from __future__ import annotations

import base64
import html
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from datetime import UTC

from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.grid import grid_reference
from gcs_plugin.geotags.outline import ARROW_S, Position, ellipse_rings, flat_position, velocity_arrow
from gcs_plugin.geotags.words import name_of
from gcs_plugin.xml_text import xml_text


def to_kml(geotags: Sequence[Geotag], *, icon: str = "", pictures: Sequence[str | None] = ()) -> str:
    """A folder for each geotag.

    KML's absolute altitude is above mean sea level; where that is unknown the target lies on the ground. Nothing in the
    file is fetched from the internet.

    Args:
        geotags: what is shown.
        icon: address of the marker's picture; without it every program takes its own.
        pictures: address of each target's picture; without them the pictures stand in the file itself.
    """
    kml = ET.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = _element(kml, "Document")
    _element(document, "name", "Sidestep geotags")
    # Colours are alpha, blue, green, red.
    target_style, ellipse_style, velocity_style = (_style(document, name) for name in ("target", "ellipse", "velocity"))
    icon_style = _element(target_style, "IconStyle")
    if icon:
        _element(_element(icon_style, "Icon"), "href", icon)
    else:
        _element(icon_style, "color", "ff2828e6")
    _line(ellipse_style, "ff00a5ff")
    _element(_element(ellipse_style, "PolyStyle"), "color", "4000a5ff")
    _line(velocity_style, "ff0000ff")
    for index, geotag in enumerate(geotags):
        folder = _element(document, "Folder")
        _element(folder, "name", name_of(geotag))
        _target(folder, geotag, _source(geotag, pictures[index] if pictures else None))
        for ring in ellipse_rings(geotag):
            polygon = _element(_placemark(folder, "95 % error ellipse", "ellipse"), "Polygon")
            _element(polygon, "tessellate", "1")
            _element(polygon, "altitudeMode", "clampToGround")
            boundary = _element(_element(polygon, "outerBoundaryIs"), "LinearRing")
            _element(boundary, "coordinates", _coordinates(ring))
        if (arrow := velocity_arrow(geotag)) is not None:
            name = f"{geotag.speed_m_s:.2f} m/s: the way of {ARROW_S:.0f} s"
            line = _element(_placemark(folder, name, "velocity"), "LineString")
            _element(line, "tessellate", "1")
            _element(line, "altitudeMode", "clampToGround")
            _element(line, "coordinates", _coordinates(arrow))
    ET.indent(kml)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(kml, encoding="unicode") + "\n"


def _source(geotag: Geotag, address: str | None) -> str:
    """Where a balloon finds the target's picture; empty when there is none."""
    if not geotag.picture:
        return ""
    return address or f"data:{geotag.picture_type};base64,{base64.b64encode(geotag.picture).decode('ascii')}"


def _target(folder: ET.Element, geotag: Geotag, picture: str) -> None:
    placemark = _placemark(folder, name_of(geotag), None)
    _element(placemark, "description", _description(geotag, picture))
    when = geotag.time_utc.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    _element(_element(placemark, "TimeStamp"), "when", when)
    _element(placemark, "styleUrl", "#target")
    point = _element(placemark, "Point")
    sea = geotag.amsl_m
    _element(point, "altitudeMode", "clampToGround" if sea is None else "absolute")
    position = flat_position(geotag)
    _element(point, "coordinates", _coordinates([position if sea is None else (*position, sea)]))


def _description(geotag: Geotag, picture: str) -> str:
    """HTML for the balloon: every text in it comes from outside and is escaped."""
    place, motion = geotag.place, "not estimated"
    if geotag.speed_m_s is not None:
        motion = f"{geotag.speed_m_s:.2f} m/s"
        if geotag.course_rad is not None:
            motion += f", course {math.degrees(geotag.course_rad):.0f}°"
    rows = [
        ("Position", f"{place.lat_deg:.7f}, {place.lon_deg:.7f}"),
        ("MGRS", grid_reference(place.lat_deg, place.lon_deg)),
        ("Altitude", f"{place.alt_m:.1f} m ({place.datum})"),
        ("CE90 / LE90", f"{geotag.ce90_m:.2f} m / {geotag.le90_m:.2f} m"),
        ("Motion", motion),
        ("Depth", f"{geotag.depth_m:.2f} m"),
        ("Time", geotag.time_utc.astimezone(UTC).isoformat(" ", "milliseconds")),
        ("Method", f"{geotag.method}, {geotag.model}, {geotag.sightings} sightings"),
        ("Flight", geotag.provenance.flight_id),
        *(("Note", note) for note in geotag.notes),
    ]
    table = "".join(f"<tr><td>{html.escape(name)}</td><td>{html.escape(text)}</td></tr>" for name, text in rows)
    image = f'<img alt="target" src="{picture}"/>' if picture else ""
    return f"{image}<table>{table}</table>"


def _placemark(folder: ET.Element, name: str, style: str | None) -> ET.Element:
    placemark = _element(folder, "Placemark")
    _element(placemark, "name", name)
    if style is not None:
        _element(placemark, "styleUrl", f"#{style}")
    return placemark


def _style(document: ET.Element, name: str) -> ET.Element:
    return ET.SubElement(document, "Style", id=name)


def _line(style: ET.Element, colour: str) -> None:
    line = _element(style, "LineStyle")
    _element(line, "color", colour)
    _element(line, "width", "2")


def _coordinates(positions: Sequence[Position]) -> str:
    return " ".join(",".join(f"{number:.8f}".rstrip("0").rstrip(".") for number in position) for position in positions)


def _element(parent: ET.Element, tag: str, text: str | None = None) -> ET.Element:
    element = ET.SubElement(parent, tag)
    if text is not None:
        element.text = xml_text(text)
    return element
