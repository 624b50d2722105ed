"""The programme's figures as a picture: for each row every method's median, and the bound."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sitl.evaluation.accuracy.programme import BOUND, Figures

_AXIS_PERCENT = (0.3, 300.0)
# Colour-blind safe (Okabe & Ito) and told apart by shape as well.
_LOOKS = {
    "classical": ("#999999", "v"),
    "stereo": ("#999999", "^"),
    "three-image": ("#999999", "<"),
    "four-image": ("#999999", ">"),
    "ground ray": ("#a05a2c", "D"),
    "EKF": ("#56b4e9", "s"),
    "UKF": ("#e69f00", "P"),
    "bearing-angle": ("#009e73", "X"),
    "least_squares": ("#cc79a7", "*"),
    "constant-velocity": ("#f0e442", "h"),
    "batch": ("#0072b2", "o"),
}


def write_figure(path: Path, figures: Sequence[Figures], title: str) -> None:
    """Write the picture; its format is that of the path's ending.

    Raises:
        OSError: the file cannot be written.
        ValueError: nothing to draw, or an ending that matplotlib does not know.
    """
    if not figures:
        raise ValueError("no figures to draw")
    rows = list(dict.fromkeys(f.row for f in figures))
    places = {row: len(rows) - 1 - number for number, row in enumerate(rows)}
    figure = Figure(figsize=(11.0, 1.9 + 0.36 * len(rows)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    low, high = _AXIS_PERCENT
    legend: dict[str, Line2D] = {}
    for f in figures:
        if f.answered == 0:
            continue
        y = places[f.row]
        middle = min(max(f.median_percent, low * 1.05), high / 1.05)
        if f.method == BOUND:
            (line,) = axes.plot([middle, middle], [y - 0.42, y + 0.42], color="black", linewidth=2.0, zorder=3.5)
        else:
            colour, marker = _LOOKS[f.method]
            ours = f.method == "batch"
            if ours:
                axes.plot([middle, min(f.p95_percent, high)], [y, y], color=colour, linewidth=1.6, zorder=3)
            (line,) = axes.plot(
                middle, y, marker, color=colour, markersize=9 if ours else 7, zorder=5 if ours else 4, alpha=0.95
            )
        legend.setdefault(f.method, line)
    for row, y in places.items():
        if row.published_percent is not None:
            (line,) = axes.plot(
                row.published_percent, y, "x", color="#d55e00", markersize=9, markeredgewidth=2.4, zorder=6
            )
            legend["published (Kim & Yow 2015)"] = line
        if y % 2:
            axes.axhspan(y - 0.5, y + 0.5, color="0.95", zorder=0)
    axes.set_yticks(list(places.values()), [f"{row.motion}, {row.depth_m:g} m" for row in places])
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    ticks = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.grid(axis="x", color="0.85", zorder=0)
    axes.set_xlabel("median depth error at the first sighting, % (line to the right of batch: its 95th percentile)")
    axes.set_title(title)
    names = {BOUND: "what the Cramer-Rao bound allows"}
    figure.legend(
        list(legend.values()),
        [names.get(name, name) for name in legend],
        loc="outside lower center",
        ncols=6,
        frameon=False,
    )
    figure.savefig(path, dpi=130)
