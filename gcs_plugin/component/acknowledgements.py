"""COMMAND_ACK, and the memory that tells a repeated command from a new one (MAVLink command protocol).

A command whose answer was lost is sent again, by some stations with a higher `confirmation`, by others (QGroundControl)
as it was. Neither may start anything a second time: the last answer is sent again.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

MOST_REMEMBERED: Final = 64
REPEAT_S: Final = 4.0
"""The same command again within this time of a good answer is a repetition (QGroundControl waits 3 s)."""
FORGET_S: Final = 60.0
EACH_COUNTS: Final = frozenset({mavlink.MAV_CMD_USER_3})
"""Commands that mean one step more each time: only a higher `confirmation` makes one a repetition."""
NO_PROGRESS: Final = 255


@dataclass(frozen=True, slots=True)
class Sender:
    """Who sent a command."""

    system: int
    component: int


@dataclass(frozen=True, slots=True)
class ReceivedCommand:
    """A command as it came, COMMAND_LONG or COMMAND_INT."""

    sender: Sender
    command: int
    params: tuple[float, ...]
    confirmation: int

    @property
    def key(self) -> tuple[Sender, int, tuple[str, ...]]:
        """What a repetition has in common with it (NaN is equal to itself here)."""
        return self.sender, self.command, tuple(repr(value) for value in self.params)


@dataclass(frozen=True, slots=True)
class CommandAnswer:
    """The last answer to a command."""

    command: ReceivedCommand
    result: int
    at_s: float
    progress: int = NO_PROGRESS
    running: bool = False
    """Whether the order that it started has not ended yet."""


def command_ack(command: ReceivedCommand, result: int, progress: int = NO_PROGRESS) -> Message:
    """COMMAND_ACK to a command's sender; `progress` in percent, 255 for none."""
    return mavlink.MAVLink_command_ack_message(
        command.command, result, progress, 0, command.sender.system, command.sender.component
    )


class Memory:
    """The newest answers; the oldest go when there are too many."""

    def __init__(self) -> None:
        self._answers: OrderedDict[tuple[Sender, int, tuple[str, ...]], CommandAnswer] = OrderedDict()

    def __len__(self) -> int:
        return len(self._answers)

    def repeated(self, command: ReceivedCommand, now_s: float) -> CommandAnswer | None:
        """The answer to repeat when this command came before, None when it is a new one."""
        known = self._answers.get(command.key)
        if known is None or (now_s - known.at_s > FORGET_S and not known.running):
            return None
        good = known.result in (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS)
        same = known.running or (good and now_s - known.at_s <= REPEAT_S)
        counted = command.confirmation > known.command.confirmation
        if not counted and (not same or command.command in EACH_COUNTS):
            return None
        self._answers[command.key] = replace(known, command=command)
        return known

    def remember(self, answer: CommandAnswer) -> None:
        """Keep an answer."""
        key = answer.command.key
        self._answers[key] = answer
        self._answers.move_to_end(key)
        while len(self._answers) > MOST_REMEMBERED:
            oldest = next((k for k, a in self._answers.items() if not a.running), next(iter(self._answers)))
            del self._answers[oldest]

    def forget(self, command: ReceivedCommand) -> None:
        """The order was withdrawn before it began: given again, it is a new one."""
        self._answers.pop(command.key, None)
