"""Files for other programs: read back by readers that are not ours."""

from __future__ import annotations

import io
import json
import math
import shutil
import sqlite3
import subprocess
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image
from pyproj import Geod, Transformer

from gcs_plugin.exports.caltopo import to_caltopo
from gcs_plugin.exports.formats import FORMATS, format_of
from gcs_plugin.exports.gpx import to_gpx
from gcs_plugin.exports.kmz import to_kmz
from gcs_plugin.exports.layers import to_geopackage
from gcs_plugin.exports.picture import to_jpeg
from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.grid import grid_reference
from gcs_plugin.geotags.words import description, moves
from mission.errors import AnswerError, SettingsError
from mission.records import GeodeticOrigin
from tests.support.sample import estimate, geotag, jpeg, origin

GPX = {"g": "http://www.topografix.com/GPX/1/1"}
KML = {"k": "http://www.opengis.net/kml/2.2"}


def tags() -> list[Geotag]:
    """One that walks and has a picture, one that stands."""
    return [
        replace(geotag(picture=jpeg(96)), number=1),
        replace(geotag("b", where=estimate(velocity=(0.0, 0.01, 0.0))), number=2),
    ]


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "zone"),
    [(37.2276, 126.8405, 32652), (-33.0, 151.2, 32756), (0.0001, -0.0001, 32630), (60.5, 4.9, 32632)],
)
def test_a_grid_reference_is_the_utm_place_cut_to_the_metre(lat_deg: float, lon_deg: float, zone: int) -> None:
    east, north = Transformer.from_crs(4326, zone, always_xy=True).transform(lon_deg, lat_deg)
    *_, easting, northing = grid_reference(lat_deg, lon_deg).split()
    assert int(easting) == math.floor(east) % 100_000
    assert int(northing) == math.floor(north) % 100_000


def test_a_grid_reference_near_a_pole_has_no_zone_number() -> None:
    assert grid_reference(89.9, 10.0).split()[0] == "Z"


def test_only_a_speed_beyond_its_own_uncertainty_is_motion() -> None:
    walking, standing = tags()
    assert moves(walking)
    assert not moves(standing)
    assert "0.6 m/s E (90°)" in description(walking)
    assert "not seen to move" in description(standing)


def test_gpx_has_a_waypoint_each_and_the_way_of_whoever_walks() -> None:
    root = ET.fromstring(to_gpx(tags()))
    points = root.findall("g:wpt", GPX)
    assert [p.findtext("g:name", namespaces=GPX) for p in points] == ["Target 1", "Target 2"]
    assert float(points[0].get("lat", "")) == pytest.approx(tags()[0].place.lat_deg, abs=1e-8)
    assert points[0].findtext("g:ele", namespaces=GPX) == "7.40"
    assert points[0].findtext("g:time", namespaces=GPX) == "2026-11-22T12:00:06.250Z"
    (track,) = root.findall("g:trk", GPX)
    start, end = track.findall(".//g:trkpt", GPX)
    _, _, metres = Geod(ellps="WGS84").inv(*(float(p.get(a, "")) for p in (start, end) for a in ("lon", "lat")))
    assert metres == pytest.approx(6.0, abs=0.01)


def test_gpx_has_no_elevation_where_the_height_above_the_sea_is_unknown() -> None:
    assert b"<ele>" not in to_gpx([geotag(at=origin("home"))])


def test_caltopo_gets_its_own_properties() -> None:
    features = json.loads(to_caltopo(tags()))["features"]
    marker, ellipse, arrow = features[:3]
    assert marker["properties"]["title"] == "Target 1"
    assert marker["properties"]["class"] == "Marker"
    assert "MGRS" not in marker["properties"]["description"]
    assert "52S CG" in marker["properties"]["description"]
    assert ellipse["geometry"]["type"] == "Polygon"
    assert arrow["geometry"]["type"] == "LineString"
    assert len(features) == 5  # who stands has no arrow


def test_a_kmz_needs_no_internet() -> None:
    with zipfile.ZipFile(io.BytesIO(to_kmz(tags()))) as archive:
        names = archive.namelist()
        assert names[0] == "doc.kml"
        text = archive.read("doc.kml").decode("utf-8")
        assert text.count("http") == text.count("http://www.opengis.net/kml/2.2")
        assert "data:" not in text
        assert archive.read("files/target-1.jpg") == tags()[0].picture
        icon = cv2.imdecode(np.frombuffer(archive.read("files/target.png"), np.uint8), cv2.IMREAD_UNCHANGED)
        assert icon is not None
        assert icon.shape == (64, 64, 4)
        root = ET.fromstring(text)
        assert root.findtext(".//k:Icon/k:href", namespaces=KML) in names
        assert 'src="files/target-1.jpg"' in (root.findtext(".//k:description", namespaces=KML) or "")
        assert root.findtext(".//k:Placemark/k:name", namespaces=KML) == "Target 1"


def degrees(angle: tuple[float, float, float], letter: str) -> float:
    return float(angle[0] + angle[1] / 60 + angle[2] / 3600) * (-1.0 if letter in "SW" else 1.0)


