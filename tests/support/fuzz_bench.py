"""A link, and what listens on it, under a flood of broken MAVLink; a probe shows that it still answers."""

from __future__ import annotations

import socket
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.pilot.loopback import drain
from tests.support.processor_wait import Stopwatch

_BATCH = 100
"""Datagrams between two probes: what the socket's buffer holds. The next ones wait for the answer: none is lost."""
_ANSWER_S = 1.0
_GIVE_UP_S = 60.0


@dataclass(frozen=True, slots=True)
class Flood:
    """How it went."""

    datagrams: int
    slowest_answer_s: float
    """Without the time in which the machine ran others."""
    slowest_wall_s: float
    """With it."""
    overflowed: int
    """Datagrams that the kernel threw away because nobody read them in time."""
    growth_bytes: int
    """Of Python's memory over the second half of the flood."""


class FuzzBench:
    """The far side of a link.

    Args:
        link: under test; its peer is this bench.
        attend: gives what listens on the link its turn, if it needs one.
    """

    def __init__(self, link: MavlinkLink, attend: Callable[[], None] = lambda: None) -> None:
        self.sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sock.connect(("127.0.0.1", link.port))
        self._link = link
        self.attend = attend
        self._mav = mavlink.MAVLink(None, 1, 1)
        self._nonce = 0
        self.say(mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 4, 3))
        deadline = time.monotonic() + 2.0
        while not link.connected:
            assert time.monotonic() < deadline
            time.sleep(0.005)

    def say(self, message: mavlink.MAVLink_message) -> None:
        """Send a whole message as the autopilot."""
        self.sock.send(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256

    def flood(self, draw: Callable[[], bytes], datagrams: int, seconds: float = float("inf")) -> Flood:
        """Send so many datagrams, or for so long, with a probe after each hundred.

        Raises:
            AssertionError: a probe is not answered within a second in which this process could run.
        """
        slowest = wall = half = 0.0
        lost = self._overflowed()
        began, sent = time.monotonic(), 0
        tracemalloc.start()
        try:
            while sent < datagrams and time.monotonic() - began < seconds:
                for _ in range(_BATCH):
                    self.sock.send(draw())
                sent += _BATCH
                watch = self.probe()
                slowest, wall = max(slowest, watch[0]), max(wall, watch[1])
                drain(self.sock)
                if half == 0.0 and (sent >= datagrams / 2 or time.monotonic() - began > seconds / 2):
                    half = tracemalloc.get_traced_memory()[0]
            growth = tracemalloc.get_traced_memory()[0] - half
        finally:
            tracemalloc.stop()
        return Flood(sent, slowest, wall, self._overflowed() - lost, int(growth))

    def probe(self) -> tuple[float, float]:
        """Seconds until a PING comes out of the link's other end: those in which this process could run, and all.

        Raises:
            AssertionError: it does not come within a second of the former.
        """
        self._nonce += 1
        watch, lost = Stopwatch(), self._overflowed()
        with self._link.listen("PING") as box:
            while watch.own_s < _ANSWER_S and watch.wall_s < _GIVE_UP_S:
                # Several times: a full socket buffer may have dropped one.
                self.say(mavlink.MAVLink_ping_message(0, self._nonce, 0, 0))
                again = time.monotonic() + 0.2
                while time.monotonic() < again:
                    self.attend()
                    found = box.get(0.01)
                    if found is not None and found.seq == self._nonce:
                        return watch.own_s, watch.wall_s
        raise AssertionError(
            f"no answer in {watch.wall_s:.1f} s, of which this process could run for {watch.own_s:.1f} s;"
            f" {self._overflowed() - lost} datagrams overflowed meanwhile, {self._link.rejected} frames were broken"
        )

    def _overflowed(self) -> int:
        """The kernel's count for the link's socket; 0 where it tells none."""
        table = Path("/proc/net/udp")
        port = f":{self._link.port:04X}"
        lines = table.read_text().splitlines() if table.exists() else []
        return sum(int(fields[-1]) for fields in map(str.split, lines) if fields[1].endswith(port))

    def close(self) -> None:
        """Free the port."""
        self.sock.close()
