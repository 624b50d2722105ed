"""`sidestep accuracy`: the methods beside each other on simulated flights, as a table and as CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from mission.estimate import ESTIMATORS
from sitl.accuracy.programme import ROWS, Figures, PatternName, accuracy, write_csv

_PATTERNS: dict[str, PatternName] = {"out-and-back": "out-and-back", "S": "S", "paper": "paper"}


def register(app: typer.Typer) -> None:
    """Add the command to the application."""

    @app.command("accuracy")
    def run(
        pattern: Annotated[str, typer.Option(help="One of: " + ", ".join(_PATTERNS) + ".")] = "out-and-back",
        flights: Annotated[int, typer.Option(min=1, help="Flights a row.")] = 200,
        seed: Annotated[int, typer.Option(help="Seed of all randomness.")] = 1,
        output: Annotated[Path | None, typer.Option(help="Write the figures to this CSV file.")] = None,
    ) -> None:
        """Measure every method's depth error on simulated sightings, beside the paper's figures and the bound."""
        if pattern not in _PATTERNS:
            raise typer.BadParameter(f"{pattern!r} is none of {', '.join(_PATTERNS)}", param_hint="--pattern")
        figures = list(accuracy(_PATTERNS[pattern], flights, seed))
        Console().print(accuracy_table(figures, f"{pattern}, {flights} flights a row: median depth error in %"))
        if output is not None:
            write_csv(output, figures)


def accuracy_table(figures: list[Figures], title: str) -> Table:
    """One line for each row of the programme, one column for each method."""
    methods = (*ESTIMATORS, "bound")
    table = Table(title=title)
    for name in ("motion", "depth m", "paper", *methods, "95 % ellipse right %"):
        table.add_column(name, justify="left" if name == "motion" else "right")
    found = {(f.row, f.method): f for f in figures}
    for row in ROWS:
        cells = [found[row, method] for method in methods if (row, method) in found]
        if not cells:
            continue
        batch = found.get((row, "batch"))
        inside = "" if batch is None or batch.inside_percent is None else f"{batch.inside_percent:.0f}"
        published = "" if row.published_percent is None else f"{row.published_percent:.1f}"
        table.add_row(
            row.motion,
            f"{row.depth_m:g}",
            published,
            *("-" if cell.answered == 0 else f"{cell.median_percent:.1f}" for cell in cells),
            inside,
        )
    return table
