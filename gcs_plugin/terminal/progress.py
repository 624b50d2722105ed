"""What the person at the terminal sees while the drone flies."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.status import Status

from mission.procedure.result import Stage
from mission.records import Frame
from mission.track import Track

REFRESH_S = 0.2


class Progress:
    """A line for each stage and, on a terminal, a live line with the picture rate and the track.

    Args:
        console: where to write.
        clock: the program's clock, seconds.
    """

    def __init__(self, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._console = console
        self._clock = clock
        self._status = Status("starting", console=console) if console.is_terminal else None
        self._started_s = clock()
        self._shown_s = -1.0
        self._stage = ""
        self.frames = 0
        self._first_frame_s: float | None = None
        self._last_frame_s = 0.0

    def __enter__(self) -> Self:
        """Show the live line."""
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Take the live line away."""
        if self._status is not None:
            self._status.stop()

    def say(self, text: str, style: str = "") -> None:
        """A line that stays."""
        self._console.print(f"[dim]{self._clock() - self._started_s:6.1f} s[/dim]  ", end="")
        self._console.print(text, style=style, markup=False, highlight=False)

    def stage(self, stage: Stage, text: str) -> None:
        """A stage of the procedure began, or has news."""
        self._stage = stage.value
        self.say(f"{stage.value}: {text}")

    def frame(self, frame: Frame, track: Track | None) -> None:
        """A frame was used."""
        now = self._clock()
        self.frames += 1
        self._first_frame_s = now if self._first_frame_s is None else self._first_frame_s
        self._last_frame_s = now
        if self._status is None or now - self._shown_s < REFRESH_S:
            return
        self._shown_s = now
        seen = "" if track is None else f", {track.state} ({track.pixel[0]:.0f}, {track.pixel[1]:.0f}) px"
        self._status.update(f"{self._stage}: {self.frame_rate_hz:.0f} pictures a second{seen}")

    @property
    def frame_rate_hz(self) -> float:
        """Frames used per second since the first one."""
        if self._first_frame_s is None or self._last_frame_s <= self._first_frame_s:
            return 0.0
        return (self.frames - 1) / (self._last_frame_s - self._first_frame_s)
