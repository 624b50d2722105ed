"""The simulated AR.Drone in real time, on its sockets: AT commands, navdata, and the control port."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import selectors
import socket
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import IO

from sitl.ardrone.camera import ArdroneCamera
from sitl.ardrone.config import ArdroneConfig
from sitl.ardrone.drone import TICK_S, Ardrone
from sitl.ardrone.link import LOST_S
from sitl.truth import TruthRing

_log = logging.getLogger(__name__)
_MOST_BEHIND = 50
"""Ticks that are made up for after a stall; more are given up (the aircraft stood still with its process)."""
_BUFFER = 1 << 20
_CONTROL_CLIENTS = 4


@dataclass(frozen=True, slots=True)
class Ports:
    """Where it is reached; `video` is None without a camera."""

    at: int
    navdata: int
    control: int
    video: int | None = None


class ArdroneServer:
    """Runs one `Ardrone` by the monotonic clock, without drift, until told to stop.

    Args:
        config: what to simulate.
        truth: gets the true state at every tick.
        booted_s: monotonic time at which the aircraft was switched on.
        camera: what serves its video, if anything does.

    Raises:
        OSError: a port is taken.
    """

    def __init__(
        self,
        config: ArdroneConfig,
        truth: TruthRing | None,
        *,
        booted_s: float | None = None,
        camera: ArdroneCamera | None = None,
    ) -> None:
        self._truth, self._camera = truth, camera
        self._selector = selectors.DefaultSelector()
        self._epoch = time.monotonic()
        self.drone = Ardrone(config, self._epoch, booted_s)
        self._ticks = 0
        self._running = True
        self._at = _udp(config.host, config.at_port)
        self._navdata = _udp(config.host, config.navdata_port)
        self._control = socket.create_server((config.host, config.control_port))
        self._control.setblocking(False)
        self._listeners: list[socket.socket] = []
        self._client: tuple[str, int] | None = None
        self._client_since_s = 0.0
        self._next_navdata_s = 0.0
        self._watch(self._at, self._read_at)
        self._watch(self._navdata, self._read_navdata)
        self._watch(self._control, self._accept)
        self._orders = b""
        self._reply: IO[str] | None = None

    @property
    def ports(self) -> Ports:
        """The ports in use."""
        at, navdata, control = (int(s.getsockname()[1]) for s in (self._at, self._navdata, self._control))
        return Ports(at, navdata, control, None if self._camera is None else self._camera.port)

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
        for client in self._listeners:
            client.close()
        self._selector.close()

    def _catch_up(self) -> None:
        due = int((time.monotonic() - self._epoch) / TICK_S) - self._ticks
        if due > _MOST_BEHIND:
            _log.warning("stalled for %.2f s", due * TICK_S)
            self._ticks += due - 1
            due = 1
        for _ in range(due):
            self._ticks += 1
            now_s = self._epoch + self._ticks * TICK_S
            self.drone.step(now_s)
            if self._truth is not None:
                self._truth.write(self.drone.truth)
            self._send_navdata(now_s)
        if due > 0:
            self._send_listing()
            if self._camera is not None:
                self._camera.obey(self.drone.configuration)

    def _watch(self, source: socket.socket, read: Callable[[], None]) -> None:
        self._selector.register(source, selectors.EVENT_READ, read)

    def _read_at(self) -> None:
        for data, _ in _datagrams(self._at):
            self.drone.receive(data, time.monotonic())

    def _read_navdata(self) -> None:
        for _, peer in _datagrams(self._navdata):
            # Whoever asked last gets the packets: the aircraft has one pilot.
            self._client, self._client_since_s = peer, time.monotonic()

    def _send_navdata(self, now_s: float) -> None:
        if self._client is None or now_s < self._next_navdata_s:
            return
        if self.drone.link.lost and now_s > self._client_since_s + LOST_S:
            self._client = None
            return
        self._next_navdata_s = max(self._next_navdata_s + self.drone.navdata_period_s, now_s)
        packet = self.drone.navdata_packet(0 if self._camera is None else self._camera.frames)
        try:
            self._navdata.sendto(packet, self._client)
        except OSError as error:  # nobody listens any more, or the buffer is full: the radio would lose it as well
            _log.debug("sending navdata to %s: %s", self._client, error)

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            client, _ = self._control.accept()
            client.setblocking(False)
            self._listeners.append(client)
            while len(self._listeners) > _CONTROL_CLIENTS:
                self._listeners.pop(0).close()

    def _send_listing(self) -> None:
        listing = self.drone.take_listing()
        while listing is not None:
            for client in list(self._listeners):
                try:
                    client.sendall(listing)
                except OSError as error:
                    _log.debug("control client gone: %s", error)
                    self._listeners.remove(client)
                    client.close()
            listing = self.drone.take_listing()

    def _read_orders(self, descriptor: int) -> None:
        try:
            data = os.read(descriptor, 65536)
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

    def _order(self, order: dict[str, object]) -> None:
        """Orders of the test bench; not of the air."""
        commander = self.drone.commander
        if isinstance(battery := order.get("battery_percent"), (int, float)):
            commander.battery_percent = float(battery)
        if order.get("state"):
            self._answer(state_of(self.drone))
        if self._camera is not None:
            fault = order.get("video")
            if fault == "freeze" or fault == "cut" or fault == "resume":
                self._camera.process.fault(fault)
            if order.get("camera"):
                self._answer(asdict(self._camera.process.stats()))

    def _answer(self, content: dict[str, object]) -> None:
        if self._reply is not None:
            self._reply.write(json.dumps(content) + "\n")
            self._reply.flush()


def state_of(drone: Ardrone) -> dict[str, object]:
    """What a test may want to know of the aircraft's inside."""
    commander = drone.commander
    return {
        "state": commander.state.name,
        "emergency": commander.emergency,
        "lost": drone.link.lost,
        "battery_percent": commander.battery_percent,
        "position_enu_m": drone.aircraft.position_enu_m,
        "velocity_enu_m_s": drone.aircraft.velocity_enu_m_s,
        "ids": drone.configuration.ids,
        "euler_angle_max_rad": drone.configuration.number("control:euler_angle_max"),
        "video_codec": int(drone.configuration.number("video:video_codec")),
    }


def _udp(host: str, port: int) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind((host, port))
    s.setblocking(False)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
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
