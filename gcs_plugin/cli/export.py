"""`sidestep export`: write the geotags of a log for maps, hand-held receivers, TAK and spreadsheets."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from gcs_plugin.durable import write_whole
from gcs_plugin.exports.formats import FORMATS, format_of
from gcs_plugin.geotags.log import read_geotags
from mission.errors import AnswerError, SettingsError

Format = Enum("Format", {name: name for name in FORMATS})  # type: ignore[misc]  # the choices are the formats


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("export")(export)


def export(
    log: Annotated[Path, typer.Argument(help="The GeoPackage that holds the geotags.")],
    to: Annotated[
        Format | None, typer.Option("--format", help="What to write; else the file's ending says it.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option(help="The file to write; standard output without it, or for -.")
    ] = None,
    number: Annotated[list[int] | None, typer.Option(help="Only this target; repeat it for several.")] = None,
) -> None:
    """Write the geotags of LOG for maps, hand-held receivers, TAK and spreadsheets."""
    to_file = None if output is None or str(output) == "-" else output
    if to is None and to_file is None:
        raise SettingsError("It is not said what to write", "Give --format, or a file with an ending by --output.")
    form = format_of(to_file) if to is None and to_file is not None else (to.value if to is not None else "")
    if not log.is_file():
        raise SettingsError(f"There is no geotag log {log}", "Check the path; `sidestep locate` prints it.")
    try:
        geotags = read_geotags(log, told=lambda text: typer.echo(text, err=True))
    except AnswerError as error:
        raise SettingsError(error.cause, "Name a log that Sidestep wrote.") from error
    if number:
        missing = set(number) - {geotag.number for geotag in geotags}
        if missing:
            raise SettingsError(f"The log has no target {min(missing)}", "`sidestep export --format csv` lists them.")
        geotags = [geotag for geotag in geotags if geotag.number in number]
    content = FORMATS[form](geotags)  # text is in UTF-8, whatever the terminal's is
    if to_file is None:
        typer.echo(content, nl=False)
    else:
        write_whole(to_file, content)
