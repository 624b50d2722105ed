"""The simulated autopilot in real time, on sockets of the loopback interface."""

from __future__ import annotations

import contextlib
import logging
import math
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass

from sitl.aircraft.server import AircraftServer, datagrams, udp_socket
from sitl.aircraft.truth import TruthRing
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flavour import Mode
from sitl.autopilot.flight_stack import TICK_S
from sitl.autopilot.link import Link
from sitl.autopilot.plan import MISSION

_log = logging.getLogger(__name__)
_HOST = "127.0.0.1"
_MOST_PEERS = 16


@dataclass(frozen=True, slots=True)
class Ports:
    """Where it is reached; None for links that are off."""

    remote: int
    operator: int | None
    tcp: int | None


class AutopilotServer(AircraftServer):
    """Runs one `Autopilot` by the monotonic clock, without drift, until told to stop."""

    def __init__(self, config: AutopilotConfig, truth: TruthRing | None) -> None:
        super().__init__(TICK_S)
        self._truth = truth
        self.autopilot = Autopilot(config, self._epoch, time.time())
        self._operators: dict[tuple[str, int], Link] = {}
        self._remote = udp_socket(_HOST, 0)
        target = (_HOST, config.remote_port)
        self._remote_link = self.autopilot.add_link(lambda data: _send_to(self._remote, data, target))
        self._watch(self._remote, self._read_remote)
        self._operator = None if config.operator_port is None else udp_socket(_HOST, config.operator_port)
        if self._operator is not None:
            self._watch(self._operator, self._read_operator)
        self._listener: socket.socket | None = None
        if config.tcp_port is not None:
            self._listener = socket.create_server((_HOST, config.tcp_port))
            self._listener.setblocking(False)
            self._watch(self._listener, self._accept)

    @property
    def ports(self) -> Ports:
        """The ports in use."""
        operator = None if self._operator is None else int(self._operator.getsockname()[1])
        tcp = None if self._listener is None else int(self._listener.getsockname()[1])
        return Ports(self.autopilot.config.remote_port, operator, tcp)

    def _tick(self, now_s: float) -> None:
        self.autopilot.step(now_s)
        if self._truth is not None:
            self._truth.write(self.autopilot.truth)

    def _read_remote(self) -> None:
        for data, _ in datagrams(self._remote):
            self.autopilot.receive(self._remote_link, data)

    def _read_operator(self) -> None:
        operator = self._operator
        if operator is None:
            return
        for data, peer in datagrams(operator):
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

    def _order(self, order: dict[str, object]) -> None:
        a = self.autopilot
        links = [self._remote_link] if order.get("link", "remote") == "remote" else a.links
        for link in links:
            if isinstance(loss := order.get("loss"), (int, float)):
                link.loss = float(loss)
            if isinstance(cut := order.get("cut"), bool):
                link.cut = cut
        if isinstance(battery := order.get("battery"), (int, float)):
            a.commander.battery_fraction = float(battery)
        if a.gimbal is not None and isinstance(fault := order.get("gimbal"), str):
            a.gimbal.gimbal.silent, a.gimbal.gimbal.frozen = fault == "silent", fault == "frozen"
        if isinstance(switch := order.get("switch"), str) and switch in {mode.value for mode in Mode}:
            a.commander.request_mode(Mode(switch), a.now)
        if order.get("state"):
            self._answer(state_of(a))


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
