"""What the component sends by itself: 275 while it tracks, 276 again, at the intervals asked for."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component.tracking import TrackedBox
from mission.records import Box
from mission.track import Track
from mission.track.track import TrackState
from tests.support.component_bench import Bench

IMAGE, GEO = "CAMERA_TRACKING_IMAGE_STATUS", "CAMERA_TRACKING_GEO_STATUS"
SET, GET = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL
ACCEPTED, DENIED = 0, 2


def seen(state: TrackState = "tracking") -> TrackedBox:
    track = Track(1, 100.0, state, Box(160.0, 120.0, 64.0, 240.0), (192.0, 240.0), 1.0, 240.0, 0.03, 1.0)
    return TrackedBox(track, 640, 480)


def run(bench: Bench, seconds: float, step_s: float = 0.02) -> None:
    for _ in range(round(seconds / step_s)):
        bench.step(step_s)


def test_nothing_is_tracked_nothing_is_sent() -> None:
    bench = Bench()
    run(bench, 5.0)
    assert bench.take(IMAGE, GEO) == []


def test_the_box_goes_out_twice_a_second_as_fractions_of_the_picture() -> None:
    bench = Bench()
    bench.component.tracking(seen())
    run(bench, 5.0)
    sent = bench.take(IMAGE)
    assert 9 <= len(sent) <= 11
    last = sent[-1]
    assert last.tracking_status == mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE
    assert last.tracking_mode == mavlink.CAMERA_TRACKING_MODE_RECTANGLE
    assert (last.rec_top_x, last.rec_top_y) == (0.25, 0.25)
    assert (last.rec_bottom_x, last.rec_bottom_y) == (pytest.approx(0.35), 0.75)
    assert (last.point_x, last.point_y) == (pytest.approx(0.3), 0.5)


def test_the_box_is_taken_off_the_screen_at_the_end() -> None:
    bench = Bench()
    bench.component.tracking(seen())
    run(bench, 1.0)
    bench.take(IMAGE)
    bench.component.ended(ACCEPTED)
    run(bench, 5.0)
    assert [m.tracking_status for m in bench.take(IMAGE)] == [mavlink.CAMERA_TRACKING_STATUS_FLAGS_IDLE]


def test_a_lost_target_is_an_error_status() -> None:
    bench = Bench()
    bench.component.tracking(seen("lost"))
    run(bench, 0.6)
    assert {m.tracking_status for m in bench.take(IMAGE)} == {mavlink.CAMERA_TRACKING_STATUS_FLAGS_ERROR}


@pytest.mark.parametrize(
    ("interval_us", "per_10_s"), [(100_000.0, 100), (1.0, 200), (1e-30, 200), (0.0, 20), (-1.0, 0), (1e12, 1)]
)
def test_stations_choose_the_interval_within_sane_limits(interval_us: float, per_10_s: int) -> None:
    bench = Bench()
    bench.component.tracking(seen())
    bench.command(SET, 275.0, interval_us)
    bench.step()
    assert bench.acks() == [(SET, ACCEPTED)]
    bench.take()
    run(bench, 10.0)
    assert len(bench.take(IMAGE)) == pytest.approx(per_10_s, abs=2)


@pytest.mark.parametrize(
    ("message_id", "interval_us"),
    [(275.0, -2.0), (275.0, math.nan), (275.0, -math.inf), (30.0, 1e5), (math.nan, 1e5), (275.5, 1e5)],
)
def test_intervals_without_a_meaning_are_denied(message_id: float, interval_us: float) -> None:
    bench = Bench()
    bench.command(SET, message_id, interval_us)
    bench.step()
    assert bench.acks() == [(SET, DENIED)]


def test_asking_for_the_interval_over_and_over_does_not_make_a_flood() -> None:
    bench = Bench()
    bench.component.tracking(seen())
    for _ in range(500):
        bench.command(SET, 275.0, 0.0)
        bench.step(0.02)
    assert len(bench.take(IMAGE)) == pytest.approx(20, abs=2)


def test_the_interval_can_be_read() -> None:
    bench = Bench()
    bench.command(SET, 275.0, 10.0)
    bench.command(GET, 275.0)
    bench.command(GET, 276.0)
    bench.command(GET, 30.0)
    bench.step()
    assert [(m.message_id, m.interval_us) for m in bench.take("MESSAGE_INTERVAL")] == [
        (275, 50_000),
        (276, -1),
        (30, 0),
    ]


def test_the_answer_is_sent_again_at_the_interval_asked_for() -> None:
    bench = Bench()
    answer = mavlink.MAVLink_camera_tracking_geo_status_message(1, 473977642, 85457195, *([1.0] * 10))
    bench.command(SET, 276.0, 1e6)
    run(bench, 3.0)
    assert bench.take(GEO) == []
    bench.wire.answer = answer
    run(bench, 5.0)
    sent = bench.take(GEO)
    assert len(sent) == pytest.approx(5, abs=1)
    assert {m.lat for m in sent} == {473977642}


def test_the_answer_can_be_asked_for_once() -> None:
    bench = Bench()
    bench.wire.answer = mavlink.MAVLink_camera_tracking_geo_status_message(1, 473977642, 85457195, *([1.0] * 10))
    bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 276.0)
    run(bench, 3.0)
    assert len(bench.take(GEO)) == 1
