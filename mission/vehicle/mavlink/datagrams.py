"""Datagrams of a UDP socket, each with the time at which it arrived, however late it is read."""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
import time
from collections.abc import Callable
from typing import Final

_TIMESTAMPNS: Final = 35
"""SO_TIMESTAMPNS and SCM_TIMESTAMPNS of Linux (socket(7)); Python names neither."""
_TIMESPEC: Final = struct.Struct("@ll")
_WAIT_S: Final = 0.1
_REST_S: Final = 0.04
_CROWD: Final = 100
"""A rest is cut short so that no more gather in it: in a flood the socket's buffer is soon full."""
_OLDEST_S: Final = 0.5
"""An older time is none: the computer's clock was set meanwhile."""
_MOST: Final = 65535

Address = tuple[str, int]


class Datagrams:
    """Reads them one by one.

    Args:
        sock: bound; put into blocking mode, with a time-out of the kernel's own (half the system calls of Python's).
        clock: monotonic seconds, of the arrival times.
    """

    def __init__(self, sock: socket.socket, clock: Callable[[], float]) -> None:
        self._socket = sock
        self._clock = clock
        self._stamped = False
        self._gathered = 0
        self._empty_s = clock()
        sock.setblocking(True)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _TIMESPEC.pack(0, int(_WAIT_S * 1e6)))
        if sys.platform == "linux":
            with contextlib.suppress(OSError):  # then the time at which it is read has to do
                sock.setsockopt(socket.SOL_SOCKET, _TIMESTAMPNS, 1)
                self._stamped = True

    def receive(self, *, at_leisure: bool = False) -> tuple[bytes, Address, float] | None:
        """The next one with its sender and arrival time; None when nothing came for a moment.

        Args:
            at_leisure: let some gather before they are read, which costs far less than waking up for each.

        Raises:
            OSError: the socket was closed, or the far side's port is not open.
        """
        at_leisure = at_leisure and self._stamped
        try:
            flags = socket.MSG_DONTWAIT if at_leisure else 0
            data, ancillary, _, peer = self._socket.recvmsg(_MOST, 64, flags)
            self._gathered += 1
        except BlockingIOError:
            now_s = self._clock()
            rate_hz = self._gathered / max(now_s - self._empty_s, 1e-3)
            self._gathered, self._empty_s = 0, now_s
            if at_leisure:
                time.sleep(min(_REST_S, _CROWD / max(rate_hz, 1.0)))  # lets some gather
            return None
        age_s = 0.0
        for level, kind, content in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, _TIMESTAMPNS) and len(content) == _TIMESPEC.size:
                seconds, nanoseconds = _TIMESPEC.unpack(content)
                age_s = time.time() - seconds - nanoseconds * 1e-9
        arrived_s = self._clock() - (age_s if 0.0 <= age_s <= _OLDEST_S else 0.0)
        return data, (str(peer[0]), int(peer[1])), arrived_s
