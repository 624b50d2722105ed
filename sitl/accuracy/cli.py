"""`sidestep accuracy`: the methods beside each other on simulated flights, as a table, as CSV and as a picture."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from sitl.accuracy import stone_soup
from sitl.accuracy.figure import write_figure
from sitl.accuracy.programme import METHODS, Figures, accuracy, solutions, write_csv
from sitl.accuracy.rows import PATTERNS, ROWS, PatternName
from sitl.accuracy.suite import SUITE_RUNS, suite, summary
from sitl.accuracy.tables import accuracy_table, ellipse_table, suite_table, summary_line

_NAMES: dict[str, PatternName] = {name: name for name in PATTERNS}
_ROW_FLIGHTS = 200
_SUITE_FLIGHTS = 1000
_PICTURES = (".png", ".svg", ".pdf")


def register(app: typer.Typer) -> None:
    """Add the command to the application."""

    @app.command("accuracy")
    def run(
        pattern: Annotated[str, typer.Option(help="One of: " + ", ".join(_NAMES) + ".")] = "out-and-back",
        flights: Annotated[
            int | None,
            typer.Option(
                min=1,
                help=f"Flights a row ({_ROW_FLIGHTS}), or for each run of --suite ({_SUITE_FLIGHTS}).",
                show_default=False,
            ),
        ] = None,
        seed: Annotated[int, typer.Option(min=0, help="Seed of all randomness.")] = 1,
        method: Annotated[
            list[str] | None,
            typer.Option(help="Only this method (may be given again): " + ", ".join(METHODS) + ".", show_default=False),
        ] = None,
        least_squares_flights: Annotated[
            int, typer.Option(min=0, help="Of a row's flights, how many SciPy's slow solver gets.")
        ] = 20,
        output: Annotated[Path | None, typer.Option(help="Write the figures to this CSV file.")] = None,
        figure: Annotated[Path | None, typer.Option(help="Draw the figures into this picture (PNG, SVG, PDF).")] = None,
        whole_suite: Annotated[
            bool, typer.Option("--suite", help="Measure instead what the default method is held to.")
        ] = False,
    ) -> None:
        """Measure every method's depth error on simulated sightings, beside the paper's figures and the bound.

        Exit status 0; with --suite 3 when a figure missed what it is held to.
        """
        console = Console(highlight=False)
        if pattern not in _NAMES:
            raise typer.BadParameter(f"{pattern!r} is none of {', '.join(_NAMES)}", param_hint="--pattern")
        methods = _checked(method or [])
        if whole_suite:
            if output is not None or figure is not None:
                raise typer.BadParameter("--output and --figure belong to the rows, not to --suite")
            _run_suite(console, flights or _SUITE_FLIGHTS, seed)
            return
        _check_writable(output, "--output", ())
        _check_writable(figure, "--figure", _PICTURES)
        if not stone_soup.installed():
            console.print(stone_soup.NOT_INSTALLED + ".")
        each = flights or _ROW_FLIGHTS
        figures = _fly_rows(_NAMES[pattern], each, seed, methods, least_squares_flights)
        title = f"{pattern}, noise of the detector"
        console.print(accuracy_table(figures, title, "median"))
        console.print(accuracy_table(figures, title, "95th percentile"))
        console.print(ellipse_table(figures, title))
        if output is not None:
            write_csv(output, figures)
        if figure is not None:
            write_figure(figure, figures, f"{pattern} pattern, {each} simulated flights a row")
        if "batch" in methods or not methods:
            console.print(summary_line(summary(5 * each, seed)), soft_wrap=True)


def _checked(methods: list[str]) -> list[str]:
    for name in methods:
        if name not in METHODS:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(METHODS)}", param_hint="--method")
        if name in ("EKF", "UKF") and not stone_soup.installed():
            raise typer.BadParameter(stone_soup.NOT_INSTALLED, param_hint="--method")
    return [name for name in METHODS if name in methods]


def _check_writable(path: Path | None, option: str, endings: tuple[str, ...]) -> None:
    """Refuse now what would fail after the flights, a quarter of an hour later."""
    if path is None:
        return
    if not path.parent.is_dir() or path.is_dir():
        raise typer.BadParameter(f"{path} cannot be written: its folder must exist", param_hint=option)
    if endings and path.suffix.lower() not in endings:
        raise typer.BadParameter(f"{path} must end in {', '.join(endings)}", param_hint=option)


def _fly_rows(
    pattern: PatternName, flights: int, seed: int, methods: list[str], least_squares_flights: int
) -> list[Figures]:
    figures: list[Figures] = []
    with _progress(solutions(methods, len(ROWS), flights, least_squares_flights)) as (progress, tell):
        for found in accuracy(
            pattern, flights, seed, methods=methods, least_squares_flights=least_squares_flights, tell=tell
        ):
            figures.append(found)
            progress.update(progress.task_ids[0], description=f"{found.row.motion}, {found.row.depth_m:g} m")
    return figures


def _run_suite(console: Console, flights: int, seed: int) -> None:
    with _progress(SUITE_RUNS * flights) as (_, tell):
        held = list(suite(flights, seed, tell))
    console.print(suite_table(held, f"batch, {flights} flights for each run, the sightings format's default noise"))
    if not all(one.reached for one in held):
        raise typer.Exit(3)


class _Tell:
    """Counts one solution more."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress

    def __call__(self) -> None:
        self.progress.advance(self.progress.task_ids[0])


@contextmanager
def _progress(total: int) -> Iterator[tuple[Progress, _Tell]]:
    """A bar on standard error, so that the tables can be redirected; gone when done."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        progress.add_task("flying", total=total)
        yield progress, _Tell(progress)
