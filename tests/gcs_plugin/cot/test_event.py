"""Cursor on Target events say what the geotag says."""

from __future__ import annotations

import io
import json
import math
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace
from datetime import timedelta

import pytest
from pyproj import Geod

from gcs_plugin.cot.event import DroneState, drone_event, ellipse_event, target_event
from gcs_plugin.exports.data_package import to_data_package
from mission.geodesy import Geodetic
from mission.settings import TakSettings
from tests.support.sample import NOON, estimate, geotag, jpeg, origin

TAG = replace(geotag(picture=jpeg()), number=3)
STILL = geotag(where=estimate(velocity=(0.0, 0.01, 0.0)))
NOW = NOON + timedelta(seconds=1)


def find(root: ET.Element, path: str) -> ET.Element:
    found = root.find(path)
    assert found is not None
    return found


def test_the_marker_stands_where_the_target_is_to_a_millimetre() -> None:
    point = find(ET.fromstring(target_event(TAG, TakSettings(), NOW)), "point")
    assert float(point.get("lat", "")) == pytest.approx(TAG.place.lat_deg, abs=1e-8)
    assert float(point.get("lon", "")) == pytest.approx(TAG.place.lon_deg, abs=1e-8)
    assert float(point.get("hae", "")) == pytest.approx(30.9, abs=0.01)


def test_ce_is_one_sigma_or_ce90_as_the_settings_say() -> None:
    one = find(ET.fromstring(target_event(TAG, TakSettings(), NOW)), "point")
    ninety = find(ET.fromstring(target_event(TAG, TakSettings(ce="ce90"), NOW)), "point")
    assert float(one.get("ce", "")) == pytest.approx(TAG.ce90_m / 2.146, abs=0.006)
    assert float(ninety.get("ce", "")) == pytest.approx(TAG.ce90_m, abs=0.006)
    assert float(ninety.get("le", "")) == pytest.approx(TAG.le90_m, abs=0.006)


def test_an_unknown_height_is_told_as_unknown() -> None:
    point = find(ET.fromstring(target_event(geotag(at=origin("home")), TakSettings(), NOW)), "point")
    assert point.get("hae") == "9999999.0"


def test_who_walks_has_a_track_and_is_soon_stale_who_stands_is_kept() -> None:
    walking, standing = (ET.fromstring(target_event(tag, TakSettings(), NOW)) for tag in (TAG, STILL))
    assert walking.get("start") == "2026-11-22T12:00:06.250Z"
    assert walking.get("time") == "2026-11-22T12:00:07.250Z"
    assert walking.get("stale") == "2026-11-22T12:02:06.250Z"
    assert standing.get("stale") == "2026-11-22T13:00:06.250Z"
    track = find(walking, "detail/track")
    assert (float(track.get("course", "")), float(track.get("speed", ""))) == (90.0, 0.6)
    assert standing.find("detail/track") is None
    assert walking.find("detail/archive") is None
    assert standing.find("detail/archive") is not None


def test_one_target_keeps_its_uid() -> None:
    first, second = (ET.fromstring(target_event(t, TakSettings(), NOW)) for t in (TAG, replace(TAG, number=9)))
    assert first.get("uid") == second.get("uid") == "sidestep.tag-1"
    assert json.loads(find(first, "detail/sidestep").get("covariance_enu", ""))[0][1] == 0.03


def test_the_ellipse_is_a_closed_polygon_with_the_axes_of_the_covariance() -> None:
    root = ET.fromstring(ellipse_event(TAG, TakSettings(), NOW))
    assert root.get("type") == "u-d-f"
    points = [tuple(map(float, link.get("point", "").split(","))) for link in root.iterfind("detail/link")]
    assert points[0] == points[-1]
    assert 30 < len(points) < 45
    geod = Geod(ellps="WGS84")
    radii = [geod.inv(TAG.place.lon_deg, TAG.place.lat_deg, lon, lat)[2] for lat, lon in points]
    assert max(radii) == pytest.approx(TAG.ellipse.semi_major_m, rel=0.02)
    assert min(radii) == pytest.approx(TAG.ellipse.semi_minor_m, rel=0.02)


def test_texts_from_outside_cannot_break_an_event() -> None:
    odd = replace(TAG, id='"><x/>\x00\ud800', notes=("</remarks>&\x1b",))
    root = ET.fromstring(target_event(odd, TakSettings(), NOW))
    assert root.get("uid", "").startswith('sidestep."><x/>')
    assert "</remarks>&" in (root.findtext("detail/remarks") or "")


def test_the_drone_shows_where_it_looks() -> None:
    place = Geodetic(37.2276, 126.8405, 33.0, "ellipsoid")
    state = DroneState("uid", "D1", place, 33.0, math.radians(450.0), 2.0, -0.1, math.radians(70.0), 0.2)
    root = ET.fromstring(drone_event(state, NOW, "rtsp://host/video"))
    sensor = find(root, "detail/sensor")
    assert sensor.get("azimuth") == "354.3"
    assert sensor.get("elevation") == "-11.5"
    assert sensor.get("fov") == "70.0"
    assert find(root, "detail/track").get("course") == "90.0"


def test_a_data_package_ties_the_picture_to_its_marker() -> None:
    with zipfile.ZipFile(io.BytesIO(to_data_package([TAG, STILL]))) as package:
        manifest = ET.fromstring(package.read("MANIFEST/manifest.xml"))
        contents = manifest.findall("Contents/Content")
        names = [content.get("zipEntry", "") for content in contents]
        assert set(names) == set(package.namelist()) - {"MANIFEST/manifest.xml"}
        (picture,) = [content for content in contents if content.get("zipEntry", "").endswith("target-3.jpg")]
        assert find(picture, "Parameter").get("value") == "sidestep.tag-1"
        assert package.read(picture.get("zipEntry", "")) == TAG.picture
