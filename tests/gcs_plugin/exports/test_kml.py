"""KML is well-formed whatever the texts are, and shows target, ellipse, arrow and picture."""

from __future__ import annotations

import base64
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest
from pyproj import Geod

from gcs_plugin.exports.kml import to_kml
from gcs_plugin.geotags.geotag import Geotag
from tests.support.sample import estimate, geotag, jpeg, origin

KML = {"k": "http://www.opengis.net/kml/2.2"}


def parse(tag: Geotag) -> ET.Element:
    return ET.fromstring(to_kml([tag]))


def coordinates(root: ET.Element, path: str) -> list[list[float]]:
    text = root.findtext(f".//{path}/k:coordinates", namespaces=KML)
    assert text is not None
    return [[float(number) for number in position.split(",")] for position in text.split()]


def test_the_target_stands_at_its_height_above_the_sea() -> None:
    tag = geotag()
    root = parse(tag)
    ((lon, lat, height),) = coordinates(root, "k:Point")
    assert lon == pytest.approx(tag.place.lon_deg, abs=1e-8)
    assert lat == pytest.approx(tag.place.lat_deg, abs=1e-8)
    assert height == pytest.approx(7.4, abs=1e-4)
    assert root.findtext(".//k:Point/k:altitudeMode", namespaces=KML) == "absolute"
    assert root.findtext(".//k:TimeStamp/k:when", namespaces=KML) == "2026-11-22T12:00:06Z"


@pytest.mark.parametrize("tag", [geotag(geoid_separation_m=None), geotag(at=origin("home"))])
def test_where_the_height_above_the_sea_is_unknown_the_target_lies_on_the_ground(tag: Geotag) -> None:
    root = parse(tag)
    assert len(coordinates(root, "k:Point")[0]) == 2
    assert root.findtext(".//k:Point/k:altitudeMode", namespaces=KML) == "clampToGround"


def test_the_arrow_ends_where_the_target_will_be_in_ten_seconds() -> None:
    tag = geotag(where=estimate(velocity=(0.3, 0.4, 0.0)))
    start, tip, *_ = coordinates(parse(tag), "k:LineString")
    azimuth, _, metres = Geod(ellps="WGS84").inv(start[0], start[1], tip[0], tip[1])
    assert metres == pytest.approx(5.0, abs=0.01)
    assert azimuth == pytest.approx(math.degrees(math.atan2(0.3, 0.4)), abs=0.2)


def test_a_target_that_stands_has_no_arrow() -> None:
    for velocity in (None, (0.0, 0.0, 0.0)):
        assert parse(geotag(where=estimate(velocity=velocity))).find(".//k:LineString", KML) is None


def test_the_ellipse_is_a_closed_ring() -> None:
    ring = coordinates(parse(geotag()), "k:LinearRing")
    assert len(ring) > 30
    assert ring[0] == ring[-1]


def test_the_picture_is_in_the_balloon() -> None:
    picture = jpeg()
    description = parse(geotag(picture=picture)).findtext(".//k:description", namespaces=KML) or ""
    found = re.search(r'<img alt="target" src="data:image/jpeg;base64,([^"]+)"/>', description)
    assert found is not None
    assert base64.b64decode(found[1]) == picture


def test_texts_from_outside_cannot_break_the_file_or_the_balloon() -> None:
    tag = replace(geotag(), notes=("</table><script>alert(1)</script> & ]]> \x00\x1b\ud7ff \ufffe\uffff\ud800.",))
    tag = replace(tag, provenance=replace(tag.provenance, flight_id="<b>&amp;"))
    description = parse(tag).findtext(".//k:description", namespaces=KML) or ""
    assert "<script>" not in description
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; ]]&gt; \N{REPLACEMENT CHARACTER}" in description
    assert "&lt;b&gt;&amp;amp;" in description
