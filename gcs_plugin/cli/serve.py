"""`sidestep serve`: wait for orders from QGroundControl, MAVProxy or Mission Planner, and carry them out."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from gcs_plugin.cli.address import HELP, given_address
from gcs_plugin.component.parameter_table import table_lines
from gcs_plugin.publish.publisher import Times
from gcs_plugin.serve.fleet import Fleet, vehicles
from gcs_plugin.serve.vehicle import VehicleService
from gcs_plugin.terminal.abort import Abort
from gcs_plugin.terminal.output import lasting_console
from mission.detect import make_detector
from mission.errors import SettingsError
from mission.settings import MissionSettings


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
        console: Annotated[bool, typer.Option("--console", help="Also the operator's page, in a browser.")] = False,
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
        terminal = lasting_console()
        try:
            if len(found) == 1:
                serve_one(found[0].read(), abort, terminal, page=console)
            elif console:
                raise SettingsError(
                    "the console shows one vehicle", "Start `sidestep console` for each, on ports of their own."
                )
            else:
                Fleet(found, lambda line: terminal.print(line, markup=False)).run(abort.asked)
        except KeyboardInterrupt:
            return


def serve_one(settings: MissionSettings, abort: Abort, terminal: Console, *, page: bool) -> None:
    """Serve one vehicle until the end of the program.

    Args:
        settings: of the mission.
        abort: tells when the program is to end.
        terminal: for the person there.
        page: whether the operator's page is served, too.

    Raises:
        SettingsError: the page's address cannot be used.
        ModuleNotFoundError: the extra [console] is not installed.
    """
    times = Times(time.monotonic, lambda: datetime.now(UTC))
    if not page:
        VehicleService(settings, abort, terminal, times).run()
        return
    from gcs_plugin.console.server import ConsoleServer

    log = settings.answer.folder / "geotags.gpkg"
    server = ConsoleServer(settings.console, log, lambda: make_detector(settings.detect.detector), times.clock)
    try:
        terminal.print(f"console: {server.url}", markup=False, highlight=False)
        VehicleService(settings, abort, terminal, times, server.desk).run()
    finally:
        server.close()
