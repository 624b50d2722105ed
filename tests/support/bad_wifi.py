"""A Wi-Fi that loses, doubles and reorders datagrams, between a client and an AR.Drone's UDP ports. Seeded."""

from __future__ import annotations

import heapq
import itertools
import random
import select
import socket
import threading
import time


class BadWifi:
    """Relays each of some ports of one host; `ports` are the ones to connect to instead.

    Args:
        host: of the drone.
        ports: its UDP ports.
        lost: share of datagrams, each way.
        doubled: share that comes twice.
        late_s: each is held back by up to this long, so that they overtake each other.
        seed: of the dice.
    """

    def __init__(
        self, host: str, ports: list[int], *, lost: float, doubled: float, late_s: float, seed: int = 1
    ) -> None:
        self.lost, self.doubled, self.late_s = lost, doubled, late_s
        self.relayed = self.dropped = 0
        self._rng = random.Random(seed)
        self._fronts = [self._socket(("127.0.0.1", 0)) for _ in ports]
        self._backs = [self._socket(("127.0.0.1", 0)) for _ in ports]
        self._drones = [(host, port) for port in ports]
        self._clients: list[tuple[str, int] | None] = [None] * len(ports)
        self.ports = [int(front.getsockname()[1]) for front in self._fronts]
        self._waiting: list[tuple[float, int, socket.socket, bytes, tuple[str, int]]] = []
        self._order = itertools.count()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stopping.set()
        self._thread.join(2.0)
        for sock in (*self._fronts, *self._backs):
            sock.close()

    @staticmethod
    def _socket(where: tuple[str, int]) -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind(where)
        sock.setblocking(False)
        return sock

    def _run(self) -> None:
        while not self._stopping.is_set():
            ready, _, _ = select.select([*self._fronts, *self._backs], [], [], 0.005)
            for sock in ready:
                try:
                    data, source = sock.recvfrom(65535)
                except OSError:
                    continue
                if sock in self._fronts:
                    i = self._fronts.index(sock)
                    self._clients[i] = source
                    self._hold(self._backs[i], data, self._drones[i])
                else:
                    i = self._backs.index(sock)
                    client = self._clients[i]
                    if client is not None:
                        self._hold(self._fronts[i], data, client)
            now = time.monotonic()
            while self._waiting and self._waiting[0][0] <= now:
                _, _, sock, data, to = heapq.heappop(self._waiting)
                try:
                    sock.sendto(data, to)
                except OSError:
                    continue

    def _hold(self, sock: socket.socket, data: bytes, to: tuple[str, int]) -> None:
        self.relayed += 1
        if self._rng.random() < self.lost:
            self.dropped += 1
            return
        for _ in range(2 if self._rng.random() < self.doubled else 1):
            when = time.monotonic() + self._rng.uniform(0.0, self.late_s)
            heapq.heappush(self._waiting, (when, next(self._order), sock, data, to))
