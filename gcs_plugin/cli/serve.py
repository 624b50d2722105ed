"""`sidestep serve`: wait for orders from QGroundControl, MAVProxy or Mission Planner, and carry them out."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from gcs_plugin.abort import Abort
from gcs_plugin.answer import Times
from gcs_plugin.cli.address import HELP, given_address
from gcs_plugin.component.parameter_table import table_lines
from gcs_plugin.serve.fleet import Fleet, VehicleOptions, vehicles
from gcs_plugin.serve.vehicle import VehicleService
from gcs_plugin.terminal import lasting_console


def register(app: typer.Typer) -> None:
    """Add the command to the application."""

    @app.command()
    def serve(
        settings: Annotated[list[Path] | None, typer.Option(help="Settings, TOML.")] = None,
        link: Annotated[list[str] | None, typer.Option(help="The aircraft, e.g. udpin://0.0.0.0:14540.")] = None,
        system: Annotated[list[int] | None, typer.Option(min=1, max=255, help="Its system id.")] = None,
        video: Annotated[list[str] | None, typer.Option(help=HELP)] = None,
        camera: Annotated[list[Path] | None, typer.Option(help="Camera file of `sidestep calibrate`.")] = None,
        folder: Annotated[Path | None, typer.Option(help="Where flights and geotags are kept.")] = None,
        parameters: Annotated[bool, typer.Option("--parameters", help="Print the MAVLink parameters and end.")] = False,
    ) -> None:
        """Wait for orders from QGroundControl, MAVProxy or Mission Planner, and carry them out.

        For several vehicles repeat --settings, --link, --system, --video or --camera, in the same order.
        Ctrl-C at any moment: the aircraft holds its place and the log is whole.
        """
        if parameters:
            typer.echo("\n".join(table_lines()))
            return
        videos = [given_address(each) for each in video or ()]
        found = vehicles(settings or [], link or [], system or [], videos, camera or [], folder)
        abort = Abort()
        abort.install()
        console = lasting_console()
        try:
            if len(found) == 1:
                _serve(found[0], abort, console)
            else:
                Fleet(found, lambda line: console.print(line, markup=False)).run(abort.asked)
        except KeyboardInterrupt:
            return


def _serve(options: VehicleOptions, abort: Abort, console: Console) -> None:
    times = Times(time.monotonic, lambda: datetime.now(UTC))
    VehicleService(options.read(), abort, console, times).run()
