"""A link, and what listens on it, under a flood of broken MAVLink; a probe shows that it still answers."""

from __future__ import annotations

import socket
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as mavlink

from mission.drones.link import MavlinkLink
from mission.drones.loopback import drain

_BATCH = 100
"""Datagrams between two probes: what the socket's buffer holds."""


@dataclass(frozen=True, slots=True)
class Flood:
    """How it went."""

    datagrams: int
    slowest_answer_s: float
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
            AssertionError: a probe is not answered within a second.
        """
        slowest = half = 0.0
        began, sent = time.monotonic(), 0
        tracemalloc.start()
        try:
            while sent < datagrams and time.monotonic() - began < seconds:
                for _ in range(_BATCH):
                    self.sock.send(draw())
                sent += _BATCH
                slowest = max(slowest, self.probe())
                drain(self.sock)
                if half == 0.0 and (sent >= datagrams / 2 or time.monotonic() - began > seconds / 2):
                    half = tracemalloc.get_traced_memory()[0]
            growth = tracemalloc.get_traced_memory()[0] - half
        finally:
            tracemalloc.stop()
        return Flood(sent, slowest, int(growth))

    def probe(self) -> float:
        """Seconds until a PING comes out of the link's other end."""
        self._nonce += 1
        began = time.monotonic()
        with self._link.listen("PING") as box:
            while time.monotonic() - began < 1.0:
                # Several times: a full socket buffer may have dropped one.
                self.say(mavlink.MAVLink_ping_message(0, self._nonce, 0, 0))
                again = time.monotonic() + 0.2
                while time.monotonic() < again:
                    self.attend()
                    found = box.get(0.01)
                    if found is not None and found.seq == self._nonce:
                        return time.monotonic() - began
        raise AssertionError("the link does not answer any more")

    def close(self) -> None:
        """Free the port."""
        self.sock.close()
