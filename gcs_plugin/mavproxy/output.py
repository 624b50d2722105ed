"""One of MAVProxy's outputs, to which `sidestep serve` connects, and through which its messages are overheard.

MAVProxy sends an output what comes from the vehicle, and the vehicle what comes from an output; what an output sends
never reaches MAVProxy's own modules. This one tells a listener, and lets the module send an order as the station does.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.framing import decode, frames

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

_LOG = logging.getLogger(__name__)
_LARGEST_DATAGRAM: Final = 65535


class Parser:
    """What MAVProxy asks of an output's `mav`: the messages in a datagram. Nothing that arrives raises."""

    def __init__(self, hear: Callable[[Sequence[Message]], None]) -> None:
        self.srcSystem = 0
        """Set by MAVProxy; not used."""
        self.srcComponent = 0
        """Set by MAVProxy; not used."""
        self.rejected = 0
        """Frames that were broken."""
        self._hear = hear
        self._parser = mavlink.MAVLink(None)

    def parse_buffer(self, data: bytes) -> list[Message]:
        """The messages of one datagram, told to the listener and returned for MAVProxy to forward."""
        found = []
        for _, frame in frames(bytes(data)):
            message = decode(self._parser, frame)
            if message is None:
                self.rejected += 1
            else:
                found.append(message)
        if found:
            self._hear(found)
        return found


class ServeOutput:
    """A UDP socket on a free loopback port, in the form that MAVProxy's list of outputs wants.

    The first program that sends a datagram is its peer for as long as it stays; datagrams of others are dropped.

    Args:
        hear: is told the messages that `sidestep serve` sent, from MAVProxy's main loop.
    """

    first_byte = False
    ws = None

    def __init__(self, hear: Callable[[Sequence[Message]], None]) -> None:
        self.port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.port.bind(("127.0.0.1", 0))
        self.port.setblocking(False)
        self.fd = self.port.fileno()
        self.address = f"127.0.0.1:{self.port.getsockname()[1]}"
        self.source_system = 0
        self.mav = Parser(hear)
        self.muted = False
        """While true nothing is written: a message that came from here is being passed on to the others."""
        self._peer: tuple[str, int] | None = None

    @property
    def url(self) -> str:
        """Where `sidestep serve` connects to."""
        return f"udpout://{self.address}"

    @property
    def connected(self) -> bool:
        """Whether somebody has connected."""
        return self._peer is not None

    def recv(self, n: int | None = None) -> bytes:
        """A datagram of the peer; empty when there is none."""
        try:
            data, sender = self.port.recvfrom(_LARGEST_DATAGRAM)
        except OSError as error:  # nothing there, or the peer has just ended (ICMP)
            _LOG.debug("output: %s", error)
            return b""
        peer = (str(sender[0]), int(sender[1]))
        if self._peer is None and any(True for _ in frames(data)):
            self._peer = peer
        return data if peer == self._peer else b""

    def write(self, data: bytes) -> None:
        """Send to the peer; dropped while there is none."""
        if self._peer is None or self.muted:
            return
        try:
            self.port.sendto(data, self._peer)
        except OSError as error:  # a full buffer or a peer that has ended: a radio would lose it as well
            _LOG.debug("output: %s", error)

    def close(self) -> None:
        """Free the port."""
        self.port.close()
