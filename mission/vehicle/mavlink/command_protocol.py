"""MAVLink's command protocol, the side that orders: a command is sent until it is answered.

Source: https://mavlink.io/en/services/command.html
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from pymavlink.dialects.v20 import all as mavlink

from mission.errors import LinkError
from mission.vehicle.mavlink.mailbox import Mailbox, Message


class CommandLink(Protocol):
    """What it takes to order something (`mission.vehicle.mavlink.link.MavlinkLink`)."""

    source_system: int
    source_component: int
    target_system: int

    def send(self, message: Message, *, source_component: int | None = None) -> None:
        """Send a message."""
        ...

    def listen(self, *types: str, size: int = 200) -> AbstractContextManager[Mailbox]:
        """Collect messages of these names while the context lasts."""
        ...


@dataclass(frozen=True, slots=True)
class Patience:
    """How long an answer is waited for."""

    timeout_s: float
    """Until the command is sent again."""
    retries: int
    """How often it is sent again."""
    progress_timeout_s: float
    """After each IN_PROGRESS."""


class CommandProtocol:
    """Orders over one link; equal commands wait for each other.

    Args:
        link: what they are sent on.
        clock: monotonic seconds.
    """

    def __init__(self, link: CommandLink, clock: Callable[[], float]) -> None:
        self._link = link
        self._clock = clock
        self._locks: dict[tuple[int, int], threading.Lock] = {}

    def order(
        self, build: Callable[[int], Message], command: int, patience: Patience, source_component: int | None
    ) -> int:
        """Send a command until it is answered.

        Args:
            build: the message, by the number of times that it was sent before.
            command: MAV_CMD.
            patience: for the answer.
            source_component: order as this component of ours; None for the link's own.

        Returns:
            MAV_RESULT of the final COMMAND_ACK.

        Raises:
            LinkError: nothing answered.
        """
        link = self._link
        component = link.source_component if source_component is None else source_component
        # Two equal commands at once could not tell their answers apart.
        lock = self._locks.setdefault((component, command), threading.Lock())
        with lock, link.listen("COMMAND_ACK") as acks:
            in_progress = False
            for attempt in range(patience.retries + 1):
                if in_progress:
                    break
                link.send(build(attempt), source_component=component)
                until = self._clock() + patience.timeout_s
                while (remaining := until - self._clock()) > 0.0:
                    ack = acks.get(remaining)
                    if ack is None or not self._answers(ack, command, component):
                        continue
                    if ack.result != mavlink.MAV_RESULT_IN_PROGRESS:
                        return int(ack.result)
                    in_progress, until = True, self._clock() + patience.progress_timeout_s
        name = mavlink.enums["MAV_CMD"][command].name if command in mavlink.enums["MAV_CMD"] else str(command)
        raise LinkError(
            f"the autopilot did not answer {name}", "Check the link, and that system id and component id are right"
        )

    def _answers(self, ack: Message, command: int, component: int) -> bool:
        return (
            ack.command == command
            and ack.get_srcSystem() == self._link.target_system
            and ack.target_system in (0, self._link.source_system)
            and ack.target_component in (0, component)
        )
