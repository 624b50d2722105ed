"""The AR.Drone's link over real sockets: rubbish, strangers and silence."""

from __future__ import annotations

import random
import socket
import time
from collections.abc import Iterator

import pytest

from mission.vehicle.ardrone.at import comwdg
from mission.vehicle.ardrone.link import ArdroneLink, NavdataRelay, relayed
from mission.vehicle.ardrone.navdata import WAKE_UP, Navdata
from mission.vehicle.ardrone.url import ArdroneAddress
from tests.mission.vehicle.ardrone.test_navdata import mutated
from tests.support.navdata_packets import DEMO, TIME, packet


class Ports:
    """An AR.Drone's two UDP ports, and a client's link to them."""

    def __init__(self) -> None:
        self.at, self.navdata = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        for sock in (self.at, self.navdata):
            sock.bind(("127.0.0.1", 0))
            sock.settimeout(2.0)
        self.taken: list[tuple[Navdata, bytes, float]] = []
        address = ArdroneAddress("127.0.0.1", self.at.getsockname()[1], self.navdata.getsockname()[1])
        self.link = ArdroneLink(address, lambda *packet: self.taken.append(packet))
        woken, self.client = self.navdata.recvfrom(100)
        assert woken == WAKE_UP

    def send(self, data: bytes) -> None:
        self.navdata.sendto(data, self.client)

    def wait_for(self, count: int, timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        while len(self.taken) < count:
            assert time.monotonic() < deadline, f"{len(self.taken)} of {count}"
            time.sleep(0.005)

    def close(self) -> None:
        self.link.close()
        self.at.close()
        self.navdata.close()


@pytest.fixture
def ports() -> Iterator[Ports]:
    made = Ports()
    yield made
    made.close()


def test_navdata_is_woken_up_and_asked_for_again_when_it_falls_silent(ports: Ports) -> None:
    assert ports.navdata.recvfrom(100)[0] == WAKE_UP
    ports.send(packet(DEMO, TIME))
    ports.wait_for(1, 1.0)
    assert ports.navdata.recvfrom(100)[0] == WAKE_UP


def test_good_navdata_is_taken_within_a_second_after_rubbish(ports: Ports) -> None:
    rng = random.Random(1)
    rubbish = [rng.randbytes(rng.randint(0, 600)) for _ in range(200)]
    rubbish += [mutated(rng, packet(DEMO, TIME)) for _ in range(200)]
    for sent, data in enumerate(rubbish, start=1):
        ports.send(data)
        deadline = time.monotonic() + 5.0
        while sent % 20 == 0 and ports.link.malformed + len(ports.taken) < sent:  # no more than the socket holds
            assert time.monotonic() < deadline
            time.sleep(0.001)
    before = len(ports.taken)
    for sequence in range(10):
        ports.send(packet(DEMO, TIME, sequence=10_000 + sequence))
    ports.wait_for(before + 10, 1.0)
    assert [navdata.sequence for navdata, _, _ in ports.taken[-10:]] == list(range(10_000, 10_010))
    assert ports.link.malformed > 100
    assert ports.link.last_malformed


def test_commands_go_out_numbered(ports: Ports) -> None:
    ports.link.send([comwdg()])
    ports.link.send([comwdg()])
    assert [ports.at.recvfrom(2000)[0] for _ in range(2)] == [b"AT*COMWDG=1\r", b"AT*COMWDG=2\r"]


def test_a_packet_is_relayed_with_the_time_of_its_arrival() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
        program.bind(("127.0.0.1", 0))
        program.settimeout(1.0)
        relay = NavdataRelay(program.getsockname()[1])
        relay.send(packet(DEMO, TIME), 1234.5)
        found = relayed(program.recv(65535))
        relay.close()
    assert found is not None
    assert found[1] == 1234.5
    assert found[0].demo is not None


@pytest.mark.parametrize("datagram", [b"", b"1234567", bytes(8), bytes(8) + packet(DEMO)[:-1]])
def test_a_broken_relayed_packet_is_passed_over(datagram: bytes) -> None:
    assert relayed(datagram) is None
