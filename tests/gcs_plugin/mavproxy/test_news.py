"""What the camera component says, remembered."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.mavproxy.arguments import PictureSize
from gcs_plugin.mavproxy.news import SILENT_S, News
from gcs_plugin.publish.messages import statustexts


def told(news: News, text: str, text_id: int = 3) -> list[str]:
    return [said for part in statustexts(text, 6, text_id) if (said := news.take(_parsed(part), 0.0))]


def _parsed(message: Any) -> Any:
    (parsed,) = mavlink.MAVLink(None).parse_buffer(message.pack(mavlink.MAVLink(None, 1, 100)))
    return parsed


def geo_status(lat: int, lon: int, h_acc: float = 0.5) -> Any:
    rest = (0.1, 0.3, 0.4, 0.0, 0.1, 9.0, 0.0, 0.1)
    return _parsed(mavlink.MAVLink_camera_tracking_geo_status_message(1, lat, lon, 30.0, h_acc, *rest))


@pytest.mark.parametrize("text", ["sidestep: hovering", "x" * 50, "y" * 51, "z" * 100, "a " * 70 + "end"])
def test_a_text_of_any_length_is_told_once_and_whole(text: str) -> None:
    news = News()
    assert told(news, text) == [text.strip()]
    assert told(news, text, text_id=4) == [text.strip()]


def test_the_number_of_the_target_is_read_from_the_text_that_says_the_result() -> None:
    news = News()
    told(news, "target 12: 37.227681 126.840501 CE90 0.7 m")
    told(news, "sidestep: giving control back, holding")
    assert news.number == 12


def test_a_text_whose_end_was_lost_does_not_spoil_the_next_one() -> None:
    news = News()
    first, *_ = statustexts("lost " * 30, 6, 1)
    assert news.take(_parsed(first), 0.0) == ""
    assert told(news, "found " * 30, text_id=2) == [("found " * 30).strip()]


def test_the_place_and_its_accuracy_come_from_276() -> None:
    news = News()
    news.take(geo_status(372276810, 1268405010), 0.0)
    assert news.fix is not None
    assert dataclasses.astuple(news.fix) == pytest.approx((37.227681, 126.840501, 0.5, 0.5))
    news.take(geo_status(372276810, 1268405010, h_acc=math.nan), 0.0)
    assert news.fix is not None
    assert math.isnan(news.fix.horizontal_sigma_m)


@pytest.mark.parametrize(("lat", "lon"), [(0, 0), (910000000, 0), (0, 2000000000), (-2147483648, 5)])
def test_a_place_that_cannot_be_is_no_place(lat: int, lon: int) -> None:
    news = News()
    news.take(geo_status(lat, lon), 0.0)
    assert news.fix is None


def test_presence_ends_with_the_heartbeat() -> None:
    news = News()
    assert not news.present(0.0)
    news.take(_parsed(mavlink.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3)), 10.0)
    assert news.present(10.0 + 0.9 * SILENT_S)
    assert not news.present(10.0 + 1.1 * SILENT_S)


def test_the_size_of_the_picture_is_learnt_and_an_empty_one_is_not() -> None:
    news = News()
    for width, height in ((640, 480), (0, 0)):
        news.take(
            _parsed(
                mavlink.MAVLink_camera_information_message(
                    0, [0] * 32, [0] * 32, 0, 0.0, 0.0, 0.0, width, height, 0, 0, 0, b""
                )
            ),
            0.0,
        )
    assert news.picture == PictureSize(640, 480)


@given(st.binary(max_size=50), st.integers(0, 65535), st.integers(0, 255))
def test_any_text_is_taken(text: bytes, text_id: int, chunk: int) -> None:
    said = News().take(_parsed(mavlink.MAVLink_statustext_message(6, text, text_id, chunk)), 0.0)
    assert said.isprintable()
