"""The component's side of the vehicle's link."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority
from gcs_plugin.authority.signing import SignatureCheck, timestamp_of
from gcs_plugin.component import StationLink
from mission.settings import AuthoritySettings
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.pilot.loopback import loopback_socket

KEY = bytes(range(32))
NOW = datetime(2026, 11, 22, 12, 0, tzinfo=UTC)


class Far:
    """The other end of the link."""

    def __init__(self) -> None:
        sock = loopback_socket()
        port = sock.getsockname()[1]
        self.link = MavlinkLink(sock, source_system=1, source_component=193, target_system=1, heartbeat=False)
        self._socket = loopback_socket()
        self._socket.settimeout(5.0)
        beat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 1))
        self._socket.sendto(beat, ("127.0.0.1", port))
        deadline = time.monotonic() + 5.0
        while not self.link.connected and time.monotonic() < deadline:
            time.sleep(0.01)  # looks again until the deadline

    def say(self, message: Any, key: bytes | None = None, source: tuple[int, int] = (255, 190), stamp: int = 0) -> None:
        """Send as somebody, signed where a key is given."""
        sender = mavlink.MAVLink(None, *source)
        if key is not None:
            sender.signing.secret_key, sender.signing.sign_outgoing, sender.signing.timestamp = key, True, stamp
        self._socket.sendto(message.pack(sender), ("127.0.0.1", self.link.port))

    def receive(self) -> bytes:
        return self._socket.recv(65535)

    def close(self) -> None:
        self.link.close()
        self._socket.close()


@pytest.fixture
def far() -> Iterator[Far]:
    far = Far()
    yield far
    far.close()


def test_everything_goes_out_as_the_component(far: Far) -> None:
    StationLink(far.link, 102).send(mavlink.MAVLink_statustext_message(6, b"text"))
    frame = far.receive()
    assert (frame[5], frame[6]) == (1, 102)


def test_the_newest_answer_is_kept(far: Far) -> None:
    station = StationLink(far.link, 100)
    assert station.answer is None
    answer = mavlink.MAVLink_camera_tracking_geo_status_message(1, 473977642, 85457195, *([1.0] * 10))
    station.send(answer)
    station.send(mavlink.MAVLink_statustext_message(6, b"text"))
    assert station.answer is answer


def test_with_a_key_each_frame_of_the_component_is_signed_anew_and_the_others_are_not(far: Far) -> None:
    far.link.sign_as(100, KEY, lambda: timestamp_of(NOW))
    station, check = StationLink(far.link, 100), SignatureCheck(KEY, lambda: NOW)
    for _ in range(3):
        station.send(mavlink.MAVLink_statustext_message(6, b"text"))
        assert check.fault(far.receive()) is None
    far.link.send(mavlink.MAVLink_statustext_message(6, b"text"))
    assert check.fault(far.receive()) == "unsigned"


STOP = mavlink.MAVLink_command_long_message(1, 100, mavlink.MAV_CMD_USER_2, 0, *([0.0] * 7))
PARAMETER = mavlink.MAVLink_param_set_message(1, 100, b"REPEAT", 4.0, 9)


@pytest.mark.parametrize("signed_by", [None, bytes(32), KEY])
def test_a_signed_stop_gets_through_a_flood_of_which_little_is_even_decoded(far: Far, signed_by: bytes | None) -> None:
    """Under the operator's id: unsigned, forged, or his own frame played again and again."""
    authority = Authority(AuthoritySettings(), KEY, lambda: NOW, clock=lambda: 0.0)
    station = StationLink(far.link, 100)

    def read() -> int:
        return far.link.received["PARAM_SET"] + authority.turned_away

    with station.listen("COMMAND_LONG", "PARAM_SET", gate=authority.lets_in) as inbox:
        for number in range(4000):
            far.say(PARAMETER, signed_by, stamp=timestamp_of(NOW))
            if number == 1000:
                far.say(STOP, KEY, stamp=timestamp_of(NOW) + 1)
            if number % 20 == 0:  # the socket's buffer is not what is tried here
                until(number, read)
        until(3999, read)
        taken = []
        while (message := inbox.get(0.0)) is not None:
            taken.append(message.get_type())
    assert taken.count("COMMAND_LONG") == 1
    assert far.link.received["PARAM_SET"] == taken.count("PARAM_SET") < 400


def until(count: int, reached: Callable[[], int]) -> None:
    deadline = time.monotonic() + 10.0
    while reached() < count:
        assert time.monotonic() < deadline
        time.sleep(0.0005)  # looks again until the deadline