@pytest.mark.parametrize("where", [(37.2276, 126.8405), (-33.9, -70.6)])
def test_the_picture_says_where_it_was_taken_and_what_it_shows(where: tuple[float, float]) -> None:
    tag = geotag(picture=jpeg(96), at=GeodeticOrigin(*where, 30.0, "ellipsoid"))
    image = Image.open(io.BytesIO(to_jpeg(tag)))
    gps = image.getexif().get_ifd(ExifTags.IFD.GPSInfo)
    assert tag.drone is not None
    assert degrees(gps[2], gps[1]) == pytest.approx(tag.drone.lat_deg, abs=1e-9)
    assert degrees(gps[4], gps[3]) == pytest.approx(tag.drone.lon_deg, abs=1e-9)
    assert degrees(gps[20], gps[19]) == pytest.approx(tag.place.lat_deg, abs=1e-9)
    assert degrees(gps[22], gps[21]) == pytest.approx(tag.place.lon_deg, abs=1e-9)
    assert float(gps[26]) * 1000.0 == pytest.approx(9.0, abs=0.01)
    assert float(gps[24]) == pytest.approx(0.64, abs=0.01)
    packet = image.info["xmp"].decode("utf-8")
    root = ET.fromstring(packet[packet.index("<x:") : packet.index("<?xpacket end")])
    found = {name.rpartition("}")[2]: value for node in root.iter() for name, value in node.attrib.items()}
    assert json.loads(found["CovarianceEnu"])[0][1] == 0.03
    assert float(found["Ce90Metres"]) == pytest.approx(tag.ce90_m, abs=1e-3)


def test_a_picture_that_is_not_there_or_damaged_is_told() -> None:
    with pytest.raises(AnswerError, match="no picture"):
        to_jpeg(geotag())
    with pytest.raises(AnswerError, match="damaged"):
        to_jpeg(replace(geotag(), picture=b"\xff\xd8\xff rubbish"))


def test_the_geopackage_has_layers_styles_and_pictures(tmp_path: Path) -> None:
    path = tmp_path / "t.gpkg"
    path.write_bytes(to_geopackage(tags()))
    with sqlite3.connect(path) as connection:
        styles = dict(connection.execute("SELECT f_table_name, styleQML FROM layer_styles WHERE useAsDefault"))
        related = connection.execute(
            "SELECT p.data, p.content_type FROM targets_pictures l JOIN pictures p ON p.id = l.related_id"
            " WHERE l.base_id = 1"
        ).fetchall()
        assert connection.execute("SELECT count(*) FROM ways").fetchone() == (1,)
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    connection.close()
    assert set(styles) == {"targets", "ellipses", "ways"}
    for text in styles.values():
        ET.fromstring(text)
    assert related == [(tags()[0].picture, "image/jpeg")]


@pytest.mark.skipif(shutil.which("ogr2ogr") is None, reason="GDAL's programs are not installed")
@pytest.mark.parametrize(("name", "layer"), [("t.gpkg", "ellipses"), ("t.kmz", "Target 1"), ("t.gpx", "waypoints")])
def test_gdal_reads_what_we_write(tmp_path: Path, name: str, layer: str) -> None:
    path = tmp_path / name
    path.write_bytes(FORMATS[format_of(path)](tags()))
    command = ["ogr2ogr", "-f", "GeoJSON", "/vsistdout/", str(path), layer]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    features = json.loads(done.stdout)["features"]
    assert features
    flat = np.array(json.loads(json.dumps(features[0]["geometry"]["coordinates"])), dtype=object).ravel().tolist()
    assert "Warning" not in done.stderr
    assert flat


@pytest.mark.skipif(shutil.which("exiftool") is None, reason="ExifTool is not installed")
def test_exiftool_reads_the_picture(tmp_path: Path) -> None:
    path = tmp_path / "t.jpg"
    path.write_bytes(to_jpeg(tags()[0]))
    done = subprocess.run(
        ["exiftool", "-json", "-n", str(path)], capture_output=True, text=True, timeout=60, check=True
    )
    (found,) = json.loads(done.stdout)
    tag = tags()[0]
    assert found["GPSDestLatitude"] == pytest.approx(tag.place.lat_deg, abs=1e-9)
    assert found["GPSDestLongitude"] == pytest.approx(tag.place.lon_deg, abs=1e-9)
    assert float(found["Ce90Metres"]) == pytest.approx(tag.ce90_m, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "form"),
    [("a.kmz", "kmz"), ("a.JSON", "geojson"), ("a.zip", "tak"), ("a.jpeg", "jpg"), ("a.caltopo.json", "caltopo")],
)
def test_the_ending_says_the_format(name: str, form: str) -> None:
    assert format_of(Path(name)) == form


@pytest.mark.parametrize("name", ["a", "a.txt", "a.tak", "a.caltopo"])
def test_an_unknown_ending_is_told(name: str) -> None:
    with pytest.raises(SettingsError, match="no format"):
        format_of(Path(name))
