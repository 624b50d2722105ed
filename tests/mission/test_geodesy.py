"""Geodesy: literal numbers from formulas that share no code with PROJ, round trips, poles, and what 90 % means."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod
from scipy.integrate import quad
from scipy.stats import ncx2, norm

from mission.errors import AnswerError
from mission.geodesy import (
    Geodetic,
    altitude_in,
    ce90_m,
    enu_to_geodetic,
    error_ellipse,
    geodetic_to_enu,
    le90_m,
)
from mission.records import GeodeticOrigin, Matrix

SEOUL = GeodeticOrigin(37.2276, 126.8405, 30.0)

LATITUDES = st.floats(-89.9, 89.9)
LONGITUDES = st.floats(-180.0, 180.0)
METRES = st.floats(-5000.0, 5000.0)
SIGMAS = st.floats(0.01, 100.0)


def wgs84_ecef(lat_deg: float, lon_deg: float, alt_m: float) -> tuple[float, float, float]:
    """The textbook closed form, from the defining constants of WGS 84."""
    a, f = 6378137.0, 1.0 / 298.257223563
    e2 = f * (2.0 - f)
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    n = a / math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
    return (
        (n + alt_m) * math.cos(lat) * math.cos(lon),
        (n + alt_m) * math.cos(lat) * math.sin(lon),
        (n * (1.0 - e2) + alt_m) * math.sin(lat),
    )


def covariance(major: float, minor: float, azimuth: float) -> Matrix:
    axes = np.array([[math.sin(azimuth), -math.cos(azimuth)], [math.cos(azimuth), math.sin(azimuth)]])
    result: Matrix = axes @ np.diag([major**2, minor**2]) @ axes.T
    return result


def test_a_point_on_the_equator_by_hand() -> None:
    # East of (0, 0) by tan(1 deg) earth radii lies at longitude 1 deg, above the ellipsoid by a (1/cos(1 deg) - 1).
    a = 6378137.0
    place = enu_to_geodetic(np.array([a * math.tan(math.radians(1.0)), 0.0, 0.0]), GeodeticOrigin(0.0, 0.0, 0.0))
    assert place.lat_deg == pytest.approx(0.0, abs=1e-12)
    assert place.lon_deg == pytest.approx(1.0, abs=1e-11)
    assert place.alt_m == pytest.approx(971.5691, abs=1e-4)


def test_a_known_offset_gives_literal_coordinates() -> None:
    # From radii of curvature at 37.2276 N: N = 6385965.2 m, M = 6358795.2 m (computed apart from PROJ).
    place = enu_to_geodetic(np.array([100.0, 200.0, 10.0]), SEOUL)
    assert place.lat_deg == pytest.approx(37.2294021, abs=2e-7)
    assert place.lon_deg == pytest.approx(126.8416268, abs=2e-7)
    assert place.alt_m == pytest.approx(40.0 + (100.0**2 + 200.0**2) / (2 * 6.37e6), abs=1e-4)
    assert place.datum == "ellipsoid"


@given(LATITUDES, LONGITUDES, st.floats(-100.0, 9000.0), LATITUDES, LONGITUDES, st.floats(-100.0, 9000.0))
@settings(max_examples=60, deadline=None)
def test_the_distance_between_two_places_is_that_of_the_textbook_formula(
    lat1: float, lon1: float, alt1: float, lat2: float, lon2: float, alt2: float
) -> None:
    enu = geodetic_to_enu(lat2, lon2, alt2, GeodeticOrigin(lat1, lon1, alt1))
    chord = math.dist(wgs84_ecef(lat1, lon1, alt1), wgs84_ecef(lat2, lon2, alt2))
    assert float(np.linalg.norm(enu)) == pytest.approx(chord, abs=1e-6)


@given(st.floats(-89.0, 89.0), LONGITUDES, st.floats(0.0, 360.0), st.floats(1.0, 50.0))
@settings(max_examples=60, deadline=None)
def test_a_short_geodesic_has_its_azimuth_and_length_in_the_local_frame(
    lat: float, lon: float, azimuth_deg: float, metres: float
) -> None:
    lon2, lat2, _ = Geod(ellps="WGS84").fwd(lon, lat, azimuth_deg, metres)
    east, north, up = geodetic_to_enu(lat2, lon2, 0.0, GeodeticOrigin(lat, lon, 0.0))
    assert east == pytest.approx(metres * math.sin(math.radians(azimuth_deg)), abs=1e-4)
    assert north == pytest.approx(metres * math.cos(math.radians(azimuth_deg)), abs=1e-4)
    assert up == pytest.approx(-(metres**2) / (2 * 6.37e6), abs=1e-5)


@given(LATITUDES, LONGITUDES, st.floats(-100.0, 9000.0), METRES, METRES, st.floats(-100.0, 500.0))
@settings(max_examples=100, deadline=None)
def test_there_and_back_is_the_same_point(
    lat: float, lon: float, alt: float, east: float, north: float, up: float
) -> None:
    origin = GeodeticOrigin(lat, lon, alt, "amsl")
    place = enu_to_geodetic(np.array([east, north, up]), origin)
    assert place.datum == "amsl"
    assert geodetic_to_enu(place.lat_deg, place.lon_deg, place.alt_m, origin) == pytest.approx(
        [east, north, up], abs=1e-6
    )


@pytest.mark.parametrize("pole", [90.0, -90.0])
def test_at_a_pole_every_direction_leads_away_from_it(pole: float) -> None:
    origin = GeodeticOrigin(pole, 0.0, 0.0)
    for east, north in ((100.0, 0.0), (0.0, 100.0), (0.0, -100.0)):
        place = enu_to_geodetic(np.array([east, north, 0.0]), origin)
        assert abs(place.lat_deg) == pytest.approx(90.0 - math.degrees(100.0 / 6399593.6), abs=1e-9)
        assert geodetic_to_enu(place.lat_deg, place.lon_deg, place.alt_m, origin) == pytest.approx(
            [east, north, 0.0], abs=1e-6
        )


def test_across_the_antimeridian_the_longitude_changes_sign_and_the_point_does_not_jump() -> None:
    origin = GeodeticOrigin(-16.8, 179.9999, 5.0)
    place = enu_to_geodetic(np.array([50.0, 0.0, 0.0]), origin)
    assert place.lon_deg == pytest.approx(-179.99963, abs=1e-5)
    assert geodetic_to_enu(place.lat_deg, place.lon_deg + 360.0, place.alt_m, origin) == pytest.approx(
        [50.0, 0.0, 0.0], abs=1e-6
    )


@pytest.mark.parametrize("bad", [[math.nan, 0.0, 0.0], [0.0, math.inf, 0.0], [0.0, 0.0]])
def test_a_position_that_is_not_three_finite_numbers_is_refused(bad: list[float]) -> None:
    with pytest.raises(ValueError, match="three finite numbers"):
        enu_to_geodetic(np.array(bad), SEOUL)


@pytest.mark.parametrize("place", [(91.0, 0.0, 0.0), (0.0, math.nan, 0.0), (0.0, 0.0, math.inf)])
def test_a_place_that_is_not_on_earth_is_refused(place: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="not a place on earth"):
        geodetic_to_enu(*place, SEOUL)
    with pytest.raises(ValueError, match="not a place on earth"):
        enu_to_geodetic(np.zeros(3), GeodeticOrigin(*place))


def test_threads_share_the_transforms() -> None:
    expected = enu_to_geodetic(np.array([10.0, 20.0, 3.0]), SEOUL)
    answers: list[Geodetic] = []
    threads = [
        threading.Thread(
            target=lambda: answers.extend(enu_to_geodetic(np.array([10.0, 20.0, 3.0]), SEOUL) for _ in range(50))
        )
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers == [expected] * 200


# --- altitudes


def test_altitudes_change_datum_only_with_what_is_known() -> None:
    place = Geodetic(37.0, 127.0, 120.0, "ellipsoid")
    assert altitude_in("ellipsoid", place) == 120.0
    assert altitude_in("amsl", place, geoid_separation_m=23.5) == pytest.approx(96.5)
    assert altitude_in("home", place, geoid_separation_m=23.5, home_amsl_m=90.0) == pytest.approx(6.5)
    above_home = Geodetic(37.0, 127.0, 6.5, "home")
    assert altitude_in("amsl", above_home, home_amsl_m=90.0) == pytest.approx(96.5)
    assert altitude_in("ellipsoid", above_home, geoid_separation_m=23.5, home_amsl_m=90.0) == pytest.approx(120.0)
    with pytest.raises(AnswerError, match="geoid separation is unknown"):
        altitude_in("amsl", place)
    with pytest.raises(AnswerError, match="home altitude is unknown"):
        altitude_in("home", place, geoid_separation_m=23.5)
    with pytest.raises(AnswerError, match="geoid separation is unknown"):
        altitude_in("amsl", place, geoid_separation_m=math.nan)


# --- error ellipse, CE90, LE90


@pytest.mark.parametrize(
    ("azimuth_deg", "major", "minor"), [(0.0, 2.0, 1.0), (30.0, 2.0, 1.0), (90.0, 5.0, 0.5), (150.0, 3.0, 2.9)]
)
def test_the_ellipse_has_the_axes_and_the_azimuth_that_made_the_covariance(
    azimuth_deg: float, major: float, minor: float
) -> None:
    ellipse = error_ellipse(covariance(major, minor, math.radians(azimuth_deg)))
    assert ellipse.semi_major_m == pytest.approx(2.4477468306808161 * major)
    assert ellipse.semi_minor_m == pytest.approx(2.4477468306808161 * minor)
    assert math.degrees(ellipse.azimuth_rad) == pytest.approx(azimuth_deg, abs=1e-6)


@given(SIGMAS, SIGMAS, st.floats(0.0, 3.14), st.floats(0.5, 0.99))
@settings(max_examples=50, deadline=None)
def test_the_outline_lies_at_one_mahalanobis_distance_and_turns_counter_clockwise(
    s1: float, s2: float, azimuth: float, probability: float
) -> None:
    spread = covariance(max(s1, s2), min(s1, s2), azimuth)
    outline = error_ellipse(spread, probability).outline(16)
    distance = np.einsum("ij,jk,ik->i", outline, np.linalg.inv(spread), outline)
    assert distance == pytest.approx(np.full(16, -2.0 * math.log(1.0 - probability)), rel=1e-6)
    after = np.roll(outline, -1, axis=0)
    assert float(np.sum(outline[:, 0] * after[:, 1] - outline[:, 1] * after[:, 0])) > 0.0


def test_ce90_of_a_circle_and_of_a_line_are_the_known_constants() -> None:
    assert ce90_m(np.eye(2)) == pytest.approx(2.1459660262893, abs=1e-10)
    assert ce90_m(np.diag([4.0, 0.0])) == pytest.approx(2.0 * 1.6448536269515, abs=1e-10)
    assert ce90_m(np.zeros((2, 2))) == 0.0


@given(SIGMAS, SIGMAS, st.floats(0.0, 3.14))
@settings(max_examples=25, deadline=None)
def test_ce90_holds_exactly_nine_tenths_of_the_probability(s1: float, s2: float, azimuth: float) -> None:
    major, minor = max(s1, s2), min(s1, s2)
    radius = ce90_m(covariance(major, minor, azimuth))

    def strip(x: float) -> float:  # P(|y| < sqrt(R^2 - x^2)) at a given x along the major axis
        return float(norm.pdf(x, scale=major) * (1 - 2 * norm.sf(math.sqrt(radius**2 - x**2) / minor)))

    # Near the ends the strip falls off within minor^2/radius; give the quadrature that point.
    corner = radius * (1.0 - min(0.5, 10.0 * (minor / radius) ** 2))
    inside = 2.0 * (quad(strip, 0.0, corner, epsabs=1e-10)[0] + quad(strip, corner, radius, epsabs=1e-10)[0])
    assert inside == pytest.approx(0.9, abs=1e-6)


def test_ce90_agrees_with_noncentral_chi_square_by_conditioning() -> None:
    # P(r < R) = E over x of P(chi2_1 < (R^2 - x^2)/s2^2), here s1 = 1, s2 = 0.5; ncx2 with nc -> 0 is chi2.
    radius = ce90_m(np.diag([1.0, 0.25]))
    grid = np.linspace(-radius, radius, 200001)
    inner = ncx2.cdf((radius**2 - grid**2) / 0.25, 1, 1e-12)
    assert float(np.trapezoid(norm.pdf(grid) * inner, grid)) == pytest.approx(0.9, abs=1e-6)


def test_le90_is_one_point_six_four_five_sigma() -> None:
    assert le90_m(4.0) == pytest.approx(3.2897072539029)
    with pytest.raises(ValueError, match="not negative"):
        le90_m(-1e-12)
    with pytest.raises(ValueError, match="finite"):
        le90_m(math.nan)


@pytest.mark.parametrize("bad", [np.diag([1.0, -0.5]), np.full((2, 2), math.nan), np.eye(3)])
def test_what_is_not_a_covariance_is_refused(bad: Matrix) -> None:
    for function in (ce90_m, error_ellipse):
        with pytest.raises(ValueError, match="covariance"):
            function(bad)
    with pytest.raises(ValueError, match="between 0 and 1"):
        error_ellipse(np.eye(2), 1.0)
