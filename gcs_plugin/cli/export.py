"""`sidestep export`: write the geotags of a log as GeoJSON, KML or CSV."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from gcs_plugin.durable import write_whole
from gcs_plugin.export import FORMATS
from gcs_plugin.geotags import read_geotags
from mission.errors import AnswerError, SettingsError

Format = Enum("Format", {name: name for name in FORMATS})  # type: ignore[misc]  # the choices are the formats


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("export")(export)


def export(
    log: Annotated[Path, typer.Argument(help="The GeoPackage that holds the geotags.")],
    to: Annotated[Format, typer.Option("--format", help="What to write.")],
    output: Annotated[Path | None, typer.Option(help="The file to write; standard output without it.")] = None,
) -> None:
    """Write the geotags of LOG as GeoJSON, KML or CSV."""
    if not log.is_file():
        raise SettingsError(f"There is no geotag log {log}", "Check the path; `sidestep locate` prints it.")
    try:
        geotags = read_geotags(log, told=lambda text: typer.echo(text, err=True))
    except AnswerError as error:
        raise SettingsError(error.cause, "Name a log that Sidestep wrote.") from error
    content = FORMATS[to.value](geotags).encode("utf-8")  # what all three formats are in, whatever the terminal's is
    if output is None:
        typer.echo(content, nl=False)
    else:
        write_whole(output, content)
