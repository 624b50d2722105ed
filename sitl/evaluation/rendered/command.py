"""`sidestep accuracy --rendered N`: fly, show the progress, and print the figures."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import cv2
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from mission.errors import AnswerError
from sitl.autopilot.estimate_errors import NOISE_NAMES, NoiseName
from sitl.evaluation.rendered.campaign import TABLE, Campaign
from sitl.evaluation.rendered.case import SceneName, drawn_cases
from sitl.evaluation.rendered.report import LOOKS, summarise, table, write_figure
from sitl.evaluation.rendered.result_row import ResultRow
from sitl.scenario.scene import ScenarioWalk

FIGURE = "flights.png"


def run_rendered(
    console: Console, flights: int, seed: int, noise: str, scene: str, folder: Path, walks: str | None = None
) -> list[ResultRow]:
    """Fly, or go on with, a number of rendered flights.

    Args:
        console: gets the table.
        flights: how many in all.
        seed: of the draw.
        noise: the autopilot's preset.
        scene: what there is to see.
        walks: how the people walk; straight at constant speed when None.
        folder: of the table, the sightings and the picture; a broken run goes on where it was.

    Raises:
        BadParameter: there is no such preset or scene.
        AnswerError: the folder cannot be used, or holds another run.
        VideoError: there is no software renderer or no H.264.
    """
    cases = list(drawn_cases(flights, seed, _preset(noise), _scene(scene), walks=_walks(walks)))
    # Small pictures are not worth a second core, and its time would be counted twice.
    cv2.setNumThreads(1)
    campaign = Campaign(folder)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("rendering flights", total=flights)
        progress.update(task, completed=len({o.number for o in campaign.outcomes if o.number < flights}))
        for outcomes in campaign.run(cases):
            progress.update(task, advance=1, description=_news(outcomes))
    flown = [o for o in campaign.outcomes if o.number < flights]
    summaries = [s for poses in LOOKS if (s := summarise(flown, poses)) is not None]
    title = f"{flights} rendered flights, {noise} autopilot, {scene}, walks {walks or 'straight'}, seed {seed}"
    console.print(table(summaries, title))
    for outcome in flown:
        if not outcome.answered:
            console.print(f"flight {outcome.number} ({outcome.poses} poses) has no answer: {outcome.said}")
    if summaries:
        try:
            write_figure(folder / FIGURE, flown, title)
        except OSError as error:
            raise AnswerError(f"cannot write the figure: {error.strerror}", "Name another folder.") from error
    console.print(f"every flight's figures: {folder / TABLE}", soft_wrap=True)
    return flown


def _preset(name: str) -> NoiseName:
    for known in NOISE_NAMES:
        if name == known:
            return known
    raise typer.BadParameter(f"{name!r} is none of {', '.join(NOISE_NAMES)}", param_hint="--noise")


def _walks(name: str | None) -> ScenarioWalk | None:
    kinds: tuple[ScenarioWalk, ...] = get_args(ScenarioWalk)
    for known in kinds:
        if name == known:
            return known
    if name is None or name == "straight":
        return None
    raise typer.BadParameter(f"{name!r} is none of straight, {', '.join(kinds)}", param_hint="--walks")


def _scene(name: str) -> SceneName:
    scenes: tuple[SceneName, ...] = get_args(SceneName)
    for known in scenes:
        if name == known:
            return known
    raise typer.BadParameter(f"{name!r} is none of {', '.join(scenes)}", param_hint="--scene")


def _news(outcomes: list[ResultRow]) -> str:
    last = outcomes[-1]
    return f"{100.0 * abs(last.depth_error):.1f} % at {last.distance_m:.1f} m" if last.answered else "no answer"
