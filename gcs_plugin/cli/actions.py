"""`sidestep actions`: write the MAVLink Actions file for QGroundControl: Locate, Next person and Abort as buttons."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Final

import typer

from gcs_plugin.durable import make_folder, write_whole
from mission.errors import SettingsError

FILE_NAME: Final = "sidestep-actions.json"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("actions")(actions)


def actions(
    output: Annotated[
        Path | None, typer.Option(help="Folder for the file (QGroundControl's MavlinkActions); else it is printed.")
    ] = None,
    component: Annotated[int, typer.Option(min=100, max=105, help="Component id, as [orders] component.")] = 100,
) -> None:
    """Write the MAVLink Actions file for QGroundControl: Locate, Next person and Abort as buttons."""
    text = actions_file(component)
    if output is None:
        typer.echo(text, nl=False)
        return
    try:
        make_folder(output)
    except OSError as error:
        raise SettingsError(f"{output} cannot be made: {error.strerror}", "Name another folder.") from error
    write_whole(output / FILE_NAME, text.encode("utf-8"))
    typer.echo(f"{output / FILE_NAME}: choose it in QGroundControl's settings, and start QGroundControl anew")


def actions_file(component: int) -> str:
    """QGroundControl's MAVLink Actions file (version 1) for a camera component.

    Args:
        component: its id.
    """
    content = json.loads((files("gcs_plugin") / "data" / FILE_NAME).read_text(encoding="utf-8"))
    for action in content["actions"]:
        action["compId"] = component
    return json.dumps(content, indent=4) + "\n"
