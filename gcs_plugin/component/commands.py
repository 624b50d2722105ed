"""The command protocol: COMMAND_LONG and COMMAND_INT for this component in, COMMAND_ACK out.

https://mavlink.io/en/services/command.html. An order is acknowledged before anything is done about it; one that takes
long is acknowledged as in progress, again and again, until its end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority, Refusal
from gcs_plugin.component.acknowledgements import CommandAnswer, Memory, ReceivedCommand, Sender, command_ack
from gcs_plugin.component.identity import Identity
from gcs_plugin.component.information import REQUEST_COMMANDS
from gcs_plugin.component.intervals import Intervals
from gcs_plugin.component.namesake import Namesake
from gcs_plugin.component.order_queue import OrderQueue
from gcs_plugin.component.orders import MARK_COMMANDS, ORDER_COMMANDS, STOP_COMMANDS, LocateOrder, Order, order_of

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

COMMAND_MESSAGES: Final = ("COMMAND_LONG", "COMMAND_INT", "COMMAND_CANCEL")
CANCELLED: Final = 6
"""MAV_RESULT_CANCELLED, which pymavlink's dialects do not all have."""
PROGRESS_S: Final = 0.8
"""IN_PROGRESS is said again this often: stations give up after some seconds without."""
REFUSAL_TEXT_S: Final = 5.0

_GUARDED: Final = frozenset((*ORDER_COMMANDS, *STOP_COMMANDS, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL))
"""Only for those who may give orders; anybody may ask for information."""
_INFORMING: Final = frozenset((*REQUEST_COMMANDS, mavlink.MAV_CMD_REQUEST_MESSAGE))
"""Also answered where they are sent to everybody (component 0), as some stations do."""


