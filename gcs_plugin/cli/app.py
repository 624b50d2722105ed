"""The `sidestep` command: gathers the commands and turns errors into messages and exit codes."""

from __future__ import annotations

import os
import sys
from importlib.metadata import entry_points, version
from typing import Annotated, cast

import typer
from typer.core import TyperGroup
from typer.main import get_command

from gcs_plugin.cli.exit_codes import exit_code
from gcs_plugin.cli.lazy import LazyCommand
from gcs_plugin.cli.missing_extra import missing_extra
from mission.errors import SidestepError

COMMANDS = (
    "locate",
    "serve",
    "console",
    "plan",
    "estimate",
    "calibrate",
    "export",
    "draw",
    "reprocess",
    "archive",
    "replay",
    "replay",
    "actions",
    "settings",
)
"""Files of this folder; each has `register(app)`."""


def program() -> TyperGroup:
    """The command with all its subcommands, none of them imported yet.

    Other packages add theirs by the entry point group `sidestep.commands`: NAME = "MODULE:register".
    """
    app = typer.Typer(name="sidestep", no_args_is_help=True, pretty_exceptions_enable=False)
    app.callback()(sidestep)
    group = cast(TyperGroup, get_command(app))  # a callback makes it a group
    modules = {name: f"gcs_plugin.cli.{name}" for name in COMMANDS}
    for entry in sorted(entry_points(group="sidestep.commands"), key=lambda e: e.name):
        modules.setdefault(entry.name, entry.module)
    for name, module in modules.items():
        group.add_command(LazyCommand(name, module))
    return group


def sidestep(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version and end.", is_eager=True, callback=lambda v: _version(v)),
    ] = False,
) -> None:
    """Measure how far away a person is with one drone camera, by stepping aside."""


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"sidestep {version('sidestep')}")
        raise typer.Exit


def main() -> None:
    """Entry point of the `sidestep` command."""
    # The matrices are small: threads that wait for each other, beside a video decoder, cost more than they bring.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        program()()
    except SidestepError as error:
        _end(error)
    except ModuleNotFoundError as error:
        named = missing_extra(error)
        if named is None:
            raise
        _end(named)


def _end(error: SidestepError) -> None:
    from rich.console import Console
    from rich.markup import escape

    Console(stderr=True).print(f"[red]sidestep:[/red] {escape(str(error))}", highlight=False)
    sys.exit(exit_code(error))
