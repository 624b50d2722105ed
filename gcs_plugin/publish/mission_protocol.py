"""The mission protocol (mavlink.io, "Mission Protocol"): read and write the plan that is on a vehicle.

PX4 asks for items with MISSION_REQUEST_INT, ArduPilot with MISSION_REQUEST; both take MISSION_ITEM_INT for an answer.
Lost messages are asked for again: by us while reading, by the vehicle while writing (an item that comes twice makes
ArduPilot answer "invalid sequence", so none is sent unasked).
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import common as mavlink

from gcs_plugin.publish.messages import Inbox, Link, Message, enum_name
from mission.errors import AnswerError

_PLAN: Final = mavlink.MAV_MISSION_TYPE_MISSION
_PACE_ITEMS: Final = 10
"""After this many the pace of a transfer shows, although one of them was lost."""


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item of a plan, as MISSION_ITEM_INT carries it; its place in the plan is its number."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1
    current: int = 0
    """Whether the vehicle is flying to it: no part of the plan. Sent back as read, so that PX4 goes on from there."""

    def same_as(self, other: MissionItem) -> bool:
        """Equal to the last bit but for `current`; not-a-number equals itself."""
        return self._bits() == other._bits()

    def _bits(self) -> tuple[int, int, int, int, int, bytes]:
        numbers = [math.nan if math.isnan(number) else number for number in (*self.params, self.z)]
        return self.frame, self.command, self.x, self.y, self.autocontinue, struct.pack("<5f", *numbers)


class MissionProtocol:
    """Reads and writes the plan of the vehicle at the other end of a link.

    Args:
        link: to the vehicle.
        answer_timeout_s: how long to wait for each answer.
        retries: how often to ask again, or to wait on while writing.
        clock: seconds.
    """

    def __init__(
        self,
        link: Link,
        *,
        answer_timeout_s: float = 1.5,
        retries: int = 5,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.link = link
        self._timeout_s = answer_timeout_s
        self._retries = retries
        self._clock = clock

    def download(self, within_s: float = math.inf) -> tuple[MissionItem, ...]:
        """The plan on the vehicle, in order; on ArduPilot the first item is home.

        Args:
            within_s: give up as soon as it shows that the whole will take longer.

        Raises:
            AnswerError: the vehicle refused, did not answer or answers too slowly for its many items.
        """
        to = (self.link.target_system, self.link.target_component)
        with self.link.listen("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK") as inbox:
            request = mavlink.MAVLink_mission_request_list_message(*to, _PLAN)
            count = self._ask(inbox, request, lambda m: m.get_type() == "MISSION_COUNT", "how many items it has").count
            items: list[MissionItem] = []
            started = self._clock()
            for seq in range(count):
                expected_s = (self._clock() - started) * count / max(seq, 1)
                if seq >= _PACE_ITEMS and expected_s > within_s:
                    self.link.send(
                        mavlink.MAVLink_mission_ack_message(*to, mavlink.MAV_MISSION_OPERATION_CANCELLED, _PLAN)
                    )
                    raise AnswerError(
                        f"The plan has {count} items, and reading them alone takes {expected_s:.0f} s on this link",
                        "Add the waypoint in the ground station, or use a faster link.",
                    )
                request = mavlink.MAVLink_mission_request_int_message(*to, seq, _PLAN)
                item = self._ask(inbox, request, _is_item(seq), f"item {seq + 1} of {count}")
                params = (item.param1, item.param2, item.param3, item.param4)
                items.append(
                    MissionItem(
                        item.frame, item.command, params, item.x, item.y, item.z, item.autocontinue, item.current
                    )
                )
            self.link.send(mavlink.MAVLink_mission_ack_message(*to, mavlink.MAV_MISSION_ACCEPTED, _PLAN))
        return tuple(items)

    def upload(self, items: Sequence[MissionItem]) -> None:
        """Replace the plan on the vehicle; an empty one clears it.

        Raises:
            AnswerError: the vehicle refused, fell silent or did not ask for every item. What is on the vehicle then
                must be read back: a lost acknowledgement looks the same.
        """
        to = (self.link.target_system, self.link.target_component)
        with self.link.listen("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK") as inbox:
            if not items:
                clear = mavlink.MAVLink_mission_clear_all_message(*to, _PLAN)
                self._ask(inbox, clear, _is_accepted, "that its plan is cleared")
                return
            announcement = mavlink.MAVLink_mission_count_message(*to, len(items), _PLAN)
            self.link.send(announcement)
            asked: set[int] = set()
            silent = 0
            # A vehicle that asks for ever for the same item is given up too.
            for _ in range((self._retries + 2) * (len(items) + 2)):
                if silent > self._retries:
                    break
                message = self._next(inbox, _is_any)
                if message is None:
                    silent += 1
                    if not asked:
                        self.link.send(announcement)
                elif message.get_type() == "MISSION_ACK":
                    if message.type == mavlink.MAV_MISSION_ACCEPTED and len(asked) == len(items):
                        return
                    # Neither an acceptance of what was not sent yet nor a duplicate ends the transfer: silence does.
                    if message.type not in (mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_INVALID_SEQUENCE):
                        raise _refused(message)
                elif message.seq < len(items):
                    silent = 0
                    asked.add(message.seq)
                    self.link.send(self._item_message(message.seq, items[message.seq]))
        raise AnswerError(
            f"The vehicle did not finish taking the plan ({len(asked)} of {len(items)} items asked for)",
            "Check the link and try again.",
        )

    def autopilot(self) -> int:
        """MAV_AUTOPILOT of the vehicle, from its next heartbeat.

        Raises:
            AnswerError: none came.
        """
        until = self._clock() + 3.0
        with self.link.listen("HEARTBEAT") as inbox:
            while (left := until - self._clock()) > 0.0:
                message = inbox.get(left)
                if message is not None and self._from_vehicle(message):
                    return int(message.autopilot)
        raise AnswerError("The vehicle sends no heartbeat", "Check the link and try again.")

    def _item_message(self, seq: int, item: MissionItem) -> Message:
        return mavlink.MAVLink_mission_item_int_message(
            self.link.target_system,
            self.link.target_component,
            seq,
            item.frame,
            item.command,
            item.current,
            item.autocontinue,
            *item.params,
            item.x,
            item.y,
            item.z,
            _PLAN,
        )

    def _ask(self, inbox: Inbox, request: Message, wanted: Callable[[Message], bool], what: str) -> Message:
        """Ask until the wanted message comes."""
        for _ in range(self._retries + 1):
            self.link.send(request)
            message = self._next(inbox, lambda m: wanted(m) or _is_refusal(m))
            if message is not None and not wanted(message):
                raise _refused(message)
            if message is not None:
                return message
        raise AnswerError(f"The vehicle does not say {what}", "Check the link and try again.")

    def _next(self, inbox: Inbox, wanted: Callable[[Message], bool]) -> Message | None:
        """The next wanted message of the vehicle for us and about the plan, or None after the time for an answer."""
        until = self._clock() + self._timeout_s
        while (left := until - self._clock()) > 0.0:
            message = inbox.get(left)
            if message is not None and self._for_us(message) and wanted(message):
                return message
        return None

    def _from_vehicle(self, message: Message) -> bool:
        source = (message.get_srcSystem(), message.get_srcComponent())
        return source == (self.link.target_system, self.link.target_component)

    def _for_us(self, message: Message) -> bool:
        return bool(
            self._from_vehicle(message)
            and message.target_system in (0, self.link.source_system)
            and message.target_component in (0, self.link.source_component)
            and message.mission_type == _PLAN
        )


def _is_any(message: Message) -> bool:
    return message is not None


def _is_item(seq: int) -> Callable[[Message], bool]:
    return lambda m: m.get_type() == "MISSION_ITEM_INT" and m.seq == seq


def _is_accepted(message: Message) -> bool:
    return bool(message.get_type() == "MISSION_ACK" and message.type == mavlink.MAV_MISSION_ACCEPTED)


def _is_refusal(message: Message) -> bool:
    return bool(message.get_type() == "MISSION_ACK" and message.type != mavlink.MAV_MISSION_ACCEPTED)


def _refused(ack: Message) -> AnswerError:
    return AnswerError(
        f"The vehicle refuses: {enum_name('MAV_MISSION_RESULT', ack.type)}",
        "Wait until no other ground station is reading or writing the mission, and try again.",
    )
