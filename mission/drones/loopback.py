"""UDP sockets between the program and its pilot process."""

from __future__ import annotations

import socket


def loopback_socket() -> socket.socket:
    """A UDP socket on a free loopback port."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
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
