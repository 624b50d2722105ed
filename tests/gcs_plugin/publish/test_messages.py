"""What goes over the wire has the standard's units, datum and "unknown"."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from gcs_plugin.publish.messages import (
    Link,
    Message,
    StatusTexts,
    camera_tracking_geo_status,
    set_region_of_interest,
    statustexts,
)
from mission.errors import AnswerError, LinkError
from mission.geodesy import Geodetic, enu_to_geodetic
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.pilot.loopback import loopback_socket
from tests.support.fake_autopilot import PX4, FakeLink, Vehicle
from tests.support.sample import ORIGIN, estimate, origin


def received(message: Message) -> Message:
    """As the other end reads it."""
    (parsed,) = mavlink.MAVLink(None).parse_buffer(message.pack(mavlink.MAVLink(None, 1, 191)))
    return parsed


def link() -> FakeLink:
    return FakeLink(Vehicle(PX4, []))


def test_geo_status_has_the_answer_in_the_messages_units() -> None:
    drone = np.array([0.1, 0.0, 3.0])
    message = received(
        camera_tracking_geo_status(estimate(velocity=(0.6, -0.8, 0.1)), ORIGIN, drone, geoid_separation_m=23.5)
    )
    place = enu_to_geodetic(np.array([0.1, 9.0, 0.9]), ORIGIN)
    assert message.get_msgId() == 276
    assert message.tracking_status == mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE
    assert (message.lat, message.lon) == (round(place.lat_deg * 1e7), round(place.lon_deg * 1e7))
    assert message.alt == pytest.approx(7.4, abs=1e-3)  # above mean sea level
    assert message.h_acc == pytest.approx(math.sqrt(0.04 + 0.16))
    assert message.v_acc == pytest.approx(0.1)
    assert (message.vel_n, message.vel_e, message.vel_d) == pytest.approx((-0.8, 0.6, -0.1))
    assert message.vel_acc == pytest.approx(math.sqrt(0.0025 + 0.0049 + 0.0001))
    assert message.dist == pytest.approx(math.hypot(9.0, 2.1))
    assert message.hdg == pytest.approx(math.atan2(0.6, -0.8))
    # Across the course (0.8, 0.6): variance 0.64 * 0.0025 + 0.36 * 0.0049; the speed is 1.
    assert message.hdg_acc == pytest.approx(math.sqrt(0.64 * 0.0025 + 0.36 * 0.0049))


def test_what_is_not_known_is_not_a_number() -> None:
    still = replace(estimate(velocity=None), covariance=None)
    message = received(camera_tracking_geo_status(still, ORIGIN, None))
    unknown = ["alt", "h_acc", "v_acc", "vel_n", "vel_e", "vel_d", "vel_acc", "dist", "hdg", "hdg_acc"]
    assert all(math.isnan(getattr(message, name)) for name in unknown)


def test_the_altitude_needs_what_its_datum_needs() -> None:
    assert received(camera_tracking_geo_status(estimate(), origin("amsl"), None)).alt == pytest.approx(30.9, abs=1e-3)
    home = received(camera_tracking_geo_status(estimate(), origin("home"), None, home_amsl_m=70.0))
    assert home.alt == pytest.approx(100.9, abs=1e-3)
    assert math.isnan(received(camera_tracking_geo_status(estimate(), origin("home"), None)).alt)


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.05, 0.05, 0.0)])
def test_a_target_that_may_as_well_stand_has_no_course(velocity: tuple[float, float, float]) -> None:
    message = received(camera_tracking_geo_status(estimate(velocity=velocity), ORIGIN, None))
    assert math.isnan(message.hdg)
    assert math.isnan(message.hdg_acc)
    assert message.vel_e == pytest.approx(velocity[0])


def test_the_region_of_interest_is_above_mean_sea_level_and_says_so() -> None:
    there = link()
    set_region_of_interest(there, Geodetic(37.2276812, -126.8405001, 30.9, "ellipsoid"), geoid_separation_m=23.5)
    ((command, params, x, y, z, frame),) = there.commands
    assert command == 195
    assert params == (0.0, 0.0, 0.0, 0.0)
    assert (x, y) == (372276812, -1268405001)
    assert z == pytest.approx(7.4)
    assert frame == mavlink.MAV_FRAME_GLOBAL


def test_without_the_geoid_nothing_is_sent() -> None:
    there = link()
    with pytest.raises(AnswerError, match="geoid separation is unknown"):
        set_region_of_interest(there, Geodetic(37.0, 127.0, 30.9, "ellipsoid"))
    assert there.commands == []


def test_a_refused_region_of_interest_is_named_and_so_is_silence() -> None:
    there, place = link(), Geodetic(37.0, 127.0, 30.9, "amsl")
    there.command_result = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    with pytest.raises(AnswerError, match="temporarily rejected"):
        set_region_of_interest(there, place)
    there.command_result = LinkError("the autopilot did not answer", "Check the link")
    with pytest.raises(AnswerError, match="not set: the autopilot did not answer"):
        set_region_of_interest(there, place)


def joined(messages: list[Message]) -> str:
    """As a ground station joins them."""
    parts = sorted((received(message) for message in messages), key=lambda m: m.chunk_seq)
    return "".join(part.text for part in parts)


@given(st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=300))
def test_a_text_is_joined_again_from_its_chunks(text: str) -> None:
    messages = statustexts(text, mavlink.MAV_SEVERITY_NOTICE, 7)
    assert joined(messages) == text
    assert all(message.severity == mavlink.MAV_SEVERITY_NOTICE for message in messages)
    assert all(len(message.text) <= 50 for message in messages)


@given(st.text(max_size=300))
def test_any_text_can_be_sent_and_is_one_line_of_ascii(text: str) -> None:
    sent = joined(statustexts(text, mavlink.MAV_SEVERITY_INFO, 7))
    assert sent.isascii()
    assert sent == "" or sent.isprintable()


def test_accents_go_and_line_ends_become_spaces() -> None:
    assert joined(statustexts("Søren, José\nat 9\u00a0m \u2603", 6, 1)) == "S?ren, Jose at 9 m ?"


@pytest.mark.parametrize(("length", "chunks"), [(0, 1), (50, 1), (51, 2), (100, 3), (101, 3)])
def test_only_a_long_text_has_an_id_and_its_last_chunk_holds_a_null(length: int, chunks: int) -> None:
    messages = statustexts("x" * length, mavlink.MAV_SEVERITY_INFO, 9)
    assert [m.chunk_seq for m in messages] == list(range(chunks))
    assert {m.id for m in messages} == ({0} if chunks == 1 else {9})
    if chunks > 1:
        assert [len(m.text) < 50 for m in messages] == [False] * (chunks - 1) + [True]


def test_each_text_has_an_id_of_its_own_that_fits_its_field() -> None:
    there = link()
    texts = StatusTexts(there)
    for _ in range(3):
        texts.send("y" * 60)
    assert [m.id for m in there.sent] == [1, 1, 2, 2, 3, 3]
    for wrong in (0, 65536):
        with pytest.raises(ValueError, match="1 to 65535"):
            statustexts("", 6, wrong)


def test_the_real_link_is_a_link() -> None:
    real = MavlinkLink(loopback_socket(), source_system=245, source_component=191, heartbeat=False)
    try:
        there: Link = real  # mypy checks the rest
        StatusTexts(there).send("nobody there yet")
        assert real.dropped == 1
    finally:
        real.close()
