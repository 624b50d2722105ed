"""The aircraft on its sockets, in real time."""

from __future__ import annotations

import socket
import struct
import subprocess
import sys
import time

import pytest

from sitl.ardrone.config import ArdroneConfig
from sitl.ardrone.process import start_ardrone
from sitl.ardrone.server import ArdroneServer, Ports
from tests.support.live_ardrone import ANY_PORTS, flying, until

BOOTSTRAP, COMMAND, LOST = 1 << 11, 1 << 6, 1 << 13


class Wire:
    """Sockets of a client that knows only the protocol."""

    def __init__(self, ports: Ports, host: str = "127.0.0.1") -> None:
        self.host, self.ports = host, ports
        self.at = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.navdata = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.navdata.settimeout(1.0)
        self.sequence = 0

    def __enter__(self) -> Wire:
        return self

    def __exit__(self, *_: object) -> None:
        self.at.close()
        self.navdata.close()

    def wake(self) -> None:
        self.navdata.sendto(b"\1\0\0\0", (self.host, self.ports.navdata))

    def send(self, name: str, arguments: str = "") -> None:
        self.sequence += 1
        comma = "," if arguments else ""
        self.at.sendto(f"AT*{name}={self.sequence}{comma}{arguments}\r".encode(), (self.host, self.ports.at))

    def hears(self) -> bool:
        """Whether a packet comes within the socket's patience."""
        try:
            return bool(self.navdata.recv(4096))
        except TimeoutError:
            return False

    def newest(self) -> tuple[int, int]:
        """State and length of the newest packet."""
        data = self.navdata.recv(4096)
        self.navdata.setblocking(False)
        try:
            while True:
                data = self.navdata.recv(4096)
        except BlockingIOError:
            self.navdata.settimeout(1.0)
        return int(struct.unpack_from("<I", data, 4)[0]), len(data)


def test_handshake_over_the_wire() -> None:
    with flying(ANY_PORTS) as server, Wire(server.ports) as wire:
        wire.wake()
        assert wire.newest() == (server.drone.state_bits, 24)
        wire.send("CONFIG", '"general:navdata_demo","TRUE"')
        assert until(lambda: wire.newest()[0] & COMMAND != 0)
        wire.send("CTRL", "5,0")
        assert until(lambda: wire.newest()[0] & COMMAND == 0)
        assert wire.newest()[1] == 16 + 148 + 328 + 8


def test_nobody_gets_navdata_who_did_not_ask() -> None:
    with flying(ANY_PORTS) as server, Wire(server.ports) as wire:
        wire.send("COMWDG")
        wire.navdata.settimeout(0.3)
        with pytest.raises(TimeoutError):
            wire.navdata.recv(4096)


def test_navdata_stops_when_the_pilot_is_lost_and_comes_back_when_asked_for() -> None:
    with flying(ANY_PORTS) as server, Wire(server.ports) as wire:
        wire.wake()
        wire.send("CONFIG", '"general:navdata_demo","TRUE"')
        assert until(lambda: wire.newest()[0] & BOOTSTRAP == 0)
        assert until(lambda: server.drone.link.lost, 4.0)
        wire.navdata.settimeout(0.3)
        for _ in range(60):  # what was on its way
            if not wire.hears():
                break
        assert not wire.hears()
        wire.send("COMWDG")
        wire.wake()
        state, length = wire.newest()
        assert state & BOOTSTRAP
        assert not state & LOST
        assert length == 24


def test_full_navdata_comes_200_times_a_second() -> None:
    with flying(ANY_PORTS) as server, Wire(server.ports) as wire:
        wire.wake()
        wire.send("CONFIG", '"general:navdata_demo","FALSE"')
        assert until(lambda: wire.newest()[0] & BOOTSTRAP == 0)
        first = struct.unpack_from("<I", wire.navdata.recv(4096), 8)[0]
        began = time.monotonic()
        while time.monotonic() < began + 0.5:
            last = struct.unpack_from("<I", wire.navdata.recv(4096), 8)[0]
        assert (last - first) / 0.5 == pytest.approx(200.0, rel=0.15)


def test_control_port_sends_the_configuration() -> None:
    with flying(ANY_PORTS) as server, Wire(server.ports) as wire:
        with socket.create_connection(("127.0.0.1", server.ports.control), 2.0) as control:
            wire.send("CTRL", "4,0")
            data = b""
            while not data.endswith(b"\0"):
                data += control.recv(65536)
        assert b"general:num_version_soft = 2.4.8\n" in data


def test_a_taken_port_is_said() -> None:
    with flying(ANY_PORTS) as server, pytest.raises(OSError, match="in use"):
        ArdroneServer(ArdroneConfig(at_port=server.ports.at, navdata_port=0, control_port=0), None)


def test_runs_as_a_process_and_ends_with_its_parent() -> None:
    drone = start_ardrone(ANY_PORTS)
    try:
        assert drone.url.startswith("ardrone://127.0.0.1?at=")
        with Wire(drone.ports) as wire:
            wire.wake()
            assert wire.newest()[1] == 24
            wire.send("REF", "290718208")
            assert until(lambda: drone.state()["state"] == "TAKING_OFF")
        drone.set_battery(2.0)
        assert until(lambda: drone.state()["state"] == "LANDING")
    finally:
        drone.stop()
    assert not drone.alive


def test_module_tells_what_is_wrong_with_a_scenario() -> None:
    command = [sys.executable, "-m", "sitl.ardrone", "--scenario", "no-such-file.toml"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "no-such-file.toml" in done.stderr
    assert "Traceback" not in done.stderr
