"""`sidestep console`: the operator's page in a browser, and orders from ground stations beside it."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from gcs_plugin.cli.address import HELP, given_address
from gcs_plugin.cli.serve import serve_one
from gcs_plugin.console.passwords import set_password
from gcs_plugin.serve.fleet import VehicleOptions
from gcs_plugin.terminal.abort import Abort
from gcs_plugin.terminal.output import lasting_console


class Whose(Enum):
    """Roles that have a password."""

    viewer = "viewer"
    commander = "commander"


def register(app: typer.Typer) -> None:
    """Add the command to the application."""

    @app.command()
    def console(
        settings: Annotated[Path | None, typer.Option(help="Settings, TOML.")] = None,
        link: Annotated[str | None, typer.Option(help="The aircraft, e.g. udpin://0.0.0.0:14540.")] = None,
        system: Annotated[int | None, typer.Option(min=1, max=255, help="Its system id.")] = None,
        video: Annotated[str | None, typer.Option(help=HELP)] = None,
        camera: Annotated[Path | None, typer.Option(help="Camera file of `sidestep calibrate`.")] = None,
        folder: Annotated[Path | None, typer.Option(help="Where flights and geotags are kept.")] = None,
        port: Annotated[int | None, typer.Option(min=0, max=65535, help="Of the page; 0: any free one.")] = None,
        map: Annotated[Path | None, typer.Option(help="A PMTiles file to lie under the map.")] = None,
        set_password_of: Annotated[
            Whose | None, typer.Option("--set-password", help="Ask for this role's password, keep it, and end.")
        ] = None,
        password_file: Annotated[Path | None, typer.Option(help="Where passwords are kept.")] = None,
    ) -> None:
        """Serve the operator's page: live video beside a map; tap a person, and the place stands on the map."""
        if set_password_of is not None:
            path = password_file or Path("console-passwords")
            set_password(
                path, set_password_of.value, typer.prompt("Password", hide_input=True, confirmation_prompt=True)
            )
            typer.echo(f"kept in {path}: name it in the settings as console.password_file")
            return
        address = None if video is None else given_address(video)
        options = VehicleOptions(settings, link, system, address, camera, folder)
        chosen = options.read()
        changes = {"port": port, "map": map, "password_file": password_file}
        page = chosen.console.model_copy(update={name: value for name, value in changes.items() if value is not None})
        abort = Abort()
        abort.install()
        try:
            serve_one(chosen.model_copy(update={"console": page}), abort, lasting_console(), page=True)
        except KeyboardInterrupt:
            return
