"""The UDP side of the link: AT commands out, navdata in, woken up again when it falls silent."""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable

from mission.errors import LinkError
from mission.vehicle.ardrone.at import AtCommand, Sequencer
from mission.vehicle.ardrone.navdata import WAKE_UP, Malformed, Navdata, decode_navdata
from mission.vehicle.ardrone.url import ArdroneAddress

_LOG = logging.getLogger(__name__)
_WAKE_S = 0.3
"""Silence after which navdata is asked for again."""
_STAMP = struct.Struct("<d")


class ArdroneLink:
    """The sockets to one drone; packets from anybody else are passed over.

    Args:
        address: of the drone.
        taken: called in the receiving thread with each good packet, its bytes and the time of its arrival.
        clock: program time.

    Raises:
        LinkError: the host has no address.
    """

    def __init__(
        self,
        address: ArdroneAddress,
        taken: Callable[[Navdata, bytes, float], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        try:
            host = socket.gethostbyname(address.host)
        except OSError as error:
            raise LinkError(f"{address.host} has no address: {error}", "Join the AR.Drone's Wi-Fi") from error
        self._at = host, address.at_port
        self._navdata = host, address.navdata_port
        self._taken = taken
        self._clock = clock
        self._sequencer = Sequencer()
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in.settimeout(0.1)
        self._out.setblocking(False)
        self._closing = threading.Event()
        self._complained = False
        self.packets = 0
        """Good ones."""
        self.malformed = 0
        self.last_malformed = ""
        self._thread = threading.Thread(target=self._receive, name="navdata", daemon=True)
        self._thread.start()

    def send(self, commands: Iterable[AtCommand]) -> None:
        """Send AT commands; a network that is not there is logged once, and shows as silence."""
        for datagram in self._sequencer.datagrams(commands):
            self._send(self._out, datagram, self._at)

    def close(self) -> None:
        """Stop. Safe to call twice."""
        self._closing.set()
        self._thread.join(1.0)
        self._out.close()
        self._in.close()

    def _send(self, sock: socket.socket, data: bytes, to: tuple[str, int]) -> None:
        try:
            sock.sendto(data, to)
            self._complained = False
        except OSError as error:
            if not self._complained:
                _LOG.warning("cannot send to %s:%d: %s", *to, error)
            self._complained = True

    def _receive(self) -> None:
        heard_s = asked_s = -1e9
        while not self._closing.is_set():
            now = self._clock()
            if now - heard_s > _WAKE_S and now - asked_s > _WAKE_S:
                asked_s = now
                self._send(self._in, WAKE_UP, self._navdata)
            try:
                data, source = self._in.recvfrom(65535)
            except OSError:  # nothing for a moment, or "port unreachable" while the drone starts
                self._closing.wait(0.01)
                continue
            if source[0] != self._navdata[0]:
                continue
            found = decode_navdata(data)
            if isinstance(found, Malformed):
                self.malformed += 1
                self.last_malformed = found.reason
                continue
            heard_s = self._clock()
            self.packets += 1
            self._taken(found, data, heard_s)


class NavdataRelay:
    """Hands each packet on to the program, with the time of its arrival (both processes share the clock)."""

    def __init__(self, port: int) -> None:
        self._to = "127.0.0.1", port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def send(self, data: bytes, arrived_s: float) -> None:
        """Hand on; dropped when the program does not listen."""
        with contextlib.suppress(OSError):
            self._socket.sendto(_STAMP.pack(arrived_s) + data, self._to)

    def close(self) -> None:
        """Stop."""
        self._socket.close()


def relayed(datagram: bytes) -> tuple[Navdata, float] | None:
    """The other end of `NavdataRelay`: the packet and its arrival; None when it is none."""
    if len(datagram) < _STAMP.size:
        return None
    found = decode_navdata(datagram[_STAMP.size :])
    (arrived_s,) = _STAMP.unpack_from(datagram)
    return None if isinstance(found, Malformed) else (found, float(arrived_s))
