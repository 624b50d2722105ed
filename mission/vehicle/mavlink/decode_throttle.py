"""Leaves most of the frequent telemetry undecoded while nobody looks: decoding is what waiting for orders costs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.framing import MESSAGE_IDS
from mission.vehicle.state.vehicle_state import VEHICLE_MESSAGES

FREQUENT: Final = ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ATTITUDE", "CURRENT_MODE")
OTHERS_HZ: Final = 100
"""Of each kind of message from others than the vehicle's autopilot, no more are decoded: whoever floods the link does
not stop its reader."""
NEEDED_S: Final = 5.0
"""All messages are decoded for this long after they were needed last."""
THINNED_S: Final = 0.09
"""Between two that are decoded otherwise: 10 Hz, well within the second after which telemetry is stale, and within the
gap across which poses are interpolated, so that the first who needs it finds some."""


class DecodeThrottle:
    """Which frames of `FREQUENT` messages are decoded: one vehicle's only, and not all of them while nobody needs them.

    `wants` is called in the link's thread, the rest from any.

    Args:
        system: the vehicle's system id; what other vehicles on the link report is never decoded.
        now_s: program time; until `NEEDED_S` later everything is.
        sparing: whether anything is left out at all. Only for a program that looks (`need`) before it acts: the first
            look finds telemetry that is up to 0.15 s old.
        bounded: names of the messages of which others than the vehicle's autopilot may send `OTHERS_HZ` each.
    """

    def __init__(self, system: int, now_s: float, *, sparing: bool, bounded: Sequence[str] = VEHICLE_MESSAGES) -> None:
        self.passed_over: Counter[str] = Counter()
        """The vehicle's messages that were not decoded, by name."""
        self._sender = bytes((system, mavlink.MAV_COMP_ID_AUTOPILOT1))
        self._names = {MESSAGE_IDS[name]: name for name in FREQUENT}
        self._due_s = dict.fromkeys(self._names, now_s)
        self._sparing = sparing
        self._until_s = now_s + NEEDED_S
        self._others = {MESSAGE_IDS[name]: (0, now_s) for name in bounded if name not in FREQUENT}

    def need(self, now_s: float) -> None:
        """Somebody looks: decode everything for a while."""
        self._until_s = now_s + NEEDED_S

    def at_leisure(self, now_s: float) -> bool:
        """Whether nobody needs the newest, so that some may gather before they are read."""
        return self._sparing and now_s >= self._until_s

    def wants(self, message_id: int, frame: bytes, now_s: float) -> bool:
        """Whether a whole MAVLink 1 or 2 frame is to be decoded."""
        due_s = self._due_s.get(message_id)
        at = 5 if frame[0] == mavlink.PROTOCOL_MARKER_V2 else 3
        if due_s is None:
            of_others = message_id in self._others and frame[at : at + 2] != self._sender
            return not of_others or self._few(message_id, now_s)
        if frame[at : at + 2] != self._sender:
            return False
        if self.at_leisure(now_s):
            if now_s < due_s:
                self.passed_over[self._names[message_id]] += 1
                return False
            self._due_s[message_id] = now_s + THINNED_S
        return True

    def _few(self, message_id: int, now_s: float) -> bool:
        """Whether one more of this kind from somebody else is decoded in this second."""
        count, since_s = self._others[message_id]
        if not 0.0 <= now_s - since_s < 1.0:
            count, since_s = 0, now_s
        self._others[message_id] = count + 1, since_s
        return count < OTHERS_HZ
