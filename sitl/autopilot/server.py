"""The simulated autopilot in real time, on sockets of the loopback interface."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import selectors
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO

from sitl.autopilot.autopilot import TICK_S, Autopilot
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flavour import Mode
from sitl.autopilot.link import Link
from sitl.autopilot.plan import MISSION
from sitl.truth import TruthRing

_log = logging.getLogger(__name__)
_HOST = "127.0.0.1"
_MOST_BEHIND = 50
"""Ticks that are made up for after a stall; more are given up (the aircraft stood still with its process)."""
_MOST_PEERS = 16
_OPERATOR_BUFFER = 1 << 20


@dataclass(frozen=True, slots=True)
class Ports:
    """Where it is reached; None for links that are off."""

    remote: int
    operator: int | None
    tcp: int | None


class AutopilotServer:
    """Runs one `Autopilot` by the monotonic clock, without drift, until told to stop."""

    def __init__(self, config: AutopilotConfig, truth: TruthRing | None) -> None:
        self._truth = truth
        self._selector = selectors.DefaultSelector()
        self._epoch = time.monotonic()
        self.autopilot = Autopilot(config, self._epoch, time.time())
        self._ticks = 0
        self._running = True
        self._operators: dict[tuple[str, int], Link] = {}
        self._remote = _udp(0)
        target = (_HOST, config.remote_port)
        self._remote_link = self.autopilot.add_link(lambda data: _send_to(self._remote, data, target))
        self._watch(self._remote, self._read_remote)
        self._operator = None if config.operator_port is None else _udp(config.operator_port)
        if self._operator is not None:
            self._watch(self._operator, self._read_operator)
        self._listener: socket.socket | None = None
        if config.tcp_port is not None:
            self._listener = socket.create_server((_HOST, config.tcp_port))
            self._listener.setblocking(False)
            self._watch(self._listener, self._accept)
        self._control_text = b""
        self._reply: IO[str] | None = None

    @property
    def ports(self) -> Ports:
        """The ports in use."""
        operator = None if self._operator is None else int(self._operator.getsockname()[1])
        tcp = None if self._listener is None else int(self._listener.getsockname()[1])
        return Ports(self.autopilot.config.remote_port, operator, tcp)

    def control_from(self, descriptor: int, reply: IO[str]) -> None:
        """Take orders for tests, one JSON object a line, from a pipe; its end stops the autopilot."""
        os.set_blocking(descriptor, False)
        self._reply = reply
        self._selector.register(descriptor, selectors.EVENT_READ, lambda: self._read_control(descriptor))

    def stop(self) -> None:
        """End `run`."""
        self._running = False

    def run(self) -> None:
        """Fly in real time until `stop`."""
        while self._running:
            wait = self._epoch + (self._ticks + 1) * TICK_S - time.monotonic()
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

    def _catch_up(self) -> None:
        due = int((time.monotonic() - self._epoch) / TICK_S) - self._ticks
        if due > _MOST_BEHIND:
            _log.warning("stalled for %.2f s", due * TICK_S)
            self._ticks += due - 1
            due = 1
        for _ in range(due):
            self._ticks += 1
            self.autopilot.step(self._epoch + self._ticks * TICK_S)
            if self._truth is not None:
                self._truth.write(self.autopilot.truth)

    def _watch(self, source: socket.socket, read: Callable[[], None]) -> None:
        self._selector.register(source, selectors.EVENT_READ, read)

    def _read_remote(self) -> None:
        for data, _ in _datagrams(self._remote):
            self.autopilot.receive(self._remote_link, data)

    def _read_operator(self) -> None:
        operator = self._operator
        if operator is None:
            return
        for data, peer in _datagrams(operator):
            link = self._operators.get(peer)
            if link is None:
                if len(self._operators) >= _MOST_PEERS:
                    continue
                link = self.autopilot.add_link(_sender(operator, peer))
                self._operators[peer] = link
            self.autopilot.receive(link, data)

    def _accept(self) -> None:
        if self._listener is None:
            return
        with contextlib.suppress(BlockingIOError):
            peer, _ = self._listener.accept()
            peer.setblocking(False)
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            link = self.autopilot.add_link(_stream_sender(peer))
            self._watch(peer, lambda: self._read_stream(peer, link))

    def _read_stream(self, peer: socket.socket, link: Link) -> None:
        try:
            data = peer.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self.autopilot.receive(link, data)
        else:
            self._selector.unregister(peer)
            self.autopilot.remove_link(link)
            peer.close()

    def _read_control(self, descriptor: int) -> None:
        try:
            data = os.read(descriptor, 65536)
        except BlockingIOError:
            return
        if not data:
            self.stop()
            return
        *lines, self._control_text = (self._control_text + data).split(b"\n")
        for line in lines:
            try:
                order = json.loads(line)
            except ValueError:
                _log.warning("not a control order: %r", line[:100])
                continue
            if isinstance(order, dict):
                self._control(order)

    def _control(self, order: dict[str, object]) -> None:
        """Orders of the test bench; not of the air."""
        a = self.autopilot
        links = [self._remote_link] if order.get("link", "remote") == "remote" else a.links
        for link in links:
            if isinstance(loss := order.get("loss"), (int, float)):
                link.loss = float(loss)
            if isinstance(cut := order.get("cut"), bool):
                link.cut = cut
        if isinstance(battery := order.get("battery"), (int, float)):
            a.commander.battery_fraction = float(battery)
        if isinstance(switch := order.get("switch"), str) and switch in {mode.value for mode in Mode}:
            a.commander.request_mode(Mode(switch), a.now)
        if order.get("state") and self._reply is not None:
            self._reply.write(json.dumps(state_of(a)) + "\n")
            self._reply.flush()


def state_of(a: Autopilot) -> dict[str, object]:
    """What a test may want to know of the autopilot's inside."""
    c = a.commander
    home = a.home_item()
    return {
        "mode": c.mode.value,
        "armed": c.armed,
        "landed": c.landed,
        "failsafe": c.failsafe,
        "roi_enu_m": c.roi,
        "battery_fraction": c.battery_fraction,
        "setpoint_age_s": None if c.setpoint is None else a.now - c.setpoint.t_s,
        "mission_items": len(a.plan.items(MISSION, home)),
        "heading_deg": math.degrees(a.vehicle.estimate.heading),
        "position_enu_m": a.vehicle.airframe.position,
    }


def _udp(port: int) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind((_HOST, port))
    s.setblocking(False)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _OPERATOR_BUFFER)
    return s


def _datagrams(source: socket.socket) -> list[tuple[bytes, tuple[str, int]]]:
    """All that has arrived; errors of earlier sends (nobody listens yet) are none of ours."""
    found: list[tuple[bytes, tuple[str, int]]] = []
    while len(found) < 200:
        try:
            found.append(source.recvfrom(65536))
        except BlockingIOError:
            break
        except OSError as error:
            _log.debug("receiving: %s", error)
    return found


def _send_to(s: socket.socket, data: bytes, peer: tuple[str, int]) -> None:
    try:
        s.sendto(data, peer)
    except OSError as error:  # nobody listens, or the buffer is full: a radio would lose it as well
        _log.debug("sending to %s: %s", peer, error)


def _sender(s: socket.socket, peer: tuple[str, int]) -> Callable[[bytes], None]:
    return lambda data: _send_to(s, data, peer)


def _stream_sender(peer: socket.socket) -> Callable[[bytes], None]:
    def send(data: bytes) -> None:
        try:
            peer.send(data)
        except OSError as error:
            _log.debug("sending on a stream: %s", error)

    return send
