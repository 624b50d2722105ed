"""Judges each order that comes over the link; whatever it does not allow is counted and never obeyed."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, Literal

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority.rate import TokenBucket
from gcs_plugin.authority.signature_memory import SignatureMemory
from gcs_plugin.authority.signing import SignatureCheck
from mission.settings import AuthoritySettings

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

Reason = Literal["stranger", "unsigned", "forged", "replayed", "old", "too-many"]
FLIGHT_BURST: Final = 3.0
DOOR: Final = 2.0
"""Frames of others that are read, as a multiple of the commands that one sender may give."""
_TEXTS: Final[dict[Reason, str]] = {
    "stranger": "is not allowed to give orders",
    "unsigned": "does not sign its orders",
    "forged": "signs with another key",
    "replayed": "sent an order a second time, or its clock was set back",
    "old": "signed this {behind} ago: it was held back on its way, or its clock is wrong (set it)",
    "too-many": "sends too many commands",
}


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why somebody is not obeyed."""

    reason: Reason
    text: str

    @property
    def answered(self) -> bool:
        """Whether the sender is told: not for what may come from somebody else who bears its name."""
        return self.reason in ("stranger", "unsigned", "forged")


class Authority:
    """Who may give orders, and how many.

    Args:
        settings: the allowed senders and rates.
        key: of MAVLink 2 signing; None obeys unsigned orders, too.
        utc: the present time.
        memory: of signatures' timestamps, over a restart.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        settings: AuthoritySettings,
        key: bytes | None = None,
        utc: Callable[[], datetime] = lambda: datetime.now(UTC),
        memory: SignatureMemory | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._settings = settings
        self._allowed = frozenset(settings.allowed)
        self._signatures = None if key is None else SignatureCheck(key, utc, memory, clock)
        self._strangers = self._bucket()
        self._senders: dict[tuple[int, int], TokenBucket] = {}
        self._flights = TokenBucket(settings.flights_per_minute / 60.0, FLIGHT_BURST)
        self._door = TokenBucket(DOOR * settings.commands_per_s, 2.0 * DOOR * settings.commands_per_s)
        self.turned_away = 0
        """Frames that were not even read (`lets_in`)."""
        self.counts: Counter[Reason] = Counter()
        """Refused messages by reason."""

    def _bucket(self) -> TokenBucket:
        return TokenBucket(self._settings.commands_per_s, 2.0 * self._settings.commands_per_s)

    def knows(self, message: Message) -> bool:
        """Whether its sender's name is on the list."""
        return self._is_allowed(message.get_srcSystem(), message.get_srcComponent())

    def _is_allowed(self, system: int, component: int) -> bool:
        return str(system) in self._allowed or f"{system}/{component}" in self._allowed

    def lets_in(self, frame: bytes, now_s: float) -> bool:
        """Whether a whole frame is worth reading: a flood must not hide the orders of those who may give them.

        Theirs always are, where a key is set the signed ones that were not played before; of all others' a bounded
        number. To be called from one thread, which need not be the others'.
        """
        at = 5 if frame[0] == mavlink.PROTOCOL_MARKER_V2 else 3
        known = self._is_allowed(frame[at], frame[at + 1])
        if known and (self._signatures is None or self._signatures.first_seen(frame)):
            return True
        if self._door.take(now_s):
            return True
        self.turned_away += 1
        return False

    def too_many(self, message: Message, now_s: float) -> bool:
        """Whether this message is beyond its sender's rate, and is passed over; strangers share one rate.

        With a key, who does not sign is a stranger, whatever name it bears: nobody uses up another's rate. Names are
        bounded: the list of allowed ones is.
        """
        bucket = self._strangers
        if self.vouched(message):
            bucket = self._senders.setdefault((message.get_srcSystem(), message.get_srcComponent()), self._bucket())
        if bucket.take(now_s):
            return False
        self.counts["too-many"] += 1
        return True

    def vouched(self, message: Message) -> bool:
        """Whether it is from an allowed sender; where a key is set, signed with it, and not played again."""
        if not self.knows(message):
            return False
        return self._signatures is None or self._signatures.fresh(bytes(message.get_msgbuf()))

    def refusal(self, message: Message, *, stop: bool = False) -> Refusal | None:
        """Why this order is not obeyed, or None. To be asked once for each message: a signature counts once.

        Args:
            message: the order.
            stop: whether it only ends something, and may come late.
        """
        reason: Reason | None = None
        if not self.knows(message):
            reason = "stranger"
        elif self._signatures is not None:
            reason = self._signatures.fault(bytes(message.get_msgbuf()), ageless=stop)
        if reason is None:
            return None
        self.counts[reason] += 1
        who = f"{message.get_srcSystem()}/{message.get_srcComponent()}"
        behind_s = 0.0 if self._signatures is None else self._signatures.behind_s
        return Refusal(reason, f"{who} {_TEXTS[reason].format(behind=_span(behind_s))}")

    def hear(self, message: Message) -> None:
        """Note the signature's timestamp of something that is no order: what is older than this is refused from now on.

        Stations may count their timestamp on from their start, and the order may come much later.
        """
        if self._signatures is not None and self.knows(message):
            self._signatures.fault(bytes(message.get_msgbuf()), order=False)

    def may_fly_again(self, now_s: float) -> bool:
        """Whether one more flight may start now; if so it is counted."""
        return self._flights.take(now_s)

    def signing_timestamp(self) -> int | None:
        """For the next frame that we sign; None without a key."""
        return None if self._signatures is None else self._signatures.timestamp()


def _span(seconds: float) -> str:
    """A time span for people."""
    for unit, length_s in (("days", 86400.0), ("hours", 3600.0), ("min", 60.0)):
        if seconds >= 3.0 * length_s:
            return f"{seconds / length_s:.0f} {unit}"
    return f"{seconds:.0f} s"
