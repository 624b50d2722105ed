"""`python -m sitl.field`: fly field flights and print their figures."""

from __future__ import annotations

from typing import Annotated, cast, get_args

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from mission.records import Vector
from sitl.autopilot.estimate_errors import NOISE_NAMES
from sitl.autopilot.gimbal_settings import Tells
from sitl.field.case import drawn_field_cases
from sitl.field.outcome import FieldOutcome, fly_case

CENTRED = 0.95
"""Share of a flight's frames with the person in the middle quarter of the picture."""


def main(
    flights: Annotated[int, typer.Option(min=1, help="How many.")] = 8,
    seed: Annotated[int, typer.Option(help="Of the draw.")] = 1,
    first: Annotated[int, typer.Option(min=0, help="Number of the first one.")] = 0,
    noise: Annotated[str, typer.Option(help="good, rough or wide: how well the autopilot knows its pose.")] = "good",
    tells: Annotated[str | None, typer.Option(help="nose, north, nose-delta or older; any of the first three.")] = None,
) -> None:
    """Field flights: 10 to 60 m up, people 20 to 120 m away, the camera on a gimbal whose yaw is degrees off."""
    if noise not in NOISE_NAMES:
        raise typer.BadParameter(f"{noise!r} is none of {', '.join(NOISE_NAMES)}")
    if tells is not None and tells not in get_args(Tells):
        raise typer.BadParameter(f"{tells!r} is none of {', '.join(get_args(Tells))}")
    cases = drawn_field_cases(flights, seed, noise, first=first, tells=cast("Tells | None", tells))
    console, flown = Console(), []
    for case in cases:
        flown.append(fly_case(case))
        console.print(line(flown[-1]), soft_wrap=True)
    console.print(figures(flown))


def line(one: FieldOutcome) -> str:
    """One flight in one line."""
    what = f"{one.height_m:.0f} m up, {one.slant_m:.0f} m away, {one.walks}, {one.tells}, {one.height_px:.0f} px"
    if not one.answered:
        return f"{what}: no answer ({one.said})"
    north = f"north off by {one.bias_deg:+.1f} deg, found to {one.north_error_deg:+.2f} (+-{one.north_sigma_deg:.2f})"
    return (
        f"{what}: slant {100.0 * one.slant_error:+.1f} % (single ray {100.0 * one.single_ray_error:+.1f}), "
        f"{'inside' if one.inside else 'OUTSIDE'} (nees {one.nees:.1f}), place {one.place_error_m:.2f} m, {north}, "
        f"centred {100.0 * one.centred_share:.0f} %, {one.seconds:.0f} s"
    )


def figures(flown: list[FieldOutcome]) -> Table:
    """What the flights show together."""
    answered = [one for one in flown if one.answered]
    table = Table(title=f"{len(flown)} field flights, {len(answered)} answered")
    table.add_column("figure")
    table.add_column("value", justify="right")
    if not answered:
        return table
    slant = 100.0 * np.abs([one.slant_error for one in answered])
    ray = 100.0 * np.abs([one.single_ray_error for one in answered])
    north: Vector = np.array([one.north_error_deg for one in answered if one.steadied])
    rows = [
        ("slant error, median / p95", f"{np.median(slant):.1f} / {np.percentile(slant, 95):.1f} %"),
        ("single ray on flat ground, median / p95", f"{np.median(ray):.1f} / {np.percentile(ray, 95):.1f} %"),
        ("95 % ellipse right", f"{sum(one.inside for one in answered)} of {len(answered)}"),
        ("north found to, rms", f"{np.sqrt(np.mean(north**2)):.2f} deg ({len(north)})" if len(north) else "-"),
        (
            "target in the middle quarter, 95 % of frames",
            f"{sum(one.centred_share >= CENTRED for one in flown)} of {len(flown)}",
        ),
    ]
    for row in rows:
        table.add_row(*row)
    return table


if __name__ == "__main__":
    typer.run(main)
