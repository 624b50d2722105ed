"""What passed between an aircraft and what flies it, and when: the record that reaction times are measured on."""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from sitl.faults.relay import Towards

_SETPOINTS = ("SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET")
_KEPT = 200_000


class Wiretap:
    """Keeps each datagram with its time; it decodes only when it is asked, so that listening costs nothing.

    An instance is the `tap` of a `FaultRelay`. Times are those of the relay's clock, seconds.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seen: list[tuple[float, Towards, bytes]] = []

    def __call__(self, t_s: float, towards: Towards, data: bytes) -> None:
        """Note a datagram."""
        with self._lock:
            self._seen.append((t_s, towards, data))
            if len(self._seen) > _KEPT:
                del self._seen[: _KEPT // 2]

    def clear(self) -> None:
        """Forget what passed."""
        with self._lock:
            self._seen.clear()

    def messages(self, towards: Towards, *names: str, since_s: float = 0.0) -> Iterator[tuple[float, Any]]:
        """Time and message, oldest first, of what went this way under these names."""
        with self._lock:
            seen = list(self._seen)
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        for t_s, direction, data in seen:
            if direction != towards or t_s < since_s:
                continue
            try:
                found = parser.parse_buffer(data) or []
            except (mavlink.MAVError, struct.error, ValueError, IndexError):
                continue
            yield from ((t_s, m) for m in found if m.get_type() in names)

    def setpoints_s(self, since_s: float = 0.0) -> list[float]:
        """Times at which setpoints of any kind went to the vehicle."""
        return [t_s for t_s, _ in self.messages("vehicle", *_SETPOINTS, since_s=since_s)]

    def mode_orders(self, since_s: float = 0.0) -> list[tuple[float, int, int]]:
        """Time, main mode and sub mode (0 on ArduPilot) of each MAV_CMD_DO_SET_MODE that went to the vehicle."""
        return [
            (t_s, int(m.param2), int(m.param3))
            for t_s, m in self.messages("vehicle", "COMMAND_LONG", since_s=since_s)
            if m.command == mavlink.MAV_CMD_DO_SET_MODE
        ]

    def modes_s(self, custom_mode: int, since_s: float = 0.0) -> list[float]:
        """Times at which the vehicle said that it is in a mode (HEARTBEAT, CURRENT_MODE)."""
        return [
            t_s
            for t_s, m in self.messages("program", "HEARTBEAT", "CURRENT_MODE", since_s=since_s)
            if m.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1 and m.custom_mode == custom_mode
        ]
