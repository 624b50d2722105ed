"""`sidestep accuracy --suite --walks ...`: check what was asked for, fly it, print the figures."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, get_args

import typer
from rich.console import Console

from mission.records import ClassHeight
from sitl.evaluation.people.flights import POOR, Geometry, HeightPrior, PeopleSetting, checked_walks
from sitl.evaluation.people.verdicts import judged, people_table, refusals, write_verdicts

FLIGHTS = 200
GEOMETRIES: tuple[str, ...] = (*get_args(Geometry), "poor")
_ONLY_PEOPLE = (
    "geometry",
    "noise_scale",
    "heading_bias_deg",
    "height_prior",
    "class_height",
    "person_height_m",
    "processes",
)
_NOT_PEOPLE = ("pattern", "row", "least_squares_flights", "figure", "closed_loop", "repeats", "report", "scene")


def refuse_unused(context: typer.Context, *, people: bool) -> None:
    """Refuse options that were given and would change nothing.

    Args:
        context: of the command.
        people: whether `--suite --walks` is flown.

    Raises:
        BadParameter: the first such option.
    """
    for name in _NOT_PEOPLE if people else _ONLY_PEOPLE:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            option = "--" + name.replace("_", "-")
            remedy = "leave it out with --suite --walks" if people else "it belongs to --suite --walks"
            raise typer.BadParameter(f"nothing would change: {remedy}", param_hint=option)


def people_setting(
    walks: str,
    *,
    geometry: str = "default",
    noise: str = "good",
    noise_scale: float = 1.0,
    heading_bias_deg: float = 0.0,
    height_prior: str = "none",
    class_height: str = "use",
    person_height_m: float | None = None,
) -> PeopleSetting:
    """The setting of a campaign by the options' words.

    Raises:
        BadParameter: a word is none of its option's.
    """
    try:
        known = checked_walks(walks)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--walks") from error
    path = _word(geometry, GEOMETRIES, "--geometry")
    kinds: tuple[Geometry, ...] = POOR if path == "poor" else tuple(g for g in get_args(Geometry) if g == path)
    prior: HeightPrior = _word(height_prior, get_args(HeightPrior), "--height-prior")
    usual: ClassHeight = _word(class_height, get_args(ClassHeight), "--class-height")
    _word(noise, ("good", "wide"), "--noise")
    if noise == "wide" and noise_scale != 1.0:
        raise typer.BadParameter("--noise wide draws the scale itself", param_hint="--noise-scale")
    return PeopleSetting(
        known,
        geometry=kinds,
        wide=noise == "wide",
        noise_scale=noise_scale,
        heading_bias_rad=math.radians(heading_bias_deg),
        height_prior=prior,
        class_height=usual,
        height_m=person_height_m,
    )


def run_people(
    console: Console,
    setting: PeopleSetting,
    flights: int,
    seed: int,
    processes: int,
    output: Path | None,
    method: str,
    progress: Callable[[int], AbstractContextManager[tuple[object, Callable[[], None]]]],
) -> None:
    """Fly the campaign and print its figures and the reasons of refusals.

    Args:
        console: gets the table.
        setting: what is flown.
        flights: how many.
        seed: of all randomness.
        processes: how many at once; 0 is one a core.
        output: gets a line for each flight.
        method: the estimator.
        progress: a bar for so many flights.
    """
    with progress(flights) as (_, tell):
        verdicts = list(judged(setting, flights, seed, processes=processes, method=method, tell=tell))
    said = [method, f"walks {setting.walks}", "geometry " + ", ".join(setting.geometry)]
    said.append("noise wide" if setting.wide else f"noise x{setting.noise_scale:g}")
    said.append(f"heading bias {math.degrees(setting.heading_bias_rad):g} deg")
    said.append(f"height prior {setting.height_prior}, class height {setting.class_height}, seed {seed}")
    console.print(people_table(verdicts, "; ".join(said)))
    for line in refusals(verdicts):
        console.print(line, soft_wrap=True)
    if output is not None:
        write_verdicts(output, verdicts)


def _word(word: str, known: tuple[str, ...], option: str) -> Any:
    if word not in known:
        raise typer.BadParameter(f"{word!r} is none of {', '.join(known)}", param_hint=option)
    return word
