"""The exit codes of every command (docs/exit-codes.md)."""

from __future__ import annotations

from enum import IntEnum

from mission.errors import InputError, SidestepError


class ExitCode(IntEnum):
    """What the shell is told."""

    DONE = 0
    """All that was asked for."""
    FAILED = 1
    """It was tried and did not succeed: the message says why."""
    UNUSABLE = 2
    """An argument or a file cannot be used as it is, so nothing was tried."""
    INCOMPLETE = 3
    """It ran to its end, but an answer is missing or a wanted figure was not reached."""


def exit_code(error: SidestepError) -> ExitCode:
    """The exit code for an error that ends a command."""
    return ExitCode.UNUSABLE if isinstance(error, InputError) else ExitCode.FAILED
