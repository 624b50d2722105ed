"""`python -m sitl.evaluation.archive`: make the benchmark's flights, or score answers to them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from mission.errors import SidestepError
from sitl.evaluation.archive.flights import KINDS, make_flights
from sitl.evaluation.archive.score import score, table

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, help="A benchmark of recorded flights.")


@app.command()
def make(
    out: Annotated[Path, typer.Argument(help="Folder; flights that are there already are kept.")],
    count: Annotated[int, typer.Option(min=1, help="Number of flights.")] = 60,
    seed: Annotated[int, typer.Option(help="Of the draw.")] = 1,
    log: Annotated[str, typer.Option(help="One of: " + ", ".join(KINDS) + ".")] = "tlog",
) -> None:
    """Write simulated flights past one walking person each: video, log, camera file; the truth apart."""
    kind = next((kind for kind in KINDS if kind == log), None)
    if kind is None:
        raise typer.BadParameter(f"{log!r} is none of {', '.join(KINDS)}", param_hint="--log")
    for name in make_flights(out, count, seed, kind):
        typer.echo(name)


@app.command(name="score")
def score_answers(
    out: Annotated[Path, typer.Argument(help="Folder of the flights.")],
    answers: Annotated[Path, typer.Argument(help="GeoJSON, as `sidestep archive merge --target x.geojson` writes it.")],
) -> None:
    """Compare answers with the truth."""
    typer.echo(table(score(out, answers)))


if __name__ == "__main__":
    try:
        app()
    except SidestepError as problem:
        typer.echo(f"sidestep: {problem}", err=True)
        sys.exit(2)
