"""The component's side of the vehicle's link."""

from __future__ import annotations

import time
from collections.abc import Iterator
from datetime import UTC, datetime

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority.signing import SignatureCheck, timestamp_of
from gcs_plugin.component import StationLink
from mission.drones.link import MavlinkLink
from mission.drones.loopback import loopback_socket

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
