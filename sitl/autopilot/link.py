"""One MAVLink peer of the autopilot: its parser, its sequence numbers, its message rates, and faults of the radio."""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

_log = logging.getLogger(__name__)
AUTOPILOT_COMPONENT: int = mavlink.MAV_COMP_ID_AUTOPILOT1


class Link:
    """Bytes in, messages out, and the other way round.

    Args:
        write: sends bytes to the peer; must not block.
        system_id: the autopilot's.
        rates: what is sent unasked, Hz by message id.
        rng: decides which packets are lost.
    """

    def __init__(
        self, write: Callable[[bytes], None], system_id: int, rates: Mapping[int, float], rng: np.random.Generator
    ) -> None:
        self._write = write
        self._rng = rng
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=AUTOPILOT_COMPONENT)
        self._mav.robust_parsing = True
        self.loss = 0.0
        """Fraction of packets lost each way."""
        self.cut = False
        self.defaults = dict(rates)
        self.intervals: dict[int, float] = {key: 1.0 / hz for key, hz in rates.items() if hz > 0.0}
        """Seconds between messages, by message id."""
        self._due: dict[int, float] = {}
        self.seen: set[tuple[int, int]] = set()
        """(system, component) heard on this link."""

    def feed(self, data: bytes) -> list[Any]:
        """The valid messages in what came from the peer; anything else is dropped."""
        if self._lost():
            return []
        try:
            messages = self._mav.parse_buffer(data) or []
        except (mavlink.MAVError, struct.error, ValueError, IndexError, TypeError, AttributeError) as error:
            # pymavlink trips over some malformed packets even in its robust mode; its buffer is then beyond use
            _log.debug("malformed MAVLink: %s", error)
            fresh = mavlink.MAVLink(None, srcSystem=self._mav.srcSystem, srcComponent=AUTOPILOT_COMPONENT)
            fresh.robust_parsing, fresh.seq = True, self._mav.seq
            self._mav = fresh
            return []
        good = [m for m in messages if m.get_msgId() >= 0 and not m.get_type().startswith("UNKNOWN")]
        self.seen.update((m.get_srcSystem(), m.get_srcComponent()) for m in good)
        return good

    def send(self, message: Any) -> None:
        """Pack with this link's sequence number and send."""
        packed = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        self.forward(packed)

    def forward(self, packed: bytes) -> None:
        """Send another component's packet as it is."""
        if not self._lost():
            self._write(bytes(packed))

    def set_interval(self, message_id: int, interval_s: float | None) -> None:
        """Send a message regularly; None stops it."""
        if interval_s is None:
            self.intervals.pop(message_id, None)
        else:
            self.intervals[message_id] = interval_s
        self._due.pop(message_id, None)

    def due(self, now: float) -> list[int]:
        """Ids of the messages whose time has come; late ones are not made up for."""
        ids = []
        for message_id, interval in self.intervals.items():
            at = self._due.get(message_id, now)
            if now >= at - 1e-4:
                ids.append(message_id)
                self._due[message_id] = at + interval if at + interval > now else now + interval
        return ids

    def _lost(self) -> bool:
        return self.cut or (self.loss > 0.0 and self._rng.random() < self.loss)
