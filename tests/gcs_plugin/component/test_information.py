"""Discovery: heartbeat, identity, and both ways in which stations ask."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component.information import REQUEST_COMMANDS
from tests.support.component_bench import Bench

ACCEPTED, DENIED, UNSUPPORTED = 0, 2, 3
BROADCAST = [(0, 0), (1, 0), (1, 1), (2, 100)]


def test_a_camera_heartbeat_goes_out_once_a_second_of_the_loop() -> None:
    bench = Bench()
    for _ in range(50):
        bench.turn(0.1)
    beats = bench.take("HEARTBEAT")
    assert 5 <= len(beats) <= 6
    assert {m.type for m in beats} == {mavlink.MAV_TYPE_CAMERA}
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in beats} == {(1, 100)}


def test_a_loop_that_hangs_is_a_heart_that_stands_still() -> None:
    bench = Bench()
    bench.turn()
    bench.take()
    bench.now += 30.0
    assert bench.take() == []
    bench.turn()
    assert len(bench.take("HEARTBEAT")) == 1  # none is made up for


@pytest.mark.parametrize(("command", "message_id"), REQUEST_COMMANDS.items())
def test_the_old_request_and_the_new_one_bring_the_same_message(command: int, message_id: int) -> None:
    bench = Bench()
    bench.turn()
    bench.take()
    bench.command(command, 1.0)
    bench.turn()
    old = bench.take()
    bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id)
    bench.turn()
    new = bench.take()
    wanted = mavlink.mavlink_map[message_id].msgname
    for sent, asked in ((old, command), (new, mavlink.MAV_CMD_REQUEST_MESSAGE)):
        assert [m.get_type() for m in sent] == [wanted, "COMMAND_ACK"]
        assert (sent[-1].command, sent[-1].result) == (asked, ACCEPTED)
        assert (sent[-1].target_system, sent[-1].target_component) == (255, 190)


def test_the_camera_offers_tracking_an_answer_and_a_video() -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION, 1.0)
    bench.command(mavlink.MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION, 1.0)
    bench.turn()
    (camera,) = bench.take("CAMERA_INFORMATION")
    for flag in ("TRACKING_POINT", "TRACKING_RECTANGLE", "TRACKING_GEO_STATUS", "VIDEO_STREAM"):
        assert camera.flags & getattr(mavlink, f"CAMERA_CAP_FLAGS_HAS_{flag}")
    assert 2.0 * math.atan(camera.sensor_size_h / 2.0 / camera.focal_length) == pytest.approx(1.1)
    assert camera.firmware_version == 1 | 2 << 8 | 3 << 16
    (stream,) = bench.take("VIDEO_STREAM_INFORMATION")
    assert (stream.uri, stream.type) == ("rtsp://camera/stream", mavlink.VIDEO_STREAM_TYPE_RTSP)


@pytest.mark.parametrize("message_id", [0.5, -1.0, 1e9, math.nan, math.inf, 30.0, 276.0])
def test_a_message_that_there_is_not_is_denied(message_id: float) -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id)
    bench.turn()
    assert bench.acks() == [(512, DENIED)]


def test_a_command_that_is_none_of_ours_is_unsupported() -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    bench.turn()
    assert bench.acks() == [(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, UNSUPPORTED)]


@pytest.mark.parametrize("target", BROADCAST)
def test_commands_to_all_and_to_others_are_left_alone(target: tuple[int, int]) -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_USER_1, target=target)
    bench.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, target=target)
    assert bench.turn() is None
    assert bench.acks() == []


def test_a_command_int_is_a_command_too() -> None:
    bench = Bench()
    bench.say(
        mavlink.MAVLink_command_int_message(1, 100, 0, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 0, 259, 0, 0, 0, 0, 0, 0)
    )
    bench.turn()
    assert len(bench.take("CAMERA_INFORMATION")) == 1
