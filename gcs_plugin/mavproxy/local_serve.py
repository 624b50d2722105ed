"""The `sidestep serve` that MAVProxy starts for itself, and the output through which it reaches the vehicle.

What it flies, it flies through MAVProxy: while it ends, and lets the aircraft hold, its messages must still pass. So
MAVProxy's main loop never waits for it; only at the very end, when that loop stands still, somebody else must pump.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from gcs_plugin.mavproxy.output import Message, ServeOutput
from gcs_plugin.mavproxy.serve_process import ServeProcess
from mission.errors import SettingsError

PATIENCE_S: Final = 10.0
"""For an end that was asked for, while MAVProxy's main loop runs."""
LAST_PATIENCE_S: Final = 4.0
"""For an end when the module is unloaded: MAVProxy gives that five seconds."""
_PUMP_S: Final = 0.005


def _nothing(_descriptor: int) -> None:
    """Nobody wants to know."""


class LocalServe:
    """At most one child with its output.

    Args:
        outputs: MAVProxy's list of outputs.
        hear: is told what the child sends.
        opened: is told the output's file descriptor.
        closing: is told the same, before it is closed.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        outputs: list[Any],
        hear: Callable[[Sequence[Message]], None],
        opened: Callable[[int], None] = _nothing,
        closing: Callable[[int], None] = _nothing,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._outputs = outputs
        self._hear = hear
        self._opened = opened
        self._closing = closing
        self._clock = clock
        self._process: ServeProcess | None = None
        self._kill_at_s: float | None = None
        self.output: ServeOutput | None = None

    @property
    def pid(self) -> int | None:
        """Of the child; None when there is none."""
        return None if self._process is None else self._process.pid

    @property
    def ending(self) -> bool:
        """Whether it was asked to end and has not yet."""
        return self._kill_at_s is not None

    def start(self, program: str, settings: Path | None) -> int:
        """Start it. Returns its process id.

        Raises:
            SettingsError: it runs already, or cannot be started.
        """
        if self._process is not None:
            state = "is still ending" if self.ending else "runs already"
            raise SettingsError(f"sidestep serve {state} (process {self._process.pid})")
        output = ServeOutput(self._hear)
        try:
            self._process = ServeProcess(program, output.url, settings)
        except SettingsError:
            output.close()
            raise
        self.output = output
        self._opened(output.fd)
        self._outputs.append(output)
        return self._process.pid

    def ask_to_end(self) -> None:
        """Ask it to let the aircraft hold and to end; `poll` tells when it has."""
        if self._process is not None and not self.ending:
            self._process.ask_to_end()
            self._kill_at_s = self._clock() + PATIENCE_S

    def poll(self) -> str:
        """Whether it has ended since the last call, in the operator's words; empty when it has not."""
        process = self._process
        if process is None:
            return ""
        if self._kill_at_s is not None and self._clock() > self._kill_at_s:
            process.kill()
        code = process.exit_code
        if code is None:
            return ""
        asked, words = self.ending, process.last_words()
        self._clear()
        return "ended" if asked else f"ended (exit code {code}): {words or 'no message'}"

    def end(self, pump: Callable[[], None]) -> None:
        """Let it end, now. Safe to call twice.

        Args:
            pump: passes on what has arrived, in both directions; called again and again meanwhile.
        """
        if self._process is None:
            return
        self.ask_to_end()
        until = self._clock() + LAST_PATIENCE_S
        while self._process.exit_code is None and self._clock() < until:
            pump()
            time.sleep(_PUMP_S)  # paces the pump; the process's own end ends the loop
        self._process.kill()
        self._clear()

    def _clear(self) -> None:
        if self._process is not None:
            self._process.close()
        if self.output is not None:
            self._outputs.remove(self.output)
            self._closing(self.output.fd)
            self.output.close()
        self._process, self.output, self._kill_at_s = None, None, None
