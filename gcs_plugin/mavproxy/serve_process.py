"""`sidestep serve` as a child of MAVProxy."""

from __future__ import annotations

import contextlib
import logging
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Final

from mission.errors import SettingsError

_LOG = logging.getLogger(__name__)
DEFAULT_PROGRAM: Final = shlex.join([sys.executable, "-m", "gcs_plugin.mavproxy.child"])
"""The `sidestep` command that ends with its parent."""
_TAIL_BYTES: Final = 4096
_FRAME: Final = " \t│─╭╮╰╯"
"""What the command line draws around its messages."""


class ServeProcess:
    """A running `sidestep serve`. It ends when asked, and also when this process dies (`gcs_plugin.mavproxy.child`).

    Args:
        program: the command line before ``serve``.
        url: where it meets the vehicle.
        settings: its settings file; None for all defaults.
        options: further options.

    Raises:
        SettingsError: the program cannot be started.
    """

    def __init__(self, program: str, url: str, settings: Path | None, options: Sequence[str] = ()) -> None:
        self._output: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  # closed by `close`
        try:
            command = [*shlex.split(program), "serve", "--link", url]
            if settings is not None:
                command += ["--settings", str(settings)]
            # a session of its own: Ctrl-C is for MAVProxy, which then ends this one in its own way
            self._process = subprocess.Popen(
                [*command, *options],
                stdin=subprocess.PIPE,
                stdout=self._output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            self._output.close()
            raise SettingsError(
                f"{program!r} cannot be started: {error}", "`locate set program COMMAND` names the sidestep command."
            ) from error

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """None while it runs."""
        return self._process.poll()

    def last_words(self) -> str:
        """The last line of words that it wrote; empty when there is none."""
        descriptor = self._output.fileno()
        # `pread` leaves the position alone, which this file shares with the child
        tail = os.pread(descriptor, _TAIL_BYTES, max(0, os.fstat(descriptor).st_size - _TAIL_BYTES))
        lines = [line.strip(_FRAME) for line in tail.decode("utf-8", "replace").splitlines()]
        return next((line for line in reversed(lines) if line), "")

    def ask_to_end(self) -> None:
        """SIGTERM: it lets the aircraft hold, and ends."""
        self._process.terminate()

    def kill(self) -> None:
        """End it at once, if it has not ended."""
        if self.exit_code is None:
            _LOG.warning("sidestep serve (%d) did not end when asked; killed", self.pid)
            self._process.kill()
            self._process.wait()

    def close(self) -> None:
        """Let go of a process that has ended."""
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
        self._output.close()
