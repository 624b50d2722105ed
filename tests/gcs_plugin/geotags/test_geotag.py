"""A geotag says where, in which datum, how sure, and refuses what it cannot say honestly."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

from gcs_plugin.geotags.geotag import COLUMNS
from gcs_plugin.geotags.log import Provenance, make_geotag
from gcs_plugin.geotags.row import from_json, to_json
from mission.errors import AnswerError
from mission.geodesy import ce90_m, geodetic_to_enu
from tests.support.sample import NOON, ORIGIN, estimate, geotag, jpeg, origin


def test_it_stands_where_the_estimate_is() -> None:
    tag = geotag()
    back = geodetic_to_enu(tag.place.lat_deg, tag.place.lon_deg, tag.place.alt_m, ORIGIN)
    assert back == pytest.approx([0.1, 9.0, 0.9], abs=1e-6)
    assert tag.place.datum == "ellipsoid"
    assert tag.drone is not None
    assert tag.drone.alt_m == pytest.approx(33.0)


def test_its_errors_are_those_of_the_covariance() -> None:
    tag = geotag()
    assert tag.ce90_m == pytest.approx(ce90_m(np.array([[0.04, 0.03], [0.03, 0.16]])))
    assert tag.le90_m == pytest.approx(0.16448536, abs=1e-8)
    assert tag.ellipse.semi_major_m > tag.ellipse.semi_minor_m > 0.0


@pytest.mark.parametrize(
    ("velocity", "speed", "course_deg"),
    [((0.6, 0.0, 0.0), 0.6, 90.0), ((-0.3, -0.4, 0.1), 0.5, 216.86989764584402), ((0.0, 1.0, 0.0), 1.0, 0.0)],
)
def test_speed_is_horizontal_and_course_clockwise_from_north(
    velocity: tuple[float, float, float], speed: float, course_deg: float
) -> None:
    tag = geotag(where=estimate(velocity=velocity))
    assert tag.speed_m_s == pytest.approx(speed)
    assert tag.course_rad == pytest.approx(math.radians(course_deg))


def test_without_a_velocity_there_is_no_speed_and_no_course() -> None:
    tag = geotag(where=estimate(velocity=None))
    assert (tag.speed_m_s, tag.course_rad) == (None, None)
    assert geotag(where=estimate(velocity=(0.0, 0.0, 0.0))).course_rad is None


def test_heights_are_given_only_where_the_datum_can_be_had() -> None:
    both = geotag()
    assert both.ellipsoid_height_m == pytest.approx(30.9, abs=1e-4)
    assert both.amsl_m == pytest.approx(7.4, abs=1e-4)
    unknown = geotag(geoid_separation_m=None)
    assert unknown.ellipsoid_height_m is not None
    assert unknown.amsl_m is None
    sea = geotag(at=origin("amsl"), geoid_separation_m=None)
    assert sea.amsl_m == pytest.approx(30.9, abs=1e-4)
    assert sea.ellipsoid_height_m is None
    home = geotag(at=origin("home"))
    assert (home.amsl_m, home.ellipsoid_height_m, home.place.datum) == (None, None, "home")


def test_an_answer_without_covariance_or_with_a_number_that_is_not_finite_is_not_published() -> None:
    with pytest.raises(AnswerError, match="no covariance"):
        geotag(where=replace(estimate(), covariance=None))
    with pytest.raises(AnswerError, match="not finite"):
        geotag(where=replace(estimate(), position_enu_m=np.array([0.0, math.nan, 0.0])))
    with pytest.raises(AnswerError, match="not finite"):
        geotag(where=replace(estimate(), depth_m=math.nan))
    with pytest.raises(AnswerError, match="not finite"):
        geotag(geoid_separation_m=math.inf)
    broken = np.eye(6)
    broken[4, 4] = math.inf
    with pytest.raises(AnswerError, match="not finite"):
        geotag(where=replace(estimate(), covariance=broken))


def test_what_is_no_covariance_is_not_published() -> None:
    impossible = np.eye(6)
    impossible[0, 1] = impossible[1, 0] = 1.5
    for wrong in (impossible, np.diag([1.0, 1.0, -0.1, 1.0, 1.0, 1.0])):
        with pytest.raises(AnswerError, match="covariance is impossible"):
            geotag(where=replace(estimate(), covariance=wrong))


def test_time_is_utc_to_the_millisecond_whatever_the_zone_it_came_in() -> None:
    there = NOON.astimezone(timezone(timedelta(hours=9))).replace(microsecond=250_999)
    tag = make_geotag(estimate(), ORIGIN, id="x", time_utc=there, provenance=Provenance("s", "f"))
    assert tag.time_utc == NOON
    assert tag.time_utc.utcoffset() == timedelta(0)
    with pytest.raises(ValueError, match="time zone"):
        make_geotag(estimate(), ORIGIN, id="x", time_utc=datetime(2026, 1, 1), provenance=Provenance("s", "f"))


def test_a_picture_is_told_by_its_first_bytes() -> None:
    assert geotag().picture_type == ""
    assert geotag(picture=jpeg()).picture_type == "image/jpeg"
    assert geotag(picture=b"\x89PNG\r\n\x1a\n...").picture_type == "image/png"
    with pytest.raises(ValueError, match="JPEG or PNG"):
        geotag(picture=b"GIF89a")


def test_every_altitude_of_the_row_names_its_datum() -> None:
    names = [column.name for column in COLUMNS]
    assert len(names) == len(set(names))
    assert "alt_datum" in names
    assert "drone_alt_datum" in names


def test_a_videos_password_is_in_no_geotag_nor_in_one_that_an_older_version_kept() -> None:
    tag = replace(geotag(), provenance=Provenance("s", "f", video="rtsp://pilot:s3cr3t@camera/live?token=s3cr3t"))
    assert tag.provenance.video == "rtsp://***@camera/live?***"
    assert b"s3cr3t" not in to_json(tag)
    old = to_json(tag).replace(b"rtsp://***@camera/live?***", b"rtsp://pilot:s3cr3t@camera/live")
    assert b"s3cr3t" in old
    assert b"s3cr3t" not in to_json(from_json(old))


@pytest.mark.parametrize("digits", [400, 5000])
@pytest.mark.parametrize("cell", ["lat_deg", "depth_m", "sightings", "chi2", "number"])
def test_a_number_of_hundreds_of_digits_is_no_number(cell: str, digits: int) -> None:
    absurd = re.sub(rf'("{cell}": )[^,]+'.encode(), rb"\g<1>1" + digits * b"0", to_json(geotag()))
    assert digits * b"0" in absurd
    with pytest.raises(ValueError, match=r"number|digits"):
        from_json(absurd)


def test_brackets_without_end_are_no_geotag() -> None:
    with pytest.raises(ValueError, match="brackets"):
        from_json(b"[" * 200_000)
