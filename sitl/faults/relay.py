"""A UDP hop between an aircraft and what flies it that loses, doubles, delays, reorders and damages datagrams."""

from __future__ import annotations

import heapq
import logging
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

_log = logging.getLogger(__name__)
_HOST = "127.0.0.1"
_IDLE_S = 0.05
_BUFFER = 1 << 20

Towards = Literal["vehicle", "program"]
Tap = Callable[[float, Towards, bytes], None]
Drop = Callable[[Towards, bytes], bool]


@dataclass(frozen=True, slots=True)
class LinkFaults:
    """What a bad radio does to the datagrams of one direction; probabilities for each of them, times in seconds."""

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    """Held back by `held_s`, so that later ones overtake it."""
    held_s: float = 0.05
    corrupt: float = 0.0
    """One bit is flipped."""
    delay_s: float = 0.0
    cut: bool = False
    """Nothing passes."""


class FaultRelay:
    """Forwards datagrams both ways in a thread of its own until `close`.

    The aircraft sends to `vehicle_port` (its `remote_port`), the program listens on `program_port` (``udpin``). The
    relay stands next to the aircraft: what its tap is told of is what the aircraft receives, at that time.

    Args:
        program_port: where the program listens on the loopback interface.
        vehicle_port: where the aircraft sends to; 0 takes a free port.
        seed: of all faults.
        tap: called in the relay's thread with time (seconds of `clock`), direction and bytes of each datagram that is
            passed on; it must not block.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        program_port: int,
        vehicle_port: int = 0,
        *,
        seed: int = 1,
        tap: Tap | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.program_port = program_port
        self.passed: dict[Towards, int] = {"vehicle": 0, "program": 0}
        self.lost: dict[Towards, int] = {"vehicle": 0, "program": 0}
        self._clock = clock
        self._tap = tap
        self._rng = np.random.default_rng(seed)
        self._lock = threading.Lock()
        self._faults: dict[Towards, LinkFaults] = {"vehicle": LinkFaults(), "program": LinkFaults()}
        self._drop: Drop = _nothing
        self._waiting: list[tuple[float, int, Towards, bytes]] = []
        self._count = 0
        self._vehicle = _udp(vehicle_port)
        self._program = _udp(0)
        self._vehicle_peer: tuple[str, int] | None = None
        self._closed = threading.Event()
        self._threads = [
            threading.Thread(target=self._read, args=(sock, towards), name=f"relay-to-{towards}", daemon=True)
            for sock, towards in ((self._vehicle, "program"), (self._program, "vehicle"))
        ]
        self._arrived = threading.Condition()
        self._threads.append(threading.Thread(target=self._release, name="relay-delayed", daemon=True))
        for thread in self._threads:
            thread.start()

    @property
    def vehicle_port(self) -> int:
        """Where the aircraft sends to."""
        return int(self._vehicle.getsockname()[1])

    def set(self, faults: LinkFaults, towards: Towards | None = None) -> None:
        """From now on, in one direction or in both."""
        with self._lock:
            for direction in ("vehicle", "program") if towards is None else (towards,):
                self._faults[direction] = faults

    def drop_when(self, drop: Drop) -> None:
        """From now on lose the datagrams to which this answers True; called in the relay's threads."""
        self._drop = drop

    def inject(self, data: bytes, towards: Towards) -> None:
        """Send bytes as if they had come from the other side, with no fault added."""
        self._send(towards, data)

    def close(self) -> None:
        """End it and free its ports. Safe to call twice."""
        self._closed.set()
        with self._arrived:
            self._arrived.notify_all()
        for thread in self._threads:
            thread.join(2.0)
        self._vehicle.close()
        self._program.close()

    def _read(self, sock: socket.socket, towards: Towards) -> None:
        while not self._closed.is_set():
            try:
                data, peer = sock.recvfrom(65536)
            except TimeoutError:
                continue
            except OSError as error:  # the far side does not listen yet
                _log.debug("relay: %s", error)
                continue
            if towards == "program":
                self._vehicle_peer = peer
            self._take(data, towards)

    def _take(self, data: bytes, towards: Towards) -> None:
        with self._lock:
            faults = self._faults[towards]
            lost, doubled, held, damaged = (float(u) for u in self._rng.random(4))
            bit = int(self._rng.integers(0, 8 * max(1, len(data))))
        if faults.cut or lost < faults.loss or self._drop(towards, data):
            self.lost[towards] += 1
            return
        if damaged < faults.corrupt and data:
            broken = bytearray(data)
            broken[bit // 8] ^= 1 << bit % 8
            data = bytes(broken)
        wait_s = faults.delay_s + (faults.held_s if held < faults.reorder else 0.0)
        for _ in range(2 if doubled < faults.duplicate else 1):
            if wait_s > 0.0:
                with self._arrived:
                    self._count += 1
                    heapq.heappush(self._waiting, (self._clock() + wait_s, self._count, towards, data))
                    self._arrived.notify()
            else:
                self._send(towards, data)

    def _release(self) -> None:
        while not self._closed.is_set():
            with self._arrived:
                due = self._waiting[0][0] - self._clock() if self._waiting else _IDLE_S
                if due > 0.0:
                    self._arrived.wait(min(due, _IDLE_S))
                    continue
                _, _, towards, data = heapq.heappop(self._waiting)
            self._send(towards, data)

    def _send(self, towards: Towards, data: bytes) -> None:
        sock, peer = (
            (self._vehicle, self._vehicle_peer) if towards == "vehicle" else (self._program, (_HOST, self.program_port))
        )
        if peer is None:
            return
        if self._tap is not None:
            self._tap(self._clock(), towards, data)
        try:
            sock.sendto(data, peer)
        except OSError as error:  # nobody listens: a radio would lose it as well
            _log.debug("relay to the %s: %s", towards, error)
            return
        self.passed[towards] += 1


def _nothing(towards: Towards, data: bytes) -> bool:
    del towards, data
    return False


def _udp(port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind((_HOST, port))
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
    sock.settimeout(_IDLE_S)
    return sock
