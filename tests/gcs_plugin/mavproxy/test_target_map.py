"""Markers and their 95 % areas, without MAVProxy's map."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_plugin.mavproxy.news import Fix
from gcs_plugin.mavproxy.target_map import marker_of, marker_of_fix
from mission.geodesy import geodetic_to_enu
from mission.records import GeodeticOrigin
from tests.support.sample import geotag


def around(place: tuple[float, float], outline: tuple[tuple[float, float], ...]) -> np.ndarray:
    origin = GeodeticOrigin(place[0], place[1], 0.0)
    return np.array([geodetic_to_enu(lat, lon, 0.0, origin)[:2] for lat, lon in outline])


def test_the_ellipse_of_a_geotag_has_its_axes_and_is_closed() -> None:
    tag = geotag()
    marker = marker_of(tag)
    (outline,) = marker.outlines
    radii = np.linalg.norm(around(marker.place, outline), axis=1)
    assert outline[0] == outline[-1]
    assert radii.max() == pytest.approx(tag.ellipse.semi_major_m, rel=0.01)
    assert radii.min() == pytest.approx(tag.ellipse.semi_minor_m, rel=0.01)


def test_the_circle_of_an_answer_off_the_wire_holds_the_truth_in_95_of_100() -> None:
    sigma_m = 2.0
    marker = marker_of_fix(Fix(60.0, 25.0, math.hypot(sigma_m, sigma_m), 0.0), 4)
    (outline,) = marker.outlines
    radii = np.linalg.norm(around(marker.place, outline), axis=1)
    assert radii == pytest.approx(radii.mean(), rel=0.01)
    errors = np.random.default_rng(2).normal(0.0, sigma_m, (20_000, 2))
    assert np.mean(np.linalg.norm(errors, axis=1) < radii.mean()) == pytest.approx(0.95, abs=0.01)


def test_an_answer_without_accuracy_has_a_marker_only() -> None:
    assert marker_of_fix(Fix(60.0, 25.0, math.nan, 0.0), 4).outlines == ()
