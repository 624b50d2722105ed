"""`sidestep accuracy`: measure every method's depth error on simulated sightings, beside the bound."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from sitl.evaluation.accuracy.closed_loop import ClosedLoop, FlownRow, flight_name, fly_row
from sitl.evaluation.accuracy.figure import write_figure
from sitl.evaluation.accuracy.flown_log import FlownLog
from sitl.evaluation.accuracy.programme import METHODS, Figures, accuracy, solutions, write_csv
from sitl.evaluation.accuracy.rows import PATTERNS, ROWS, PatternName, Row
from sitl.evaluation.accuracy.suite import SUITE_RUNS, suite, summary
from sitl.evaluation.accuracy.tables import accuracy_table, ellipse_table, suite_table, summary_line
from sitl.evaluation.ardrone.table import run_ardrone
from sitl.evaluation.comparators import stone_soup
from sitl.evaluation.people.command import FLIGHTS as PEOPLE_FLIGHTS
from sitl.evaluation.people.command import GEOMETRIES, people_setting, refuse_unused, run_people

_NAMES: dict[str, PatternName] = {name: name for name in PATTERNS}
_ROW_FLIGHTS = 200
_SUITE_FLIGHTS = 1000
_FILE_WIDTH = 132
_PICTURES = (".png", ".svg", ".pdf")


def register(app: typer.Typer) -> None:
    """Add the command to the application."""

    @app.command("accuracy")
    def run(
        context: typer.Context,
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
        row: Annotated[
            list[str] | None,
            typer.Option(help="Only this row, MOTION:METRES as in parallel:9 (may be repeated).", show_default=False),
        ] = None,
        closed_loop: Annotated[
            bool, typer.Option("--closed-loop", help="Fly the rows through camera and detector, in real time.")
        ] = False,
        repeats: Annotated[int, typer.Option(min=1, help="Flights a row with --closed-loop.")] = 3,
        report: Annotated[
            Path,
            typer.Option(help="Folder of --closed-loop or --rendered, with flights.csv. Started again it goes on."),
        ] = Path("reports/accuracy"),
        noise: Annotated[
            str,
            typer.Option(help="The autopilot: good, rough or wide (drawn anew for each flight)."),
        ] = "good",
        drone: Annotated[
            str, typer.Option(help="ardrone: fly the paper's rows on the simulated AR.Drone 2.0, in real time.")
        ] = "mavlink",
        rendered: Annotated[
            int | None,
            typer.Option(
                min=1,
                help="Fly this many flights past rendered people, without real time, with and without steadying.",
                show_default=False,
            ),
        ] = None,
        scene: Annotated[
            str, typer.Option(help="Of --rendered: street, featureless, crowd, night or crossing.")
        ] = "street",
        walks: Annotated[
            str | None,
            typer.Option(
                help="With --suite (4 to 25 m away) or --rendered: people who walk like this: "
                "real-like, straight, random-walk:PSD (not rendered), "
                "turns, stops, starts, weaving, giving-way, greeting, crouching, standing, calm, wandering, fast.",
                show_default=False,
            ),
        ] = None,
        geometry: Annotated[str, typer.Option(help="With --walks: " + ", ".join(GEOMETRIES) + ".")] = "default",
        noise_scale: Annotated[
            float, typer.Option(min=0.0, max=100.0, help="With --walks: noise that is made over the header's.")
        ] = 1.0,
        heading_bias_deg: Annotated[
            float, typer.Option(min=0.0, max=90.0, help="With --walks: of every compass, to either side.")
        ] = 0.0,
        height_prior: Annotated[str, typer.Option(help="With --walks: none, right or wrong.")] = "none",
        class_height: Annotated[str, typer.Option(help="With --walks: use, compare or never.")] = "use",
        person_height_m: Annotated[
            float | None,
            typer.Option(min=0.3, max=3.0, help="With --walks: of all people; else adults.", show_default=False),
        ] = None,
        processes: Annotated[int, typer.Option(min=0, help="With --walks: at once; 0 is one a core.")] = 0,
    ) -> None:
        """Measure every method's depth error on simulated sightings, beside the paper's figures and the bound.

        Exit status 0; with --suite or --drone ardrone 3 when a figure missed what it is held to.
        """
        console = _console()
        if pattern not in _NAMES:
            raise typer.BadParameter(f"{pattern!r} is none of {', '.join(_NAMES)}", param_hint="--pattern")
        refuse_unused(context, people=whole_suite and walks is not None and rendered is None)
        if drone == "ardrone":
            run_ardrone(console, row or [], report / "ardrone", noise)
            return
        if drone != "mavlink":
            raise typer.BadParameter(f"{drone!r} is neither mavlink nor ardrone", param_hint="--drone")
        if rendered is not None:
            from sitl.evaluation.rendered.command import run_rendered  # Panda3D takes half a second to load

            run_rendered(console, rendered, seed, noise, scene, report / "rendered", walks)
            return
        methods = _checked(method or [])
        rows = _rows(row or [])
        if walks is not None:
            if not whole_suite:
                raise typer.BadParameter("--walks belongs to --suite or --rendered", param_hint="--walks")
            if len(methods) > 1:
                raise typer.BadParameter("--walks is flown for one method at a time", param_hint="--method")
            _check_writable(output, "--output", ())
            setting = people_setting(
                walks,
                geometry=geometry,
                noise=noise,
                noise_scale=noise_scale,
                heading_bias_deg=heading_bias_deg,
                height_prior=height_prior,
                class_height=class_height,
                person_height_m=person_height_m,
            )
            judge = methods[0] if methods else "batch"
            run_people(console, setting, flights or PEOPLE_FLIGHTS, seed, processes, output, judge, _progress)
            return
        if whole_suite:
            if output is not None or figure is not None:
                raise typer.BadParameter("--output and --figure belong to the rows, not to --suite")
            _run_suite(console, flights or _SUITE_FLIGHTS, seed)
            return
        _check_writable(output, "--output", ())
        _check_writable(figure, "--figure", _PICTURES)
        if not stone_soup.installed():
            console.print(stone_soup.NOT_INSTALLED + ".")
        if closed_loop:
            flown = ClosedLoop(_NAMES[pattern], _preset(noise), seed)
            found = _fly_closed_loop(console, flown, rows, repeats, report, methods)
            title = f"{pattern}, closed loop, autopilot {noise}"
            _show(console, found, title, title, output, figure)
            return
        each = flights or _ROW_FLIGHTS
        found = _fly_rows(_NAMES[pattern], each, seed, rows, methods, least_squares_flights)
        picture_title = f"{pattern} pattern, {each} simulated flights a row"
        _show(console, found, f"{pattern}, noise of the detector", picture_title, output, figure)
        if not row and ("batch" in methods or not methods):
            console.print(summary_line(summary(5 * each, seed)), soft_wrap=True)


def _console() -> Console:
    """Wide enough for the tables where they go into a file."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=max(console.width, _FILE_WIDTH))


