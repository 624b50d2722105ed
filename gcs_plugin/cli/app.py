"""The `sidestep` command: gathers the commands and turns errors into messages and exit codes.

Exit codes: 0 done, 1 failed with a message, 2 arguments or files that cannot be read, 3 some answers are missing.
"""

from __future__ import annotations

import importlib
import os
import sys
from importlib.metadata import entry_points

import typer
from rich.console import Console

from mission.errors import SettingsError, SidestepError

app = typer.Typer(
    name="sidestep",
    help="Measure how far away a person is with one drone camera, by stepping aside.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

COMMANDS = ("locate", "serve", "plan", "estimate", "calibrate", "export", "draw", "actions", "settings")
"""Files of this folder; each has `register(app)`."""


def main() -> None:
    """Entry point of the `sidestep` command."""
    # The matrices are small: threads that wait for each other, beside a video decoder, cost more than they bring.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for name in COMMANDS:
        importlib.import_module(f"gcs_plugin.cli.{name}").register(app)
    for entry in sorted(entry_points(group="sidestep.commands"), key=lambda e: e.name):
        entry.load()(app)
    console = Console(stderr=True)
    try:
        app()
    except SettingsError as error:
        console.print(f"[red]sidestep:[/red] {error}", highlight=False)
        sys.exit(2)
    except SidestepError as error:
        console.print(f"[red]sidestep:[/red] {error}", highlight=False)
        sys.exit(1)
