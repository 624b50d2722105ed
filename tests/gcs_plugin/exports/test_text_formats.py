"""Exports follow their standards and say what the log says."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from pyproj import Geod

from gcs_plugin.exports.text_formats import to_csv, to_geojson
from gcs_plugin.geotags.geotag import Geotag
from mission.records import GeodeticOrigin
from tests.support.sample import estimate, geotag, jpeg, origin


def area(ring: list[list[float]]) -> float:
    """Signed, positive counter-clockwise (the shoelace formula)."""
    x, y = np.array(ring).T[:2]
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2.0)


def test_geojson_has_the_target_and_its_ellipse() -> None:
    tag = replace(geotag(picture=jpeg()), number=7)
    collection = json.loads(to_geojson([tag]))
    assert collection["type"] == "FeatureCollection"
    assert "crs" not in collection  # RFC 7946 section 4: always WGS 84
    target, ellipse = collection["features"]
    assert target["geometry"]["type"] == "Point"
    assert target["geometry"]["coordinates"] == [tag.place.lon_deg, tag.place.lat_deg, tag.place.alt_m]
    properties = target["properties"]
    assert (properties["number"], properties["kind"], properties["alt_datum"]) == (7, "target", "ellipsoid")
    assert properties["ce90_m"] == pytest.approx(tag.ce90_m)
    assert properties["covariance_enu"][0][1] == 0.03
    assert properties["notes"] == list(tag.notes)
    assert "picture" not in properties
    (ring,) = ellipse["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    assert area(ring) > 0.0  # section 3.1.6: the outer ring is counter-clockwise


def test_the_ellipse_on_the_map_has_the_axes_of_the_covariance() -> None:
    tag = geotag()
    (ring,) = json.loads(to_geojson([tag]))["features"][1]["geometry"]["coordinates"]
    geod = Geod(ellps="WGS84")
    legs = [geod.inv(tag.place.lon_deg, tag.place.lat_deg, lon, lat) for lon, lat in ring]
    azimuth, _, longest = max(legs, key=lambda leg: leg[2])
    assert longest == pytest.approx(tag.ellipse.semi_major_m, rel=1e-4)
    assert min(leg[2] for leg in legs) == pytest.approx(tag.ellipse.semi_minor_m, rel=1e-4)
    assert math.radians(azimuth) % math.pi == pytest.approx(tag.ellipse.azimuth_rad, abs=1e-3)


def test_geojson_has_no_height_where_the_ellipsoid_height_is_unknown() -> None:
    tag = geotag(at=origin("home"))
    target = json.loads(to_geojson([tag]))["features"][0]
    assert len(target["geometry"]["coordinates"]) == 2
    assert (target["properties"]["alt_datum"], target["properties"]["ellipsoid_height_m"]) == ("home", None)


@pytest.mark.parametrize("lon_deg", [179.999999, -179.999999])
def test_an_ellipse_across_the_antimeridian_is_cut_in_two_that_make_the_whole(lon_deg: float) -> None:
    there = geotag(at=GeodeticOrigin(-16.8, lon_deg, 0.0))
    parts = json.loads(to_geojson([there]))["features"][1]["geometry"]
    assert parts["type"] == "MultiPolygon"
    rings = [polygon[0] for polygon in parts["coordinates"]]
    assert len(rings) == 2
    for ring in rings:
        assert ring[0] == ring[-1]
        assert area(ring) > 0.0
        assert max(lon for lon, _ in ring) - min(lon for lon, _ in ring) < 1e-3  # on one side of the world
        assert all(-180.0 <= lon <= 180.0 for lon, _ in ring)
    here = geotag(at=GeodeticOrigin(-16.8, 10.0, 0.0))
    (whole,) = json.loads(to_geojson([here]))["features"][1]["geometry"]["coordinates"]
    assert sum(area(ring) for ring in rings) == pytest.approx(area(whole), rel=1e-4)


def test_csv_has_one_row_for_each_geotag_with_the_numbers_in_full() -> None:
    tags = [replace(geotag("a"), number=1), replace(geotag("b", where=estimate(velocity=None)), number=2)]
    rows = list(csv.DictReader(io.StringIO(to_csv(tags))))
    assert [row["id"] for row in rows] == ["a", "b"]
    assert float(rows[0]["lat_deg"]) == tags[0].place.lat_deg
    assert rows[0]["alt_datum"] == "ellipsoid"
    assert rows[1]["speed_m_s"] == ""
    assert "picture" not in rows[0]


def test_a_text_that_a_spreadsheet_would_run_is_made_harmless() -> None:
    tag = geotag()
    nasty: Geotag = replace(tag, provenance=replace(tag.provenance, choice='=HYPERLINK("http://x","y")'))
    (row,) = csv.DictReader(io.StringIO(to_csv([nasty])))
    assert row["choice"] == '\'=HYPERLINK("http://x","y")'
    assert float(row["velocity_north_m_s"]) == 0.0


@pytest.mark.parametrize(
    "text",
    [
        " =1+1",
        "\n=1",
        "\t=1",
        "\ufeff=1+1",
        "\u00a0\u200b@SUM(1)",
        "\x00-1",
        "＝1+1",
        " \ufeff+1",
        "\tplain",
        "\rplain",
    ],
)
def test_what_nobody_sees_before_a_formula_does_not_hide_it(text: str) -> None:
    tag = geotag()
    nasty = replace(tag, provenance=replace(tag.provenance, choice=text))
    (row,) = csv.DictReader(io.StringIO(to_csv([nasty]), newline=""))
    assert row["choice"] == f"'{text}"


@pytest.mark.parametrize("text", ["a=b", "the operator's box", " plain", "", "ü=1"])
def test_other_texts_stay_as_they_are(text: str) -> None:
    tag = geotag()
    (row,) = csv.DictReader(
        io.StringIO(to_csv([replace(tag, provenance=replace(tag.provenance, choice=text))]), newline="")
    )
    assert row["choice"] == text


def test_an_empty_log_gives_an_empty_collection_and_a_header() -> None:
    assert json.loads(to_geojson([])) == {"type": "FeatureCollection", "features": []}
    assert len(to_csv([]).splitlines()) == 1
