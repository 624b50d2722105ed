"""Orders on their way: sent until they are answered, then followed to their end (MAVLink's command protocol)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.mavproxy.arguments import TypedOrder
from gcs_plugin.publish.messages import enum_name
from mission.errors import SettingsError

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

ANSWER_S: Final = 0.7
"""Wait for an answer before sending again."""
SENDINGS: Final = 5
PROGRESS_S: Final = 10.0
"""Without news for this long a flight that was in progress is no longer believed to be."""
CANCELLED: Final = 6
"""MAV_RESULT_CANCELLED, which pymavlink's dialects do not name yet."""
_WORDS: Final = {
    mavlink.MAV_RESULT_ACCEPTED: "done",
    CANCELLED: "aborted",
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED: "refused",
    mavlink.MAV_RESULT_DENIED: "denied: wrong numbers, or this station may not order (allow-list, signing)",
    mavlink.MAV_RESULT_UNSUPPORTED: "not known to this component",
    mavlink.MAV_RESULT_FAILED: "failed",
}


@dataclass(slots=True)
class _Pending:
    order: TypedOrder
    deadline_s: float
    sendings: int = 0
    progress: int | None = None
    """Percent, once it is in progress."""


class OrderBook:
    """The orders that are not finished, at most one of a kind.

    Args:
        send: an order, and how often it was sent before.
        tell: the operator.
    """

    def __init__(self, send: Callable[[TypedOrder, int], None], tell: Callable[[str], None]) -> None:
        self._send = send
        self._tell = tell
        self._pending: dict[int, _Pending] = {}

    def place(self, order: TypedOrder, now_s: float) -> None:
        """Send an order; one of its kind that waits for its first answer is replaced.

        Raises:
            SettingsError: one of its kind is being carried out.
        """
        running = self._pending.get(order.command)
        if running is not None and running.progress is not None:
            raise SettingsError(f"{order.name} runs already ({running.progress} %)", "`locate abort` ends it.")
        self._pending[order.command] = _Pending(order, now_s)
        self.tick(now_s)

    def tick(self, now_s: float) -> None:
        """Send again what was not answered; give up what never is."""
        for command, pending in list(self._pending.items()):
            if now_s < pending.deadline_s:
                continue
            if pending.progress is not None:
                del self._pending[command]
                self._tell(f"{pending.order.name}: no news for {PROGRESS_S:.0f} s; look at the aircraft")
            elif pending.sendings >= SENDINGS:
                del self._pending[command]
                self._tell(f"{pending.order.name}: nothing answered; is `sidestep serve` running on this vehicle?")
            else:
                self._send(pending.order, pending.sendings)
                pending.sendings += 1
                pending.deadline_s = now_s + ANSWER_S

    def ack(self, message: Message, now_s: float) -> None:
        """A COMMAND_ACK of the camera component for this station."""
        pending = self._pending.get(message.command)
        if pending is None:
            return
        name, result = pending.order.name, int(message.result)
        if result == mavlink.MAV_RESULT_IN_PROGRESS:
            pending.deadline_s = now_s + PROGRESS_S
            if pending.progress is None:
                self._tell(f"{name}: accepted, in progress")
            pending.progress = min(100, int(message.progress))
            return
        del self._pending[message.command]
        self._tell(f"{name}: {_WORDS.get(result, enum_name('MAV_RESULT', result))}")

    def forget(self) -> None:
        """Whoever carried them out has ended: so have the orders."""
        for pending in self._pending.values():
            self._tell(f"{pending.order.name}: ended with sidestep serve")
        self._pending.clear()

    def summary(self) -> str:
        """What is going on; empty when nothing is."""
        return ", ".join(
            f"{p.order.name} sent" if p.progress is None else f"{p.order.name} {p.progress} %"
            for p in self._pending.values()
        )
