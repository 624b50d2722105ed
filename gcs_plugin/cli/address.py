"""A video's address from the command line, where everybody on the machine can read it, or from standard input."""

from __future__ import annotations

import sys

import typer

from mission.addresses import FROM_INPUT, has_secret
from mission.errors import SettingsError

HELP = "The video: anything FFmpeg opens; - reads its address from standard input."


def given_address(text: str) -> str:
    """The address that an option means.

    A password on the command line stands in the list of processes for as long as the program runs: that is told.

    Args:
        text: an address, or ``-`` for one line of standard input.

    Raises:
        SettingsError: standard input holds no address.
    """
    if text != FROM_INPUT:
        if has_secret(text):
            typer.echo(
                "caution: the address's password stands in the list of processes; put the address into the settings"
                " file, or give --video - and write it to standard input",
                err=True,
            )
        return text
    line = sys.stdin.readline().strip()
    if not line:
        raise SettingsError("standard input holds no address of a video", "Write it there, on one line for each -.")
    return line
