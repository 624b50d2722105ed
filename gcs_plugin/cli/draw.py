"""`sidestep draw`: draw the plan view of a flight again, from its sightings."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated, get_args

import numpy as np
import typer

from gcs_plugin.durable import write_whole
from gcs_plugin.flight_report.plan_view import Form, plan_view
from mission.errors import SettingsError, SightingsFormatError
from mission.estimate import ESTIMATORS
from mission.estimate.sightings_file import FlightProblem, read_flights
from mission.records import Matrix


def register(app: typer.Typer) -> None:
    """Add the command to the application."""

    @app.command()
    def draw(
        folder: Annotated[Path, typer.Argument(help="Folder of a flight, with its sightings.jsonl.")],
        truth: Annotated[
            Path | None, typer.Option(help="CSV of where the target really was: t_s, east_m, north_m, up_m.")
        ] = None,
        output: Annotated[
            Path | None, typer.Option(help="The picture, .png, .pdf or .svg; plan.png in the folder without it.")
        ] = None,
    ) -> None:
        """Draw the plan view of a flight again, from its sightings."""
        path = output or folder / "plan.png"
        form = form_of(path)
        flight = next(read_flights(folder / "sightings.jsonl"), None)
        if flight is None or isinstance(flight, FlightProblem):
            why = "it is empty" if flight is None else flight.message
            raise SightingsFormatError(f"no flight in {folder / 'sightings.jsonl'}: {why}")
        estimate = ESTIMATORS["batch"].estimate(flight)
        track = None if truth is None else read_track(truth)
        write_whole(path, plan_view(flight, estimate, truth_track=track, sited=False, form=form))
        typer.echo(f"drawn: {path}")


def form_of(path: Path) -> Form:
    """The form of picture that a file's name asks for.

    Raises:
        SettingsError: it asks for another one.
    """
    suffix = path.suffix.lower().removeprefix(".")
    for form in get_args(Form):
        if suffix == form:
            return form  # type: ignore[no-any-return]  # one of the literals
    raise SettingsError(f"no plan view can be drawn as {path.name}", f"Name it .{', .'.join(get_args(Form))}.")


def read_track(path: Path) -> Matrix:
    """Rows of time, east, north, up (m), shape (n, 4), from a CSV with that header.

    Raises:
        SettingsError: the file cannot be read or holds something else than numbers.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [[float(row[name]) for name in ("t_s", "east_m", "north_m", "up_m")] for row in csv.DictReader(file)]
    except (OSError, UnicodeDecodeError, KeyError, TypeError, ValueError) as error:
        raise SettingsError(
            f"cannot read the truth {path}: {error}", "Give a CSV with the columns t_s, east_m, north_m, up_m."
        ) from error
    return np.array(rows, dtype=np.float64).reshape(-1, 4)
