from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.faults import FaultRelay, LinkFaults, Wiretap

COUNT = 1000


@dataclass
class Ends:
    """Both sides of a relay."""

    relay: FaultRelay
    tap: Wiretap
    vehicle: socket.socket
    program: socket.socket

    def send(self, count: int = COUNT) -> list[int]:
        """Numbered datagrams from the vehicle; the numbers as they come to the program."""
        for i in range(count):
            self.vehicle.send(i.to_bytes(4, "little"))
            if i % 50 == 0:
                time.sleep(0.001)  # the sockets' buffers hold some hundreds
        return self.came()

    def came(self) -> list[int]:
        found = []
        try:
            while True:
                found.append(int.from_bytes(self.program.recv(100), "little"))
        except TimeoutError:
            return found


@pytest.fixture
def ends() -> Iterator[Ends]:
    program = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    program.bind(("127.0.0.1", 0))
    program.settimeout(0.3)
    program.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    tap = Wiretap()
    relay = FaultRelay(program.getsockname()[1], seed=3, tap=tap)
    vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    vehicle.connect(("127.0.0.1", relay.vehicle_port))
    vehicle.settimeout(0.3)
    yield Ends(relay, tap, vehicle, program)
    relay.close()
    relay.close()
    vehicle.close()
    program.close()


def test_without_faults_all_passes_in_order_and_both_ways(ends: Ends) -> None:
    assert ends.send() == list(range(COUNT))
    ends.vehicle.send(b"hello")
    _, relayed_from = ends.program.recvfrom(100)
    ends.program.sendto(b"answer", relayed_from)
    assert ends.vehicle.recv(100) == b"answer"


def test_the_asked_share_is_lost_in_the_asked_direction(ends: Ends) -> None:
    ends.relay.set(LinkFaults(loss=0.3), "program")
    assert len(ends.send()) == pytest.approx(0.7 * COUNT, abs=60)
    assert ends.relay.lost["program"] == pytest.approx(0.3 * COUNT, abs=60)


def test_some_come_twice_and_some_late(ends: Ends) -> None:
    ends.relay.set(LinkFaults(duplicate=0.1, reorder=0.1))
    found = ends.send()
    assert set(found) == set(range(COUNT))
    assert len(found) == pytest.approx(1.1 * COUNT, abs=40)
    assert found != sorted(found)


def test_a_damaged_datagram_differs_in_one_bit(ends: Ends) -> None:
    ends.relay.set(LinkFaults(corrupt=1.0))
    found = ends.send(100)
    assert len(found) == 100
    assert all((got ^ sent).bit_count() == 1 for sent, got in enumerate(found))


def test_a_delay_holds_back_and_a_cut_lets_nothing_through(ends: Ends) -> None:
    ends.relay.set(LinkFaults(delay_s=0.15))
    began = time.monotonic()
    assert len(ends.send(5)) == 5
    assert time.monotonic() - began > 0.15
    ends.relay.set(LinkFaults(cut=True))
    assert ends.send(5) == []
    ends.relay.inject(bytes(4), "program")
    assert ends.came() == [0]


def test_the_tap_tells_setpoints_mode_orders_and_modes_with_their_times(ends: Ends) -> None:
    companion, autopilot = mavlink.MAVLink(None, 1, 191), mavlink.MAVLink(None, 1, 1)
    px4_hold = 4 << 16 | 3 << 24
    began = time.monotonic()
    ends.vehicle.send(mavlink.MAVLink_heartbeat_message(2, 12, 0, px4_hold, 4, 3).pack(autopilot))
    _, relayed_from = ends.program.recvfrom(1000)
    for message in (
        mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0, *(0.0,) * 11),
        mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 4, 3, 0, 0, 0, 0),
    ):
        ends.program.sendto(message.pack(companion), relayed_from)
        ends.vehicle.recv(1000)
    (setpoint_s,) = ends.tap.setpoints_s()
    ((ordered_s, main, sub),) = ends.tap.mode_orders()
    (mode_s,) = ends.tap.modes_s(px4_hold)
    assert began < mode_s < setpoint_s < ordered_s < time.monotonic()
    assert (main, sub) == (4, 3)
    assert ends.tap.setpoints_s(since_s=ordered_s) == []
    ends.tap.clear()
    assert ends.tap.mode_orders() == []


def test_chosen_datagrams_are_lost_and_no_others(ends: Ends) -> None:
    ends.relay.drop_when(lambda towards, data: towards == "program" and data[0] % 2 == 1)
    assert ends.send(10) == [0, 2, 4, 6, 8]
    assert ends.relay.lost["program"] == 5
