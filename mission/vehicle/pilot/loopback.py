"""UDP sockets between the program and its pilot process."""

from __future__ import annotations

import socket
from typing import Final

BUFFER_BYTES: Final = 1 << 20
"""Asked of the kernel for what waits to be read: some 0.1 s of a flood of 40,000 frames a second. More would only make
old what is read when a reader cannot keep up."""


def loopback_socket() -> socket.socket:
    """A UDP socket on a free loopback port."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    sock.bind(("127.0.0.1", 0))
    return sock


def drain(sock: socket.socket) -> None:
    """Throw away what came before anybody read it: its arrival times would be wrong."""
    sock.setblocking(False)
    for _ in range(100_000):
        try:
            sock.recv(65535)
        except BlockingIOError:
            return
