"""The output of MAVProxy through which `sidestep serve` is heard."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.mavproxy.output import ServeOutput

HEARTBEAT = mavlink.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 100))


class Bench:
    def __init__(self) -> None:
        self.heard: list[Any] = []
        self.output = ServeOutput(self.heard.extend)
        host, port = self.output.address.split(":")
        self.address = host, int(port)
        self.sockets: list[socket.socket] = []

    def program(self) -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.connect(self.address)
        sock.settimeout(2.0)
        self.sockets.append(sock)
        return sock


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.output.close()
    for sock in made.sockets:
        sock.close()


def test_what_the_program_sends_is_heard_and_returned_for_the_vehicle(bench: Bench) -> None:
    bench.program().send(HEARTBEAT + HEARTBEAT)
    messages = bench.output.mav.parse_buffer(bench.output.recv())
    assert [bytes(message.get_msgbuf()) for message in messages] == [bytes(HEARTBEAT)] * 2
    assert bench.heard == messages


def test_the_first_program_is_the_only_one(bench: Bench) -> None:
    first, second = bench.program(), bench.program()
    assert not bench.output.connected
    first.send(HEARTBEAT)
    assert bench.output.recv() == bytes(HEARTBEAT)
    second.send(HEARTBEAT)
    assert bench.output.recv() == b""
    bench.output.write(b"telemetry")
    assert first.recv(100) == b"telemetry"


def test_noise_makes_nobody_the_peer_and_raises_nothing(bench: Bench) -> None:
    program = bench.program()
    program.send(b"hello")
    assert bench.output.recv() == b""
    assert not bench.output.connected
    program.send(HEARTBEAT)
    bench.output.recv()
    rng = np.random.default_rng(4)
    for _ in range(300):
        damaged = bytearray(HEARTBEAT + rng.integers(0, 256, rng.integers(0, 60), dtype=np.uint8).tobytes())
        damaged[rng.integers(0, len(damaged))] ^= int(rng.integers(1, 256))
        program.send(damaged)
        bench.output.mav.parse_buffer(bench.output.recv())
    assert bench.output.mav.rejected > 0


def test_nothing_is_written_while_its_own_message_is_passed_on(bench: Bench) -> None:
    program = bench.program()
    program.send(HEARTBEAT)
    bench.output.recv()
    bench.output.muted = True
    bench.output.write(b"echo")
    bench.output.muted = False
    bench.output.write(b"news")
    assert program.recv(100) == b"news"


def test_a_program_that_has_gone_disturbs_nothing(bench: Bench) -> None:
    program = bench.program()
    program.send(HEARTBEAT)
    bench.output.recv()
    program.close()
    for _ in range(3):
        bench.output.write(b"telemetry")
        assert bench.output.recv() == b""
