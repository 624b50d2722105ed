"""The AR.Drone's rows as tables, beside the paper's figures."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from pathlib import Path

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from sitl.evaluation.ardrone.rows import FlownArdroneRow, Found, chosen_rows, fly_ardrone_row

MEDIAN_PERCENT, WORST_PERCENT = 5.0, 12.0
"""What the default pattern with the batch estimate is held to."""


def run_ardrone(console: Console, names: Sequence[str], report: Path, noise: str) -> None:
    """`sidestep accuracy --drone ardrone`: fly the rows, print a line for each as it is flown, then the tables.

    Args:
        console: where to print.
        names: rows as ``MOTION:METRES``; all twelve when empty.
        report: folder of the flights.
        noise: of the aircraft's sensors, good or rough.

    Raises:
        typer.BadParameter: a row or the noise is not known.
        typer.Exit: with 3 when the figures are not what they are held to.
    """
    if noise not in ("good", "rough"):
        raise typer.BadParameter(f"{noise!r} is neither good nor rough", param_hint="--noise")
    try:
        rows = chosen_rows(names)
    except KeyError as error:
        known = ", ".join(f"{row.motion}:{row.depth_m:g}" for row in chosen_rows(()))
        raise typer.BadParameter(f"{error.args[0]!r} is none of {known}", param_hint="--row") from error
    flown = []
    for row in rows:
        flown.append(fly_ardrone_row(row, report, noise=noise))
        console.print(f"{row.motion} {row.depth_m:g} m: three-image {_pair(flown[-1].three_image)}, ", end="")
        console.print(f"batch {_pair(flown[-1].batch)}")
    console.print(ardrone_table(flown))
    for line in ardrone_summary(flown):
        console.print(line, soft_wrap=True)
    if not reached(flown):
        raise typer.Exit(3)


def ardrone_table(flown: Sequence[FlownArdroneRow]) -> Table:
    """A line for each row: the paper's errors, the three-image formula's, and the batch estimate's, in percent.

    The last column is the batch's depth error with the true poses instead of the reckoned ones.
    """
    table = Table(title="AR.Drone 2.0, simulated, no GPS: depth and position errors, %", box=SIMPLE_HEAD)
    table.add_column("motion")
    columns = ("m", "paper", "three-image\npaper's pattern", "batch\ndefault pattern", "ellipse", "drift m", "no drift")
    for name in columns:
        table.add_column(name, justify="right")
    for one in flown:
        row, batch = one.row, one.batch
        table.add_row(
            row.motion,
            f"{row.depth_m:g}",
            f"{row.paper_depth_percent:.1f}, {row.paper_position_percent:.1f}",
            _pair(one.three_image),
            _pair(batch),
            "" if isinstance(batch, str) or batch.inside_95 is None else "inside" if batch.inside_95 else "OUTSIDE",
            "" if isinstance(batch, str) or batch.drift_m is None else f"{batch.drift_m:.2f}",
            "" if isinstance(batch, str) or batch.undrifted_percent is None else f"{batch.undrifted_percent:.1f}",
        )
    return table


def ardrone_summary(flown: Sequence[FlownArdroneRow]) -> list[str]:
    """Medians and worst errors in lines, and why rows are without a figure."""
    paper = [one.row.paper_depth_percent for one in flown]
    lines = [f"paper: median {statistics.median(paper):.1f} %, worst {max(paper):.1f} %"] if paper else []
    methods: tuple[tuple[str, Callable[[FlownArdroneRow], Found | str]], ...] = (
        ("three-image, paper's pattern", lambda one: one.three_image),
        ("batch, default pattern", lambda one: one.batch),
    )
    for name, of in methods:
        results = [of(one) for one in flown]
        errors = [found.depth_percent for found in results if isinstance(found, Found)]
        told = f"median {statistics.median(errors):.1f} %, worst {max(errors):.1f} %; " if errors else ""
        lines.append(f"{name}: {told}answered {len(errors)} of {len(results)}")
        lines += [
            f"  {one.row.motion} {one.row.depth_m:g} m: {result}"
            for one, result in zip(flown, results, strict=True)
            if isinstance(result, str)
        ]
    undrifted = [one.batch.undrifted_percent for one in flown if isinstance(one.batch, Found)]
    known = [error for error in undrifted if error is not None]
    if known:
        lines.append(f"batch with the true poses: median {statistics.median(known):.1f} %, worst {max(known):.1f} %")
    return lines


def reached(flown: Sequence[FlownArdroneRow]) -> bool:
    """Whether all rows were answered and the batch estimate's depth errors are what they are held to."""
    errors = [one.batch.depth_percent for one in flown if isinstance(one.batch, Found)]
    return (
        len(errors) == len(flown)
        and bool(errors)
        and statistics.median(errors) <= MEDIAN_PERCENT
        and max(errors) <= WORST_PERCENT
    )


def _pair(found: Found | str) -> str:
    return "-" if isinstance(found, str) else f"{found.depth_percent:.1f}, {found.position_percent:.1f}"
