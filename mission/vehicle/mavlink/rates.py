"""Asks the autopilot for messages at a rate, and measures what really comes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.framing import MESSAGE_IDS
from mission.vehicle.mavlink.link import MavlinkLink

_WINDOW_S = 1.0
_ASK_AGAIN_S = 2.0
_OFTEN = 3
"""Times that a message is asked for every two seconds; from then on it is three times as long each time."""
_LONGEST_S = 60.0
_STEADY_S = 30.0
"""A message that came often enough for so long is asked for as often as at first when it becomes rare again."""
_ENOUGH = 0.8


@dataclass(slots=True)
class _Asking:
    """How often a message was asked for since it came often enough, and from when on it may be asked for again."""

    times: int = 0
    again_s: float = -math.inf
    enough_since_s: float | None = None

    def due(self, now_s: float, *, enough: bool) -> bool:
        """Whether to ask now; if so, it is counted."""
        if enough:
            if self.enough_since_s is None:
                self.enough_since_s = now_s
            if now_s - self.enough_since_s >= _STEADY_S:
                self.times, self.again_s = 0, -math.inf
            return False
        self.enough_since_s = None
        if now_s < self.again_s:
            return False
        self.times += 1
        self.again_s = now_s + min(_ASK_AGAIN_S * 3.0 ** max(0, self.times - _OFTEN), _LONGEST_S)
        return True


class MessageRates:
    """Keeps messages coming at wanted rates (MAV_CMD_SET_MESSAGE_INTERVAL), asking again when they do not.

    A link that gives less is asked more and more seldom: each request has an answer that fills it and the operator's
    console. The interval holds for the physical link, so that all who share it should want the same.

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
        self._asking = {name: _Asking() for name in wanted}
        self._looked_s: float | None = None
        self._told = False
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
        if self._link.target_system and (self._looked_s is None or now_s - self._looked_s >= _WINDOW_S):
            self._looked_s = now_s
            for name, hz in self.wanted.items():
                if self._asking[name].due(now_s, enough=self._measured.get(name, 0.0) >= _ENOUGH * hz):
                    ask_rate(self._link, name, hz)

    def shortfall(self) -> str:
        """What the link gives less of than was asked for, in the operator's words: once, after a few requests."""
        short = [name for name in self.wanted if self._asking[name].times > _OFTEN]
        if self._told or not short:
            return ""
        self._told = True
        rates = ", ".join(f"{self._measured[name]:.0f} of {self.wanted[name]:.0f} Hz of {name}" for name in short)
        return f"this link gives {rates}; it is asked more seldom from now on"


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
