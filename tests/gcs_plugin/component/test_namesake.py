"""Another camera with our ids is told, and a box that may be meant for it starts no flight."""

from __future__ import annotations

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component import LocateOrder
from gcs_plugin.component.identity import Identity, heartbeat
from tests.support.component_bench import Bench

OURS = (1, 100)
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
BOX = (mavlink.MAV_CMD_CAMERA_TRACK_RECTANGLE, 0.2, 0.2, 0.6, 0.9)


def other_camera(bench: Bench) -> None:
    camera = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    bench.say(camera, OURS)


def test_another_camera_is_told_once_a_minute_and_gets_its_boxes_to_itself() -> None:
    bench = Bench()
    for _ in range(50):
        other_camera(bench)
        bench.turn(1.0)
    assert bench.texts().count("another component has our id 1/100") == 1
    for command in (BOX, (mavlink.MAV_CMD_CAMERA_TRACK_POINT, 0.5, 0.5)):
        bench.command(*command)
        assert bench.turn(0.1) is None
        assert bench.acks() == [(command[0], REJECTED)]
    for _ in range(15):
        other_camera(bench)
        bench.turn(1.0)
    assert "set orders.component" in bench.texts()


def test_an_order_of_our_own_is_obeyed_beside_it() -> None:
    bench = Bench()
    other_camera(bench)
    bench.command(mavlink.MAV_CMD_USER_1)
    assert bench.turn() == LocateOrder()


def test_a_second_program_like_ours_is_another_too() -> None:
    bench = Bench()
    bench.say(heartbeat(Identity(1, instance=7), busy=False), OURS)
    bench.turn()
    assert "another component has our id" in bench.texts()


def test_our_own_heartbeat_brought_back_by_the_network_is_ours() -> None:
    bench = Bench()
    bench.turn(1.0)
    (ours,) = bench.take("HEARTBEAT")[-1:]
    bench.say(ours, OURS)
    bench.command(*BOX)
    assert isinstance(bench.turn(), LocateOrder)


def test_when_it_is_gone_boxes_are_ours_again() -> None:
    bench = Bench()
    other_camera(bench)
    bench.turn()
    bench.turn(10.0)
    bench.command(*BOX)
    assert isinstance(bench.turn(), LocateOrder)
