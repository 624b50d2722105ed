"""The mission protocol, and missions flown."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.flavour import Mode
from tests.support.autopilot_bench import Bench, Peer

ACCEPTED: int = mavlink.MAV_MISSION_ACCEPTED
RELATIVE: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def waypoint(bench: Bench, seq: int, east: float, north: float, up: float) -> Any:
    lat, lon, _ = bench.autopilot.place.geodetic((east, north, 0.0))
    where = (round(lat * 1e7), round(lon * 1e7), up)
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, seq, RELATIVE, mavlink.MAV_CMD_NAV_WAYPOINT, 0, 1, 0, 0, 0, 0, *where
    )


def upload(bench: Bench, peer: Peer, items: list[Any]) -> int:
    """Answer every question with MISSION_ITEM_INT; the type of the final ack."""
    peer.received.clear()
    peer.send(mavlink.MAVLink_mission_count_message(1, 1, len(items)))
    for _ in range(len(items) + 1):
        asked = peer.of("MISSION_REQUEST") + peer.of("MISSION_REQUEST_INT")
        if peer.of("MISSION_ACK") or not asked:
            break
        peer.send(items[asked[-1].seq])
    return int(peer.of("MISSION_ACK")[-1].type)


def mission(bench: Bench) -> list[Any]:
    places = [(0.0, 0.0, 0.0), (3.0, 0.0, 3.5), (3.0, 2.0, 3.0)]
    if bench.autopilot.flavour.name == "px4":
        places = places[1:]  # ArduPilot's item 0 is home
    return [waypoint(bench, i, *place) for i, place in enumerate(places)]


def download(peer: Peer, *, ints: bool = True) -> list[Any]:
    peer.received.clear()
    peer.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    for seq in range(peer.of("MISSION_COUNT")[0].count):
        kind = mavlink.MAVLink_mission_request_int_message if ints else mavlink.MAVLink_mission_request_message
        peer.send(kind(1, 1, seq))
    return peer.of("MISSION_ITEM_INT" if ints else "MISSION_ITEM")


def test_a_mission_comes_back_as_real_ones_give_it_back(bench: Bench) -> None:
    """PX4 by the frame's INT name and with yaw through radians, ArduPilot with heights cut to centimetres."""
    items = mission(bench)
    assert upload(bench, bench.peer, items) == ACCEPTED
    first = int(bench.autopilot.flavour.home_is_item_0)
    found = download(bench.peer)
    assert len(found) == len(items)
    for sent, back in list(zip(items, found, strict=True))[first:]:
        assert (back.x, back.y, back.command) == (sent.x, sent.y, sent.command)
        px4 = bench.autopilot.flavour.name == "px4"
        assert back.frame == (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT if px4 else sent.frame)
        assert back.z == pytest.approx(sent.z, abs=1e-6 if px4 else 0.011)
    floats = download(bench.peer, ints=False)
    assert floats[-1].x == pytest.approx(items[-1].x / 1e7, abs=1e-5)


def test_ardupilot_asks_with_request_and_px4_does_for_the_first_item_only(bench: Bench) -> None:
    bench.peer.send(mavlink.MAVLink_mission_count_message(1, 1, 2))
    assert [m.seq for m in bench.peer.of("MISSION_REQUEST")] == [0]
    assert not bench.peer.of("MISSION_REQUEST_INT")
    bench.peer.send(waypoint(bench, 0, 1.0, 2.0, 3.0))
    px4 = bench.autopilot.flavour.name == "px4"
    assert [m.seq for m in bench.peer.of("MISSION_REQUEST_INT")] == ([1] if px4 else [])
    assert [m.seq for m in bench.peer.of("MISSION_REQUEST")] == ([0] if px4 else [0, 1])


def test_heights_are_cut_by_ardupilot_and_yaw_comes_back_a_little_off_from_px4(bench: Bench) -> None:
    items = [waypoint(bench, i, 1.0, 2.0, 1.599) for i in range(2)]
    items[1].param4 = 123.4
    upload(bench, bench.peer, items)
    back = download(bench.peer)[1]
    px4 = bench.autopilot.flavour.name == "px4"
    assert back.z == pytest.approx(1.599 if px4 else 1.59, abs=1e-6)
    assert back.param4 == pytest.approx(123.4, abs=2e-5)


