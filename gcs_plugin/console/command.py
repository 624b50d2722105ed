"""Who is in command: of all that may give orders from pages, one at a time does."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

FREE_AFTER_S: Final = 8.0
"""A commander whose last page has gone for this long holds the command no more."""


@dataclass(slots=True)
class _Holder:
    session: str
    name: str
    gone_s: float | None = None


class Command:
    """The command over the drone, as far as pages give orders. Any thread may call it.

    Args:
        clock: monotonic seconds.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._holder: _Holder | None = None
        self._pages: dict[str, int] = {}

    def opened(self, session: str) -> None:
        """A page of this session has connected."""
        with self._lock:
            self._pages[session] = self._pages.get(session, 0) + 1
            if self._holder is not None and self._holder.session == session:
                self._holder.gone_s = None

    def closed(self, session: str) -> None:
        """A page of this session has gone."""
        with self._lock:
            left = self._pages.get(session, 1) - 1
            if left > 0:
                self._pages[session] = left
                return
            self._pages.pop(session, None)
            if self._holder is not None and self._holder.session == session:
                self._holder.gone_s = self._clock()

    def take(self, session: str, name: str) -> str:
        """Take the command, or keep it. Returns why not; empty when it is this session's now."""
        with self._lock:
            holder = self._present()
            if holder is not None and holder.session != session:
                return f"{holder.name} is in command"
            self._holder = _Holder(session, name)
            return ""

    def release(self, session: str) -> None:
        """Give the command up, where this session has it."""
        with self._lock:
            if self._holder is not None and self._holder.session == session:
                self._holder = None

    def holder(self) -> tuple[str, str] | None:
        """Session and name of who is in command."""
        with self._lock:
            found = self._present()
            return None if found is None else (found.session, found.name)

    def _present(self) -> _Holder | None:
        holder = self._holder
        if holder is not None and holder.gone_s is not None and self._clock() - holder.gone_s > FREE_AFTER_S:
            self._holder = holder = None
        return holder
