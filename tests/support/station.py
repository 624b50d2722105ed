"""A ground station on a vehicle's link: heartbeats, commands, and everything that came."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from types import TracebackType
from typing import Any, Self

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority.signing import timestamp_of
from mission.vehicle.mavlink.framing import decode, frames

Message = Any


class Station:
    """Connects to ``udpout://HOST:PORT``. Use as a context.

    Args:
        url: the autopilot's operator link.
        key: signs everything with it when given.
        source: system and component id.
        system: of the vehicle that is meant where none is named.
    """

    def __init__(
        self, url: str, key: bytes | None = None, source: tuple[int, int] = (255, 190), *, system: int = 1
    ) -> None:
        host, port = url.removeprefix("udpout://").split(":")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect((host, int(port)))
        self._socket.settimeout(0.05)
        self._source = source
        self._system = system
        self._mav = mavlink.MAVLink(None, *source)
        if key is not None:
            self._mav.signing.secret_key, self._mav.signing.sign_outgoing = key, True
        self._parser = mavlink.MAVLink(None)
        self._lock = threading.Lock()
        self._messages: list[Message] = []
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
        self._thread.join()
        self._socket.close()

    def command(self, command: int, *params: float, component: int = 100, system: int | None = None) -> None:
        system = self._system if system is None else system
        seven = [*params, *([0.0] * 7)][:7]
        self.send(mavlink.MAVLink_command_long_message(system, component, command, 0, *seven))

    def send(self, message: Message) -> None:
        with self._lock:
            signing = self._mav.signing
            signing.timestamp = max(signing.timestamp, timestamp_of(datetime.now(UTC)))
            packed = message.pack(self._mav)
            self._mav.seq = (self._mav.seq + 1) % 256
            self._socket.send(packed)

    def found(self, name: str, component: int = 100, system: int | None = None) -> list[Message]:
        """Messages of a type from a component, oldest first."""
        system = self._system if system is None else system
        with self._lock:
            messages = list(self._messages)
        wanted = (system, component)
        return [m for m in messages if m.get_type() == name and (m.get_srcSystem(), m.get_srcComponent()) == wanted]

    def results(self, command: int, component: int = 100, system: int | None = None) -> list[int]:
        """MAV_RESULT of the acknowledgements of a command of ours."""
        acks = [m for m in self.found("COMMAND_ACK", component, system) if m.command == command]
        return [m.result for m in acks if (m.target_system, m.target_component) == self._source]

    def texts(self) -> str:
        return " ".join(m.text for m in self.found("STATUSTEXT"))

    def take_off(self, height_m: float) -> None:
        """Arm and climb; returns in the air."""
        assert until(lambda: self.found("HOME_POSITION", 1) and self.found("GLOBAL_POSITION_INT", 1), 60.0)
        ground_m = self.found("GLOBAL_POSITION_INT", 1)[-1].alt * 1e-3

        def armed() -> bool:
            self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, component=1)
            return until(lambda: 0 in self.results(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1), 1.0)

        assert until(armed, 60.0)
        nan = float("nan")
        self.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0.0, 0.0, 0.0, nan, nan, nan, ground_m + height_m, component=1)
        assert until(lambda: self._height() > 0.85 * height_m, 60.0)
        in_air = mavlink.MAV_LANDED_STATE_IN_AIR
        assert until(lambda: self.found("EXTENDED_SYS_STATE", 1)[-1].landed_state == in_air, 10.0)

    def _height(self) -> float:
        return float(self.found("GLOBAL_POSITION_INT", 1)[-1].relative_alt * 1e-3)

    def _run(self) -> None:
        beat_s = 0.0
        while not self._end.is_set():
            if time.monotonic() - beat_s > 1.0:
                beat_s = time.monotonic()
                self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            try:
                data = self._socket.recv(65535)
            except TimeoutError:
                continue
            found = [decode(self._parser, frame) for _, frame in frames(data)]
            with self._lock:
                self._messages += [message for message in found if message is not None]


def until(condition: Callable[[], object], timeout_s: float) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)  # looks again until the deadline
    return bool(condition())