def test_ardupilot_shows_home_as_item_0(ardupilot: Bench) -> None:
    upload(ardupilot, ardupilot.peer, [waypoint(ardupilot, 0, 50.0, 50.0, 9.0), waypoint(ardupilot, 1, 1.0, 2.0, 3.0)])
    home = download(ardupilot.peer)[0]
    east, north, _ = ardupilot.autopilot.place.enu(home.x / 1e7, home.y / 1e7, 0.0)
    assert abs(east) < 1.0
    assert abs(north) < 1.0


def test_an_item_that_is_lost_is_asked_for_again_and_one_sent_twice_does_no_harm(bench: Bench) -> None:
    items = mission(bench)
    bench.peer.send(mavlink.MAVLink_mission_count_message(1, 1, len(items)))
    bench.peer.received.clear()
    bench.run(0.6)
    again = bench.peer.of("MISSION_REQUEST") + bench.peer.of("MISSION_REQUEST_INT")
    assert again
    assert again[0].seq == 0
    bench.peer.send(items[0])
    bench.peer.send(items[0])
    for item in items[1:]:
        bench.peer.send(item)
    assert bench.peer.of("MISSION_ACK")[-1].type == ACCEPTED
    bench.peer.send(items[-1])  # our ack was lost: the peer sends the last again
    assert bench.peer.of("MISSION_ACK")[-1].type == ACCEPTED
    assert len(download(bench.peer)) == len(items)


def test_an_upload_that_stops_is_given_up_and_the_old_mission_stays(bench: Bench) -> None:
    items = mission(bench)
    upload(bench, bench.peer, items)
    bench.peer.send(mavlink.MAVLink_mission_count_message(1, 1, 9))
    bench.peer.received.clear()
    bench.run(6.0)
    assert bench.peer.of("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert len(download(bench.peer)) == len(items)


def test_what_is_wrong_is_refused(bench: Bench) -> None:
    bench.peer.send(mavlink.MAVLink_mission_count_message(1, 1, 60000))
    assert bench.peer.of("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_NO_SPACE
    bench.peer.send(mavlink.MAVLink_mission_request_int_message(1, 1, 7))
    assert bench.peer.of("MISSION_ACK")[-1].type == mavlink.MAV_MISSION_INVALID_SEQUENCE
    wrong = waypoint(bench, 0, 0.0, 0.0, float("nan"))
    assert upload(bench, bench.peer, [wrong]) == mavlink.MAV_MISSION_INVALID_PARAM7


def test_clearing_leaves_nothing(bench: Bench) -> None:
    upload(bench, bench.peer, mission(bench))
    bench.peer.send(mavlink.MAVLink_mission_clear_all_message(1, 1))
    assert download(bench.peer) == []
    bench.run(3.5)
    assert bench.peer.command(mavlink.MAV_CMD_MISSION_START) != 0


def test_a_mission_is_flown_to_its_end(bench: Bench) -> None:
    upload(bench, bench.peer, mission(bench))
    bench.hover()
    if bench.autopilot.flavour.name == "px4":
        assert bench.peer.set_mode(4, 4) == 0
    else:
        assert bench.peer.command(mavlink.MAV_CMD_MISSION_START) == 0
    assert bench.autopilot.commander.mode is Mode.MISSION
    bench.run(9.5)
    east, north, up = bench.autopilot.truth.position_enu_m
    assert (east, north, up) == pytest.approx((3.0, 2.0, 3.0), abs=0.8)
    reached = [m.seq for m in bench.peer.of("MISSION_ITEM_REACHED")]
    assert reached[:2] == ([0, 1] if bench.autopilot.flavour.name == "px4" else [1, 2])
    assert bench.autopilot.commander.mode is (Mode.HOLD if bench.autopilot.flavour.name == "px4" else Mode.MISSION)
