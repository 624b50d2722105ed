"""The programme's figures as tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from rich.box import SIMPLE_HEAD
from rich.table import Table

from sitl.evaluation.accuracy.programme import Figures
from sitl.evaluation.accuracy.suite import Held, Pooled

_MOST = 0.9
"""Share of the flights that a figure without a mark is made of."""


def accuracy_table(figures: Sequence[Figures], title: str, statistic: Literal["median", "95th percentile"]) -> Table:
    """One line for each row of the programme, one column for each method: depth errors in %.

    A star marks figures over fewer than nine in ten of the flights: the method gave no answer for the others.
    """
    methods = list(dict.fromkeys(f.method for f in figures))
    title = f"{title}: {statistic} of the depth error, %"
    table = Table(title=title, caption=_caption(figures), box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("motion", no_wrap=True)
    for name in ("m", "paper", *methods):
        table.add_column(_broken(name), justify="right", no_wrap=True)
    found = {(f.row, f.method): f for f in figures}
    for row in dict.fromkeys(f.row for f in figures):
        published = "" if row.published_percent is None else f"{row.published_percent:.1f}"
        cells = [_cell(found[row, method], statistic) for method in methods]
        table.add_row(row.motion, f"{row.depth_m:g}", published, *cells)
    return table


def ellipse_table(figures: Sequence[Figures], title: str) -> Table:
    """How often each method's 95 % ellipse of the last position held the truth, over all rows."""
    table = Table(title=f"{title}: 95 % ellipse of the last position holds the truth", box=SIMPLE_HEAD)
    table.add_column("method")
    table.add_column("%", justify="right")
    table.add_column("of flights", justify="right")
    for method in dict.fromkeys(f.method for f in figures):
        found = [(f.inside_percent, f.answered) for f in figures if f.method == method]
        told = [(share, count) for share, count in found if share is not None]
        if told:
            total = sum(count for _, count in told)
            table.add_row(method, f"{sum(share * count for share, count in told) / total:.1f}", str(total))
    return table


def summary_line(pooled: Pooled) -> str:
    """The pooled figures of `batch` in one line."""
    return (
        f"batch, out-and-back and S, 7 walks, 2.75 to 25 m, {pooled.flights} flights: "
        f"median {pooled.median_percent:.2f} %, 95th percentile {pooled.p95_percent:.2f} %, "
        f"rms {pooled.over_bound:.3f} x the bound, 95 % ellipse right in {pooled.inside_percent:.1f} %, "
        f"mean normalised squared error {pooled.nees:.2f} (2 dof), {pooled.refused} refused"
    )


def suite_table(held: Sequence[Held], title: str) -> Table:
    """What is held to, measured and wanted."""
    table = Table(title=title, box=SIMPLE_HEAD)
    for name in ("figure", "measured", "wanted", ""):
        table.add_column(name)
    for one in held:
        table.add_row(one.what, one.measured, one.wanted, "reached" if one.reached else "MISSED")
    return table


def _broken(name: str) -> str:
    """A method's name in two lines, so that the whole table fits a terminal."""
    for mark in ("-", "_", " "):
        name = name.replace(mark, mark.rstrip() + "\n")
    return name


def _cell(figures: Figures, statistic: Literal["median", "95th percentile"]) -> str:
    if figures.answered == 0:
        return "-"
    value = figures.median_percent if statistic == "median" else figures.p95_percent
    text = f"{value:.1f}" if value < 999.5 else ">999"
    return text if figures.answered >= _MOST * figures.flights else text + "*"


def _caption(figures: Sequence[Figures]) -> str:
    most = max(f.flights for f in figures)
    fewer = {f.method: f.flights for f in figures if f.flights < most}
    slow = "".join(f" {name}: {count} flights a row." for name, count in fewer.items())
    return f"{most} flights a row.{slow} * answered fewer than 9 in 10. -: no answer."
