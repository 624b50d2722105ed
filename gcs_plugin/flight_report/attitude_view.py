"""The steady view: the attitude that the aircraft reported, against the one that the picture's background shows."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mission.bundle import AttitudeCurves, BundleSolution
from mission.records import Vector

INK: Final = "#26323d"
ANGLES: Final[tuple[tuple[int, str, str], ...]] = (
    (0, "heading", "#d1495b"),
    (1, "pitch", "#1f6fb4"),
    (2, "roll", "#2a9d4f"),
)
"""Column of the curves, name, colour."""
POINTS: Final = "#8fa3b5"
NOTE_WIDTH: Final = 125
"""Characters in a line."""
LEAST_SPAN_DEG: Final = 0.5
"""Smallest range of the angles' axes: below this they would show nothing but noise, blown up."""


def steady_view(steadied: BundleSolution, id: str, *, size_px: tuple[int, int] = (1500, 1050)) -> bytes:
    """Draw how far the reported attitude is off the steadied one over a sidestep, and what that rests on.

    Where the attitude was not steadied the picture says why.

    Args:
        steadied: the sidestep's poses by the background.
        id: the flight's name.
        size_px: width and height.

    Returns:
        A PNG.
    """
    figure = Figure(figsize=(size_px[0] / 150.0, size_px[1] / 150.0), dpi=150, facecolor="white")
    FigureCanvasAgg(figure)  # without pyplot, whose figures are global
    figure.text(0.075, 0.955, f"Sidestep {_shortened(id, 60)}", fontsize=13, color=INK, weight="bold")
    note = textwrap.fill(steadied.note(), NOTE_WIDTH, max_lines=2, placeholder=" \N{HORIZONTAL ELLIPSIS}")
    figure.text(0.075, 0.938, note, fontsize=9.5, color=INK, va="top", linespacing=1.4)
    curves = steadied.curves
    if curves is None or len(curves.t_s) < 2:
        figure.text(0.5, 0.5, "no visual rotation in this flight", ha="center", fontsize=13, color=POINTS)
    else:
        _draw(figure, curves)
    png = io.BytesIO()
    figure.savefig(png, format="png")
    return png.getvalue()


def residuals_deg(curves: AttitudeCurves) -> Vector:
    """(k, 3): reported less steadied heading, elevation and roll, degrees, each relative to its mean.

    The pictures tell how the camera turns, not where north is, so only the changes mean something.
    """
    away = curves.reported_rad - curves.steadied_rad
    away = np.arctan2(np.sin(away), np.cos(away))
    away = np.unwrap(away, axis=0)
    return np.asarray(np.degrees(away - away.mean(axis=0)))


def _draw(figure: Figure, curves: AttitudeCurves) -> None:
    t_s = curves.t_s - curves.t_s[0]
    away = residuals_deg(curves)
    grid = figure.add_gridspec(3, 1, left=0.075, right=0.79, bottom=0.075, top=0.845, height_ratios=(3, 3, 1.3))
    top, middle, bottom = (figure.add_subplot(grid[k]) for k in range(3))
    _curves(top, t_s, [np.degrees(c - c.mean()) for c in curves.steadied_rad.T], width=1.2)
    _curves(top, t_s, [np.degrees(c - c.mean()) for c in curves.reported_rad.T], width=1.4, dashed=True, named=False)
    top.plot([], [], color=INK, linewidth=1.2, label="by the background")
    top.plot([], [], color=INK, linewidth=1.4, linestyle=(0, (4, 2)), label="ATTITUDE")
    _curves(middle, t_s, list(away.T), width=1.8, spread=True)
    span = max(float(np.abs(away).max()) * 1.15, LEAST_SPAN_DEG)
    middle.set_ylim(-span, span)
    bottom.fill_between(t_s, curves.points, step="mid", color=POINTS, alpha=0.55, linewidth=0)
    bottom.set_ylim(0.0, max(10.0, 1.15 * float(curves.points.max())))
    for axes, title in (
        (top, "the camera's turns about their mean (deg)"),
        (middle, "ATTITUDE less the background's (deg)"),
        (bottom, "points that stand still"),
    ):
        axes.set_title(title, loc="left", fontsize=10, color=INK, pad=5)
        axes.set_xlim(0.0, float(t_s[-1]))
        axes.grid(color="#dde4ea", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.set_facecolor("#f7f9fb")
        axes.tick_params(colors=INK, labelsize=9, length=3)
        for spine in axes.spines.values():
            spine.set_color("#b8c4ce")
    for axes in (top, middle):
        axes.tick_params(labelbottom=False)
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), fontsize=9, frameon=False, labelcolor=INK)
    bottom.set_xlabel("time since the first frame of the sidestep (s)", fontsize=9.5, color=INK)


def _curves(
    axes: Axes,
    t_s: Vector,
    values: Sequence[Vector],
    *,
    width: float,
    dashed: bool = False,
    named: bool = True,
    spread: bool = False,
) -> None:
    for column, name, colour in ANGLES:
        label = f"{name}, {values[column].std():.2f}\N{DEGREE SIGN} rms" if spread else name
        axes.plot(
            t_s,
            values[column],
            color=colour,
            linewidth=width,
            linestyle=(0, (4, 2)) if dashed else "-",
            label=label if named else None,
        )


def _shortened(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 1] + "\N{HORIZONTAL ELLIPSIS}"
