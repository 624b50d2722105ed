"""`sidestep replay`: what a recorded flight of our own would answer, now or with other settings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("replay")(replay)


def replay(
    folder: Annotated[Path, typer.Argument(help="Of one flight that was made with record.video = true.")],
    settings: Annotated[
        Path | None, typer.Option(help="Settings, TOML, in place of the flight's own: what they would have said.")
    ] = None,
) -> None:
    """Run a recorded flight through the procedure again, without flying.

    With the flight's own settings it gives the same sightings and the same answer. Exit status 0 when somebody was
    located, 3 when not.
    """
    from gcs_plugin.replaying import replay as run
    from gcs_plugin.replaying import same_as_flown
    from mission.settings import read_settings

    used = None if settings is None else read_settings(settings)
    found = run(folder, used, lambda text: typer.echo(text, err=True))
    for line in found.answer_lines():
        typer.echo(line)
    if used is None:
        how = "are those of the flight" if same_as_flown(folder, found) else "DIFFER from the flight's"
        typer.echo(f"the sightings {how}", err=True)
    raise typer.Exit(0 if found.answers else 3)