class CommandServer:
    """Reads commands, leaves orders on the desk, acknowledges.

    Args:
        identity: the component's.
        authority: who may give orders.
        desk: where the loop takes its orders from.
        intervals: of the messages sent regularly.
        box_locates: whether a box on the video starts a flight.
        namesake: whether somebody else has the component's ids.
        requested: sends the message with an id; False when there is no such message.
        send: sends a message.
        say: tells the operator.
    """

    def __init__(
        self,
        identity: Identity,
        authority: Authority,
        desk: OrderQueue,
        intervals: Intervals,
        *,
        box_locates: Callable[[], bool],
        namesake: Namesake,
        requested: Callable[[int], bool],
        send: Callable[[Message], None],
        say: Callable[[str], None],
    ) -> None:
        self._identity = identity
        self._authority = authority
        self._desk = desk
        self._intervals = intervals
        self._box_locates = box_locates
        self._namesake = namesake
        self._requested = requested
        self._send = send
        self._say = say
        self._memory = Memory()
        self._current: ReceivedCommand | None = None
        self._progress = 0
        self._said_progress_s = 0.0
        self._told: dict[str, float] = {}

    def take(self, message: Message, now_s: float) -> None:
        """Obey, refuse or pass over a message of `COMMAND_MESSAGES`; never raises for what is in it."""
        own = self._identity
        if message.target_system not in (0, own.system) or message.target_component not in (0, own.component):
            return
        stop = message.get_type() == "COMMAND_CANCEL" or message.command in STOP_COMMANDS
        vouched_stop = stop and self._authority.vouched(message)
        too_many = self._authority.too_many(message, now_s)
        if too_many and not vouched_stop:
            return
        broadcast = 0 in (message.target_system, message.target_component)
        if broadcast and message.command not in _INFORMING:
            return  # to whom it may concern: nobody is ordered by that
        if message.get_type() == "COMMAND_CANCEL":
            self._cancel(message, now_s)
            return
        command = _read(message)
        if command.command in _GUARDED and (refusal := self._authority.refusal(message, stop=stop)) is not None:
            if refusal.answered:
                self._acknowledge(command, mavlink.MAV_RESULT_DENIED)
            self._tell(refusal, now_s)
        elif command.command in ORDER_COMMANDS:
            self._order(command, now_s)
        elif command.command in STOP_COMMANDS:
            self.abort()  # never too many
            if not too_many:
                self._acknowledge(command, mavlink.MAV_RESULT_ACCEPTED)
        else:
            result = self._inform(command, now_s)
            if not broadcast or result == mavlink.MAV_RESULT_ACCEPTED:  # others may know what we do not
                self._acknowledge(command, result)

    def keep_up(self, now_s: float) -> None:
        """Say again that the order is in progress, when it is time to."""
        if self._current is not None and _takes_long(self._current) and now_s - self._said_progress_s >= PROGRESS_S:
            self._say_progress(self._current, now_s)

    def progress(self, percent: int, now_s: float) -> None:
        """How far the order has come."""
        if self._current is not None and percent != self._progress:
            self._progress = percent
            if _takes_long(self._current):
                self._say_progress(self._current, now_s)

    def ended(self, result: int, now_s: float) -> None:
        """The order that ran has ended; its sender is told, where it still waits for that.

        Args:
            result: MAV_RESULT.
            now_s: program time.
        """
        command, self._current = self._current, None
        if command is None:
            return
        if _takes_long(command):
            self._acknowledge(command, result)
        else:  # it was acknowledged when it was taken
            result = mavlink.MAV_RESULT_ACCEPTED
        self._memory.remember(CommandAnswer(command, result, now_s))

    def _order(self, command: ReceivedCommand, now_s: float) -> None:
        known = self._memory.repeated(command, now_s)
        if known is not None:
            self._send(command_ack(command, known.result, self._progress if known.running else known.progress))
            return
        order = order_of(command.command, command.params, box_locates=self._box_locates())
        if order is None:
            self._acknowledge(command, mavlink.MAV_RESULT_DENIED)
            self._say("refused: the order's numbers mean nothing (a place outside the picture?)")
            return
        reason = self._desk.why_not(order)
        if command.command in MARK_COMMANDS and self._namesake.present(now_s):
            reason = "another camera has our id; whom the box is meant for is not known"
        if not reason and isinstance(order, LocateOrder) and not self._authority.may_fly_again(now_s):
            reason = "too many flights were ordered; wait a little"
        if reason:
            self._acknowledge(command, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
            self._say(f"refused: {reason}")
            return
        if self._current is not None:  # the new order takes the place of one that only tracks
            self._memory.remember(CommandAnswer(self._current, mavlink.MAV_RESULT_ACCEPTED, now_s))
        self._desk.put(order)
        self._current, self._progress = command, 0
        result = mavlink.MAV_RESULT_IN_PROGRESS if _takes_long(command) else mavlink.MAV_RESULT_ACCEPTED
        self._memory.remember(CommandAnswer(command, result, now_s, running=True))
        if _takes_long(command):
            self._say_progress(command, now_s)
        else:
            self._acknowledge(command, result)

    def take_own(self, order: Order, now_s: float) -> str:
        """An order of this program's own page, with the limits of all others; why it is not taken, or empty."""
        reason = self._desk.why_not(order)
        if not reason and isinstance(order, LocateOrder) and not self._authority.may_fly_again(now_s):
            reason = "too many flights were ordered; wait a little"
        if reason:
            return reason
        if self._current is not None:  # it takes the place of one that only tracks
            self._memory.remember(CommandAnswer(self._current, mavlink.MAV_RESULT_ACCEPTED, now_s))
            self._current = None
        self._desk.put(order)
        return ""

    def abort(self) -> None:
        """End whatever waits or runs."""
        never_ran = self._desk.waiting
        self._desk.stop()
        if never_ran and self._current is not None:
            command, self._current = self._current, None
            if _takes_long(command):
                self._acknowledge(command, CANCELLED)
            self._memory.forget(command)

    def _cancel(self, message: Message, now_s: float) -> None:
        """End the order that this command gave, if it waits or runs still: the order's own acknowledgement says so.

        https://mavlink.io/en/services/command.html#long_running_commands
        """
        refusal = self._authority.refusal(message, stop=True)
        if refusal is not None:
            self._tell(refusal, now_s)
        elif self._current is not None and self._current.command == message.command:
            self.abort()

    def _inform(self, command: ReceivedCommand, now_s: float) -> int:
        """MAV_RESULT of a request for information."""
        if command.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            wanted = _whole(command.params[0])
            known = wanted is not None and self._intervals.set(wanted, command.params[1], now_s)
            return int(mavlink.MAV_RESULT_ACCEPTED if known else mavlink.MAV_RESULT_DENIED)
        if command.command == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
            wanted = _whole(command.params[0])
            if wanted is None or not 0 <= wanted <= 65535:
                return int(mavlink.MAV_RESULT_DENIED)
            self._send(mavlink.MAVLink_message_interval_message(wanted, self._intervals.interval_us(wanted)))
            return int(mavlink.MAV_RESULT_ACCEPTED)
        if command.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            wanted = _whole(command.params[0])
        else:
            wanted = REQUEST_COMMANDS.get(command.command)
            if wanted is None:
                return int(mavlink.MAV_RESULT_UNSUPPORTED)
        if wanted is None or not self._requested(wanted):
            return int(mavlink.MAV_RESULT_DENIED)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _tell(self, refusal: Refusal, now_s: float) -> None:
        # One text for each reason: the senders' names are the senders' own choice, and may be many.
        if now_s - self._told.get(refusal.reason, -math.inf) >= REFUSAL_TEXT_S:
            self._told[refusal.reason] = now_s
            self._say(f"refused: {refusal.text} ({self._authority.counts[refusal.reason]} times)")

    def _say_progress(self, command: ReceivedCommand, now_s: float) -> None:
        self._said_progress_s = now_s
        self._send(command_ack(command, mavlink.MAV_RESULT_IN_PROGRESS, self._progress))

    def _acknowledge(self, command: ReceivedCommand, result: int) -> None:
        self._send(command_ack(command, result))


def _takes_long(command: ReceivedCommand) -> bool:
    """Whether its sender waits for the end (stations give up on a box that is not accepted at once)."""
    return command.command in (mavlink.MAV_CMD_USER_1, mavlink.MAV_CMD_USER_4)


def _read(message: Message) -> ReceivedCommand:
    four = (message.param1, message.param2, message.param3, message.param4)
    sender = Sender(message.get_srcSystem(), message.get_srcComponent())
    if message.get_type() == "COMMAND_LONG":
        rest = (message.param5, message.param6, message.param7)
        return ReceivedCommand(sender, message.command, four + rest, message.confirmation)
    return ReceivedCommand(sender, message.command, (*four, float(message.x), float(message.y), message.z), 0)


def _whole(value: float) -> int | None:
    return int(value) if math.isfinite(value) and value == int(value) else None
