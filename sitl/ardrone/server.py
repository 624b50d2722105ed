"""The simulated AR.Drone in real time, on its sockets: AT commands, navdata, and the control port."""

from __future__ import annotations

import contextlib
import logging
import socket
import time
from dataclasses import asdict, dataclass

from sitl.aircraft.server import AircraftServer, datagrams, udp_socket
from sitl.aircraft.truth import TruthRing
from sitl.ardrone.camera import ArdroneCamera
from sitl.ardrone.config import ArdroneConfig
from sitl.ardrone.drone import TICK_S, Ardrone
from sitl.ardrone.link import LOST_S

_log = logging.getLogger(__name__)
_CONTROL_CLIENTS = 4


@dataclass(frozen=True, slots=True)
class Ports:
    """Where it is reached; `video` is None without a camera."""

    at: int
    navdata: int
    control: int
    video: int | None = None


class ArdroneServer(AircraftServer):
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
        super().__init__(TICK_S)
        self._truth, self._camera = truth, camera
        self.drone = Ardrone(config, self._epoch, booted_s)
        self._at = udp_socket(config.host, config.at_port)
        self._navdata = udp_socket(config.host, config.navdata_port)
        self._control = socket.create_server((config.host, config.control_port))
        self._control.setblocking(False)
        self._listeners: list[socket.socket] = []
        self._client: tuple[str, int] | None = None
        self._client_since_s = 0.0
        self._next_navdata_s = 0.0
        self._watch(self._at, self._read_at)
        self._watch(self._navdata, self._read_navdata)
        self._watch(self._control, self._accept)

    @property
    def ports(self) -> Ports:
        """The ports in use."""
        at, navdata, control = (int(s.getsockname()[1]) for s in (self._at, self._navdata, self._control))
        return Ports(at, navdata, control, None if self._camera is None else self._camera.port)

    def close(self) -> None:
        """Close all sockets."""
        for client in self._listeners:
            client.close()
        super().close()

    def _tick(self, now_s: float) -> None:
        self.drone.step(now_s)
        if self._truth is not None:
            self._truth.write(self.drone.truth)
        self._send_navdata(now_s)

    def _catch_up(self) -> int:
        due = super()._catch_up()
        if due > 0:
            self._send_listing()
            if self._camera is not None:
                self._camera.obey(self.drone.configuration)
        return due

    def _read_at(self) -> None:
        for data, _ in datagrams(self._at):
            self.drone.receive(data, time.monotonic())

    def _read_navdata(self) -> None:
        for _, peer in datagrams(self._navdata):
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

    def _order(self, order: dict[str, object]) -> None:
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
