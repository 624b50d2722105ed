"""The radio link as the aircraft sees it: which commands are too old, and whether the pilot is still there.

Commands carry a growing number; one that is not above the last is ignored, and 1 starts anew (SDK 2.0, section 6.1).
The watchdog is that of section 7.1.2: a bit after 50 ms of silence, which only COMWDG clears, and after 2 s the pilot
counts as lost: the aircraft hovers, the navdata stops, and the next packet finds a link that starts from scratch.
"""

from __future__ import annotations

WATCHDOG_S = 0.05
LOST_S = 2.0


class PilotLink:
    """Sequence rule and watchdog; times in monotonic seconds."""

    def __init__(self) -> None:
        self._last = 0
        self._heard_s: float | None = None
        self.watchdog = False
        """Bit 30: there was a silence, and no COMWDG since."""
        self.lost = False
        """Bit 13: nobody pilots."""

    def heard(self, now_s: float) -> None:
        """A datagram came."""
        if self.lost:
            self.lost = False
            self._last = 0
        self._heard_s = now_s

    def accepts(self, sequence: int) -> bool:
        """Whether a command is new; remembers its number."""
        if sequence != 1 and sequence <= self._last:
            return False
        self._last = sequence
        return True

    def reset_watchdog(self) -> None:
        """COMWDG."""
        self.watchdog = False

    def step(self, now_s: float) -> bool:
        """Let time pass; True at the moment when the pilot is lost."""
        if self._heard_s is None:
            return False
        silent_s = now_s - self._heard_s
        if silent_s > WATCHDOG_S:
            self.watchdog = True
        if silent_s > LOST_S and not self.lost:
            self.lost = True
            return True
        return False
