"""`sidestep estimate`: estimate where the target of each flight is, from sightings files."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, TextIO

import typer

from mission.errors import EstimateRefused, SettingsError, SidestepError, SightingsFormatError
from mission.estimate import ESTIMATORS, Estimator
from mission.estimate.passes import Passes
from mission.estimate.sightings_file import FlightProblem, error_line, estimate_line, read_flights
from mission.records import FlightSightings

ANSWERED, UNREADABLE, SOME_MISSING = 0, 2, 3
"""Exit statuses."""


def register(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("estimate")(estimate)


def estimate(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Sightings files (JSON Lines).")],
    method: Annotated[str, typer.Option(help="One of: " + ", ".join(ESTIMATORS) + ".")] = "batch",
    output: Annotated[Path | None, typer.Option(help="Write the answers to this file.")] = None,
) -> None:
    """Estimate where the target of each flight is, from sightings files.

    One JSON line per flight, in order. Exit status 0 when every flight was answered, 3 when some were not, 2 for
    arguments or files that cannot be read.
    """
    estimator = ESTIMATORS.get(method)
    if estimator is None:
        raise typer.BadParameter(f"{method!r} is none of {', '.join(ESTIMATORS)}", param_hint="--method")
    if output is not None and any(output.exists() and file.exists() and output.samefile(file) for file in files):
        raise typer.BadParameter(f"{output} is also an input", param_hint="--output")
    with ExitStack() as stack:
        stream = sys.stdout if output is None else stack.enter_context(_opened(output))
        status = ANSWERED
        for file in files:
            # Flights that continue each other are estimated as they were flown: each stands on the one before.
            used = Passes() if method == "batch" else estimator
            status = max(status, _answer_file(file, used, stream), key=(ANSWERED, SOME_MISSING, UNREADABLE).index)
    raise typer.Exit(status)


def _opened(path: Path) -> TextIO:
    try:
        return path.open("w", encoding="utf-8", newline="\n")
    except OSError as error:
        raise SettingsError(f"{path} cannot be written: {error.strerror}", "Choose another --output.") from None


def _answer_file(path: Path, estimator: Estimator, stream: TextIO) -> int:
    status = ANSWERED
    try:
        for flight in read_flights(path):
            line, answered = _answer(flight, estimator)
            if not answered:
                status = SOME_MISSING
            _write(line, stream)
    except SightingsFormatError as error:
        typer.echo(f"sidestep: {error}", err=True)
        return UNREADABLE
    return status


def _write(line: str, stream: TextIO) -> None:
    """One line, at once, so that a reader at the other end of a pipe sees it."""
    try:
        stream.write(line + "\n")
        stream.flush()
    except BrokenPipeError:
        raise  # nobody reads any more: the command line ends quietly
    except OSError as error:
        raise SettingsError(f"The answers cannot be written: {error.strerror}", "Make room for them.") from None


def _answer(flight: FlightSightings | FlightProblem, estimator: Estimator) -> tuple[str, bool]:
    if isinstance(flight, FlightProblem):
        return error_line(flight.id, flight.message), False
    try:
        return estimate_line(estimator.estimate(flight), flight.origin), True
    except EstimateRefused as error:
        return error_line(flight.id, str(error)), False
    except (SidestepError, ValueError) as error:
        return error_line(flight.id, f"the answer has no place on the earth ({error})"), False
