"""A simulated aircraft in real time: its ticks by the clock, its sockets, and the orders of the test bench."""

from __future__ import annotations

import json
import logging
import os
import selectors
import signal
import socket
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import IO

_log = logging.getLogger(__name__)
_MOST_BEHIND = 50
"""Ticks that are made up for after a stall; more are given up (the aircraft stood still with its process)."""
_BUFFER = 1 << 20
_MOST_DATAGRAMS = 200
_LONGEST = 65536


class AircraftServer(ABC):
    """Runs a simulated aircraft by the monotonic clock, without drift, until told to stop.

    Args:
        tick_s: one step of the simulation.
    """

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        self._selector = selectors.DefaultSelector()
        self._epoch = time.monotonic()
        self._ticks = 0
        self._running = True
        self._orders = b""
        self._reply: IO[str] | None = None

    def orders_from(self, descriptor: int, reply: IO[str]) -> None:
        """Take orders of the test bench, one JSON object a line; the end of the pipe stops the aircraft."""
        os.set_blocking(descriptor, False)
        self._reply = reply
        self._selector.register(descriptor, selectors.EVENT_READ, lambda: self._read_orders(descriptor))

    def stop(self) -> None:
        """End `run`."""
        self._running = False

    def run(self) -> None:
        """Fly in real time until `stop`."""
        while self._running:
            wait = self._epoch + (self._ticks + 1) * self._tick_s - time.monotonic()
            for key, _ in self._selector.select(max(0.0, wait)):
                read: Callable[[], None] = key.data
                read()
            self._catch_up()
        self.close()

    def close(self) -> None:
        """Close all sockets."""
        for key in list(self._selector.get_map().values()):
            if isinstance(key.fileobj, socket.socket):
                key.fileobj.close()
        self._selector.close()

    @abstractmethod
    def _tick(self, now_s: float) -> None:
        """Advance the aircraft by one tick."""

    @abstractmethod
    def _order(self, order: dict[str, object]) -> None:
        """An order of the test bench; not of the air."""

    def _catch_up(self) -> int:
        """Advance to now; how many ticks it was."""
        due = int((time.monotonic() - self._epoch) / self._tick_s) - self._ticks
        if due > _MOST_BEHIND:
            _log.warning("stalled for %.2f s", due * self._tick_s)
            self._ticks += due - 1
            due = 1
        for _ in range(due):
            self._ticks += 1
            self._tick(self._epoch + self._ticks * self._tick_s)
        return due

    def _watch(self, source: socket.socket, read: Callable[[], None]) -> None:
        self._selector.register(source, selectors.EVENT_READ, read)

    def _read_orders(self, descriptor: int) -> None:
        try:
            data = os.read(descriptor, _LONGEST)
        except BlockingIOError:
            return
        if not data:
            self.stop()
            return
        *lines, self._orders = (self._orders + data).split(b"\n")
        for line in lines:
            try:
                order = json.loads(line)
            except ValueError:
                _log.warning("not an order: %r", line[:100])
                continue
            if isinstance(order, dict):
                self._order(order)

    def _answer(self, content: Mapping[str, object]) -> None:
        if self._reply is not None:
            self._reply.write(json.dumps(content) + "\n")
            self._reply.flush()


def run_program(server: AircraftServer, ports: Mapping[str, int | None], *, orders: bool) -> None:
    """Be the program around a server: tell the ports in one line of JSON, and fly until told to stop.

    Args:
        server: what flies; SIGINT and SIGTERM stop it.
        ports: what is told on standard output.
        orders: whether to take orders from standard input, too, and to stop at its end.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: server.stop())
    sys.stdout.write(json.dumps(ports) + "\n")
    sys.stdout.flush()
    if orders:
        server.orders_from(sys.stdin.fileno(), sys.stdout)
    server.run()


def udp_socket(host: str, port: int) -> socket.socket:
    """A UDP socket bound there that does not block; port 0 takes a free one."""
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind((host, port))
    s.setblocking(False)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
    return s


def datagrams(source: socket.socket) -> list[tuple[bytes, tuple[str, int]]]:
    """All that has arrived; errors of earlier sends (nobody listens yet) are none of ours."""
    found: list[tuple[bytes, tuple[str, int]]] = []
    while len(found) < _MOST_DATAGRAMS:
        try:
            found.append(source.recvfrom(_LONGEST))
        except BlockingIOError:
            break
        except OSError as error:
            _log.debug("receiving: %s", error)
    return found