def _checked(methods: list[str]) -> list[str]:
    for name in methods:
        if name not in METHODS:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(METHODS)}", param_hint="--method")
        if name in ("EKF", "UKF") and not stone_soup.installed():
            raise typer.BadParameter(stone_soup.NOT_INSTALLED, param_hint="--method")
    return [name for name in METHODS if name in methods]


def _rows(names: list[str]) -> tuple[Row, ...]:
    known = {f"{row.motion}:{row.depth_m:g}": row for row in ROWS}
    for name in names:
        if name not in known:
            raise typer.BadParameter(f"{name!r} is none of {', '.join(known)}", param_hint="--row")
    return tuple(row for name, row in known.items() if name in names or not names)


def _preset(noise: str) -> str:
    if noise not in ("good", "rough", "wide"):
        raise typer.BadParameter(f"{noise!r} is none of good, rough, wide", param_hint="--noise")
    return noise


def _show(
    console: Console,
    figures: list[Figures],
    title: str,
    picture_title: str,
    output: Path | None,
    picture: Path | None,
) -> None:
    """The tables, and the files that were asked for."""
    console.print(accuracy_table(figures, title, "median"))
    console.print(accuracy_table(figures, title, "95th percentile"))
    console.print(ellipse_table(figures, title))
    if output is not None:
        write_csv(output, figures)
    if picture is not None:
        write_figure(picture, figures, picture_title)


def _check_writable(path: Path | None, option: str, endings: tuple[str, ...]) -> None:
    """Refuse now what would fail after the flights, a quarter of an hour later."""
    if path is None:
        return
    if not path.parent.is_dir() or path.is_dir():
        raise typer.BadParameter(f"{path} cannot be written: its folder must exist", param_hint=option)
    if endings and path.suffix.lower() not in endings:
        raise typer.BadParameter(f"{path} must end in {', '.join(endings)}", param_hint=option)


def _fly_rows(
    pattern: PatternName,
    flights: int,
    seed: int,
    rows: Sequence[Row],
    methods: list[str],
    least_squares_flights: int,
) -> list[Figures]:
    figures: list[Figures] = []
    with _progress(solutions(methods, len(rows), flights, least_squares_flights)) as (progress, tell):
        for found in accuracy(
            pattern, flights, seed, rows=rows, methods=methods, least_squares_flights=least_squares_flights, tell=tell
        ):
            figures.append(found)
            progress.update(progress.task_ids[0], description=f"{found.row.motion}, {found.row.depth_m:g} m")
    return figures


def _fly_closed_loop(
    console: Console, setting: ClosedLoop, rows: Sequence[Row], repeats: int, report: Path, methods: list[str]
) -> list[Figures]:
    """Fly what the report's log does not hold yet, round after round over all rows, and pool what it holds then."""
    try:
        report.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise typer.BadParameter(f"{report} cannot be made: {error.strerror}", param_hint="--report") from error
    log = FlownLog(report / "flights.csv", setting)
    done = log.flown(rows)
    wanted = [(row, number) for number in range(1, repeats + 1) for row in rows if (row, number) not in done]
    if done:
        console.print(f"{len(done)} flights of {report} are taken as they are; {len(wanted)} are missing")
    with _progress(len(wanted)) as (progress, tell):
        for row, number in wanted:
            name = flight_name(row, number)
            progress.update(progress.task_ids[0], description=name)
            flown = fly_row(row, number, setting, report, methods=methods)
            log.add(flown)
            progress.console.print(f"{name}: {_brief(flown)}")
            tell()
    return list(log.figures(rows))


def _brief(flown: FlownRow) -> str:
    if flown.depth_m is None:
        return f"no answer: {flown.error}"
    errors = (f"{one.method} {one.error_percent:+.1f} %" for one in flown.outcomes if one.error_percent is not None)
    return f"{flown.depth_m:.2f} m; " + ", ".join(errors)


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
