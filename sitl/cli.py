"""`sidestep sitl`: fly scenarios in the simulator and print each answer beside the truth."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from mission.errors import SettingsError
from sitl.scenario.schema import Scenario, check_scenario, read_scenario
from sitl.simulation.run import Result, fly
from sitl.simulation.score import ELLIPSE_95, Score


def register(app: typer.Typer) -> None:
    """Add the command to the application."""

    @app.command()
    def sitl(
        scenarios: Annotated[list[Path], typer.Argument(help="Scenario files (TOML).", metavar="SCENARIO...")],
        report: Annotated[Path, typer.Option(help="Folder for the flights, answers and pictures.")] = Path("reports"),
        noise: Annotated[str | None, typer.Option(help="good, rough or wide, instead of the scenarios' own.")] = None,
        seed: Annotated[int | None, typer.Option(help="Seed, instead of the scenarios' own.")] = None,
        autopilot: Annotated[
            str | None,
            typer.Option(help="px4:PATH or ardupilot:PATH: your own SITL binary flies.", metavar="KIND:PATH"),
        ] = None,
        settings: Annotated[Path | None, typer.Option(help="TOML appended to the mission's settings.")] = None,
        quiet: Annotated[bool, typer.Option("--quiet", help="Only the table at the end.")] = False,
    ) -> None:
        """Fly scenarios in the simulator and print each answer beside the truth.

        Exit status 0 when every flight gave an answer, 3 when some did not.
        """
        console = Console(highlight=False)
        extra = _appended(settings)
        planned = [_changed(read_scenario(path), noise, seed) for path in scenarios]
        results = []
        for number, scenario in enumerate(planned, start=1):
            console.print(f"[bold]{scenario.name}[/bold] ({number} of {len(planned)})")
            folder = report if len(planned) == 1 else report / scenario.name
            results.append(
                fly(scenario, folder, extra_settings=extra, external=autopilot, tell=None if quiet else console.print)
            )
            _print_result(console, results[-1], folder)
        if len(results) > 1:
            _print_table(console, results)
        if any(result.score is None for result in results):
            raise typer.Exit(3)


def _changed(scenario: Scenario, noise: str | None, seed: int | None) -> Scenario:
    """The scenario with the options given in place of its own.

    Raises:
        SettingsError: an option is no value of a scenario.
    """
    content = scenario.model_dump()
    if noise is not None:
        content["autopilot"]["noise"] = noise
    if seed is not None:
        content["seed"] = seed
    return check_scenario(content, "--noise, --seed")


def _appended(path: Path | None) -> str:
    """The settings to append.

    Raises:
        SettingsError: they cannot be read.
    """
    if path is None:
        return ""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f"cannot read the settings {path}: {error}", "Name an existing TOML file.") from error


def _print_result(console: Console, result: Result, folder: Path) -> None:
    if result.score is None or result.answer is None:
        console.print(f"[red]no answer:[/red] {result.error}")
        return
    found = result.score
    table = Table(title=f"{result.scenario}, seed {result.seed}, noise {result.noise}")
    for column in ("", "estimate", "truth", "error"):
        table.add_column(column, justify="left" if not column else "right")
    for row in _rows(found, result.answer):
        table.add_row(*row)
    console.print(table)
    console.print(f"pictures and logs: {folder / result.flight_folder}")


def _rows(found: Score, answer: dict[str, object]) -> list[tuple[str, str, str, str]]:
    position, velocity = _numbers(answer["position_enu_m"]), _numbers(answer["velocity_enu_m_s"])
    depth = f"{found.depth_m:.2f} m", f"{found.depth_truth_m:.2f} m", f"{found.depth_error_pct:.1f} %"
    place = _pair(position, "m"), _pair(found.truth_enu_m, "m"), f"{found.position_error_m:.2f} m"
    motion = (
        _pair(velocity, "m/s"),
        _pair(found.truth_velocity_enu_m_s, "m/s"),
        f"{found.velocity_error_m_s:.2f} m/s",
    )
    rows = [
        ("depth at the first sighting", *depth),
        ("position east, north (last)", *place),
        ("velocity east, north", *motion),
        ("beside the drone: 95 % ellipse", _semi_axis(found), "", "inside" if found.inside_95 else "OUTSIDE"),
    ]
    if found.earth_error_m is not None and found.ce90_m is not None:
        told = "inside" if found.earth_error_m <= found.ce90_m else "OUTSIDE"
        rows.append(("on the earth: CE90", f"{found.ce90_m:.2f} m", "", f"{found.earth_error_m:.2f} m, {told}"))
    return rows


def _semi_axis(found: Score) -> str:
    return f"{math.sqrt(ELLIPSE_95) * found.sigma_m:.2f} m"


def _print_table(console: Console, results: Sequence[Result]) -> None:
    table = Table(title="all flights")
    for column in ("scenario", "noise", "depth m", "error %", "position m", "velocity m/s", "sigma m", "ellipse"):
        table.add_column(column, justify="left" if column in ("scenario", "noise", "ellipse") else "right")
    for result in results:
        found = result.score
        if found is None:
            table.add_row(result.scenario, result.noise, "", "", "", "", "", f"[red]{result.error}[/red]")
            continue
        table.add_row(
            result.scenario,
            result.noise,
            f"{found.depth_truth_m:.2f}",
            f"{found.depth_error_pct:.1f}",
            f"{found.position_error_m:.2f}",
            f"{found.velocity_error_m_s:.2f}",
            f"{found.sigma_m:.2f}",
            "inside" if found.inside_95 else "[red]outside[/red]",
        )
    console.print(table)
    scores = [result.score for result in results if result.score is not None]
    if scores:
        errors = [found.depth_error_pct for found in scores]
        inside = sum(found.inside_95 for found in scores)
        console.print(
            f"depth error: median {statistics.median(errors):.1f} %, worst {max(errors):.1f} %; "
            f"95 % ellipse right in {inside} of {len(scores)}; answered {len(scores)} of {len(results)}"
        )
    without = [result.as_reported.depth_error_pct for result in results if result.as_reported is not None]
    if without:
        console.print(
            f"with the poses as the autopilot reported them: median {statistics.median(without):.1f} %, "
            f"worst {max(without):.1f} % of {len(without)}"
        )


def _pair(values: Sequence[float], unit: str) -> str:
    return f"{values[0]:+.2f}, {values[1]:+.2f} {unit}"


def _numbers(value: object) -> list[float]:
    return [float(part) for part in value] if isinstance(value, list) else []
