"""The ADSB mirror: what is sent, for how long, and never to an autopilot."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.geotags.log import Geotag
from gcs_plugin.publish.adsb import AdsbMirror, adsb_vehicle
from mission.errors import SettingsError
from tests.support.sample import estimate, geotag, origin

Station = socket.socket


@pytest.fixture
def station() -> Iterator[Station]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(5.0)
        yield sock


def shown(station: Station, tag: Geotag, *, lifetime_s: float = 60.0, listen_s: float = 0.0) -> AdsbMirror:
    url = f"udpout://127.0.0.1:{station.getsockname()[1]}"
    return AdsbMirror(url, tag, lifetime_s, system=1, component=100, listen_s=listen_s)


def received(station: Station) -> tuple[mavlink.MAVLink_message, tuple[str, int]]:
    data, sender = station.recvfrom(65535)
    (message,) = mavlink.MAVLink(None).parse_buffer(data)
    return message, sender


def test_the_message_says_where_the_target_is_and_how_it_moves() -> None:
    tag = replace(geotag(at=origin("amsl")), number=7)
    message = adsb_vehicle(tag, age_s=3.4)
    assert (message.lat, message.lon) == (round(tag.place.lat_deg * 1e7), round(tag.place.lon_deg * 1e7))
    assert message.altitude == round(1000 * tag.place.alt_m)
    assert (message.hor_velocity, message.heading) == (60, 9000)
    assert (message.callsign, message.tslc) == ("TGT7", 3)
    valid = ("COORDS", "ALTITUDE", "HEADING", "VELOCITY", "CALLSIGN")
    assert message.flags == sum(getattr(mavlink, f"ADSB_FLAGS_VALID_{name}") for name in valid)


def test_what_is_not_known_is_not_flagged_as_valid() -> None:
    standing = geotag(where=estimate(velocity=None), at=origin("home"), geoid_separation_m=None)
    flags = adsb_vehicle(standing, age_s=0.0).flags
    assert flags == mavlink.ADSB_FLAGS_VALID_COORDS | mavlink.ADSB_FLAGS_VALID_CALLSIGN


def test_a_target_keeps_its_marker_and_two_targets_have_two() -> None:
    first, second = replace(geotag(), number=1), replace(geotag(), number=2)
    moved = replace(first, place=replace(first.place, lat_deg=first.place.lat_deg + 0.001))
    assert adsb_vehicle(first, 0.0).ICAO_address == adsb_vehicle(moved, 9.0).ICAO_address
    assert adsb_vehicle(first, 0.0).ICAO_address != adsb_vehicle(second, 0.0).ICAO_address


@pytest.mark.parametrize(("number", "age_s"), [(10**9, 1e6), (0, -5.0), (65536, math.pi)])
def test_any_number_and_age_can_be_sent(number: int, age_s: float) -> None:
    message = adsb_vehicle(replace(geotag(), number=number), age_s)
    data = message.pack(mavlink.MAVLink(None, 1, 100))
    assert mavlink.MAVLink(None).parse_buffer(data)[0].ICAO_address < 2**24


def test_the_marker_is_repeated_once_a_second_and_ends_with_its_lifetime(station: Station) -> None:
    began = time.monotonic()
    mirror = shown(station, geotag(), lifetime_s=1.2)
    messages = [received(station)[0] for _ in range(3)]
    assert [message.get_type() for message in messages] == ["HEARTBEAT", "ADSB_VEHICLE", "ADSB_VEHICLE"]
    assert time.monotonic() - began > 0.9
    mirror._thread.join(5.0)
    assert not mirror.alive
    station.settimeout(0.05)
    with pytest.raises(TimeoutError):
        station.recv(65535)


def test_nothing_is_sent_where_an_autopilot_is_heard(station: Station) -> None:
    mirror = shown(station, geotag(), listen_s=0.5)
    heartbeat, sender = received(station)
    assert heartbeat.get_type() == "HEARTBEAT"
    autopilot = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 4, 3)
    station.sendto(autopilot.pack(mavlink.MAVLink(None, 1, 1)), sender)
    mirror._thread.join(5.0)
    assert mirror.autopilot_heard
    station.settimeout(0.05)
    with pytest.raises(TimeoutError):
        station.recv(65535)


def test_an_autopilot_that_appears_later_ends_it_and_a_station_or_noise_does_not(station: Station) -> None:
    mirror = shown(station, geotag())
    _, sender = received(station)
    assert received(station)[0].get_type() == "ADSB_VEHICLE"
    gcs = mavlink.MAVLink_heartbeat_message(6, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    station.sendto(gcs.pack(mavlink.MAVLink(None, 255, 190)), sender)
    station.sendto(b"\xfd\x09noise", sender)
    assert received(station)[0].get_type() == "ADSB_VEHICLE"
    autopilot = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4, 3)
    station.sendto(autopilot.pack(mavlink.MAVLink(None, 1, 1)), sender)
    mirror._thread.join(5.0)
    assert mirror.autopilot_heard


def test_a_station_that_is_not_there_disturbs_nothing() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port = sock.getsockname()[1]
    mirror = AdsbMirror(f"udpout://127.0.0.1:{port}", geotag(), 60.0, system=1, component=100, listen_s=0.0)
    assert mirror.alive
    mirror.close()
    mirror.close()
    assert not mirror.alive


@pytest.mark.parametrize("url", ["serial:///dev/ttyACM0", "udpout://", "udpout://host:0", "udpout://host:x", "14550"])
def test_an_address_that_is_no_ground_station_is_refused(url: str) -> None:
    with pytest.raises(SettingsError, match="is not the address of a ground station"):
        AdsbMirror(url, geotag(), 1.0, system=1, component=100)
