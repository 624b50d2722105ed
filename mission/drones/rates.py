"""Asks the autopilot for messages at a rate, and measures what really comes."""

from __future__ import annotations

from collections.abc import Mapping

from pymavlink.dialects.v20 import all as mavlink

from mission.drones.framing import MESSAGE_IDS
from mission.drones.link import MavlinkLink

_WINDOW_S = 1.0
_ASK_AGAIN_S = 2.0
_ENOUGH = 0.8


class MessageRates:
    """Keeps messages coming at wanted rates (MAV_CMD_SET_MESSAGE_INTERVAL), asking again when they do not.

    The interval holds for the physical link, so that all who share it should want the same.

    Args:
        link: to ask on, and whose counts are read.
        wanted: message name to rate, Hz.
        now_s: time of the first count.
        undecoded: how many came that the link did not decode, by name.
    """

    def __init__(
        self, link: MavlinkLink, wanted: Mapping[str, float], now_s: float, undecoded: Mapping[str, int] | None = None
    ) -> None:
        self.wanted = dict(wanted)
        self._link = link
        self._undecoded = {} if undecoded is None else undecoded
        self._counted_s = now_s
        self._counts = dict.fromkeys(wanted, 0)
        self._asked_s: float | None = None
        self._measured: dict[str, float] = dict.fromkeys(wanted, 0.0)

    def hz(self, name: str) -> float:
        """Rate of a message over the last whole second or so."""
        return self._measured.get(name, 0.0)

    def keep(self, now_s: float) -> None:
        """Measure, and ask for what comes too slowly; call it a few times a second."""
        elapsed = now_s - self._counted_s
        if elapsed >= _WINDOW_S:
            for name in self.wanted:
                count = self._link.received[name] + self._undecoded.get(name, 0)
                self._measured[name] = (count - self._counts.get(name, 0)) / elapsed
                self._counts[name] = count
            self._counted_s = now_s
        if self._link.target_system and (self._asked_s is None or now_s - self._asked_s >= _ASK_AGAIN_S):
            for name, hz in self.wanted.items():
                if self._measured.get(name, 0.0) < _ENOUGH * hz:
                    ask_rate(self._link, name, hz)
            self._asked_s = now_s


def ask_rate(link: MavlinkLink, name: str, hz: float) -> None:
    """Ask once, without waiting, for a message at a rate (MAV_CMD_SET_MESSAGE_INTERVAL)."""
    link.send(
        mavlink.MAVLink_command_long_message(
            link.target_system,
            link.target_component,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
            0,
            MESSAGE_IDS[name],
            1e6 / hz,
            0,
            0,
            0,
            0,
            0,
        )
    )
