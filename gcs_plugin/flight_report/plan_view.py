"""The plan view: what was flown, where the target was seen from there, and where it must be. North is up."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Sequence
from typing import Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon
from scipy.spatial.transform import Rotation

from mission.camera.model import CameraModel
from mission.geodesy import ce90_m, enu_to_geodetic, error_ellipse, le90_m
from mission.records import Estimate, FlightSightings, Matrix, Vector

Form = Literal["png", "pdf", "svg"]
RAYS: Final = 24
"""Rays drawn at most."""
MIN_SPAN_M: Final = 6.0
LEGEND_TOP: Final = 0.27
"""Height of the legend in the side panel."""
DRONE, TARGET, TRUTH, RAY, INK = "#1f6fb4", "#d1495b", "#2a9d4f", "#8fa3b5", "#26323d"
_DATUM_SAID: Final = {"ellipsoid": "above the ellipsoid", "amsl": "above mean sea level", "home": "above home"}


def plan_view(
    flight: FlightSightings,
    estimate: Estimate,
    *,
    drone_track: Matrix | None = None,
    truth_track: Matrix | None = None,
    geodetic: bool = True,
    sited: bool = True,
    size_px: tuple[int, int] = (1500, 1050),
    form: Form = "png",
) -> bytes:
    """Draw an answer.

    Args:
        flight: the sightings that it was made from.
        estimate: the answer.
        drone_track: rows of time, east, north, up; the positions of the sightings without it.
        truth_track: where the target really was, likewise; its last row belongs to the last sighting.
        geodetic: whether the flight's origin is a real place, so that coordinates mean something.
        sited: whether the covariance holds the aircraft's own position error too; said of CE90 where it does not.
        size_px: width and height, at 150 pixels an inch.
        form: what to make.

    Returns:
        The file's content.

    Raises:
        ValueError: the flight has no sightings.
    """
    if not flight.sightings:
        raise ValueError("a plan view needs sightings")
    figure = Figure(figsize=(size_px[0] / 150.0, size_px[1] / 150.0), dpi=150, facecolor="white")
    FigureCanvasAgg(figure)  # without pyplot, whose figures are global
    height = 0.80
    width = height * size_px[1] / size_px[0]
    axes = figure.add_axes((0.075, 0.11, width, height))
    side = figure.add_axes((0.075 + width + 0.035, 0.11, 0.865 - width, height))
    side.set_axis_off()

    seen_from = np.array([sighting.position_enu_m for sighting in flight.sightings])
    path = seen_from if drone_track is None or not len(drone_track) else drone_track[:, 1:4]
    rays = _rays(flight, estimate)
    for start, end in rays:
        axes.plot(*np.array([start, end]).T, color=RAY, linewidth=0.8, alpha=0.75, zorder=1)
    _draw_path(axes, path)
    inside = [path[:, :2], *_draw_estimate(axes, estimate)]
    if truth_track is not None and len(truth_track):
        _draw_truth(axes, truth_track)
        inside.append(truth_track[:, 1:3])
    _frame(axes, np.vstack(inside))
    _scale_bar(axes)
    _north_arrow(axes)
    side.set_xlim(0.0, 1.0)
    side.set_ylim(0.0, 1.0)
    _panel(side, _numbers(flight, estimate, truth_track, geodetic, sited), estimate, truth_track)
    figure.text(0.075, 0.945, _shortened(f"Sidestep {flight.id}", 60), fontsize=13, color=INK, weight="bold")
    content = io.BytesIO()
    figure.savefig(content, format=form)
    return content.getvalue()


def _rays(flight: FlightSightings, estimate: Estimate) -> list[tuple[Vector, Vector]]:
    """Start and end (east, north) of the lines of sight, a little longer than to the target."""
    chosen = np.unique(np.linspace(0, len(flight.sightings) - 1, RAYS).round().astype(int))
    model = CameraModel(flight.camera)
    rays = []
    for sighting in (flight.sightings[i] for i in chosen):
        turn = Rotation.from_quat(np.array(sighting.world_from_camera_wxyz), scalar_first=True)
        direction = turn.apply(model.ray(np.array(sighting.pixel)))[:2]
        start = np.array(sighting.position_enu_m[:2])
        target = _position_at(estimate, sighting.t_s)[:2]
        length = float(np.hypot(*direction))
        if length > 1e-6:  # straight down has no bearing
            rays.append((start, start + 1.06 * np.hypot(*(target - start)) * direction / length))
    return rays


def _moves(estimate: Estimate) -> bool:
    """Whether there is a motion that can be seen in the picture."""
    return estimate.velocity_enu_m_s is not None and bool(np.hypot(*estimate.velocity_enu_m_s[:2]) >= 0.05)


def _position_at(estimate: Estimate, t_s: float) -> Vector:
    if estimate.velocity_enu_m_s is None:
        return estimate.position_enu_m
    position: Vector = estimate.position_enu_m + (t_s - estimate.t_s) * estimate.velocity_enu_m_s
    return position


def _draw_path(axes: Axes, path: Matrix) -> None:
    axes.plot(path[:, 0], path[:, 1], color=DRONE, linewidth=2.2, zorder=4, solid_capstyle="round")
    # A ring that the end does not hide: out and back ends where it began.
    axes.plot(
        *path[0, :2], marker="o", markersize=13, color="white", markeredgecolor=DRONE, markeredgewidth=2, zorder=3
    )
    axes.plot(*path[-1, :2], marker="o", markersize=7, color=DRONE, zorder=5)


def _draw_estimate(axes: Axes, estimate: Estimate) -> list[Matrix]:
    """Draws it and says what must lie inside the picture."""
    inside = [estimate.position_enu_m[np.newaxis, :2]]
    if estimate.first is not None:
        inside += _draw_ellipse(axes, estimate.first.position_enu_m, estimate.first.covariance, filled=False)
        axes.plot(
            *estimate.first.position_enu_m[:2],
            marker="D",
            markersize=7,
            color="white",
            markeredgecolor=TARGET,
            markeredgewidth=1.8,
            zorder=6,
        )
    if estimate.covariance is not None:
        inside += _draw_ellipse(axes, estimate.position_enu_m, estimate.covariance, filled=True)
    if estimate.velocity_enu_m_s is not None and _moves(estimate):
        tip = estimate.position_enu_m[:2] + 2.0 * estimate.velocity_enu_m_s[:2]
        axes.add_patch(
            FancyArrowPatch(
                (float(estimate.position_enu_m[0]), float(estimate.position_enu_m[1])),
                (float(tip[0]), float(tip[1])),
                arrowstyle="-|>",
                mutation_scale=16,
                shrinkA=0,
                shrinkB=0,
                color=TARGET,
                linewidth=2.0,
                zorder=7,
            )
        )
        inside.append(tip[np.newaxis, :])
    axes.plot(*estimate.position_enu_m[:2], marker="D", markersize=8, color=TARGET, markeredgecolor="white", zorder=8)
    return inside


def _draw_ellipse(axes: Axes, centre: Vector, covariance: Matrix, *, filled: bool) -> list[Matrix]:
    outline = centre[:2] + error_ellipse(covariance[:2, :2]).outline()
    face = (*_rgb(TARGET), 0.18) if filled else "none"
    style = "-" if filled else (0, (4, 2))
    axes.add_patch(
        Polygon(outline, closed=True, facecolor=face, edgecolor=TARGET, linewidth=1.4, linestyle=style, zorder=3)
    )
    return [outline]


def _draw_truth(axes: Axes, truth_track: Matrix) -> None:
    axes.plot(truth_track[:, 1], truth_track[:, 2], color=TRUTH, linewidth=1.8, linestyle=(0, (4, 3)), zorder=5)
    axes.plot(*truth_track[-1, 1:3], marker="x", markersize=9, markeredgewidth=2.4, color=TRUTH, zorder=9)


def _frame(axes: Axes, inside: Matrix) -> None:
    """A square window around all of it, with some room."""
    low, high = inside.min(axis=0), inside.max(axis=0)
    half = max(0.58 * float((high - low).max()), MIN_SPAN_M / 2.0)
    middle = (low + high) / 2.0
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.set_facecolor("#f7f9fb")
    axes.grid(color="#dde4ea", linewidth=0.8, zorder=0)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, labelsize=9, length=3)
    axes.set_xlabel("east of the origin (m)", loc="left", fontsize=9.5, color=INK)
    axes.set_ylabel("north of the origin (m)", loc="bottom", fontsize=9.5, color=INK)
    for spine in axes.spines.values():
        spine.set_color("#b8c4ce")


def _scale_bar(axes: Axes) -> None:
    """A bar of a round length in the lower right corner of the map."""
    left, right = axes.get_xlim()
    span = right - left
    length = max(step for step in (1, 2, 5, 10, 20, 50, 100, 200, 500) if step <= max(1.0, 0.3 * span))
    where = axes.get_xaxis_transform()  # x in metres, y in fractions of the axes
    end = right - 0.03 * span
    axes.plot([end - length, end], [0.03, 0.03], color=INK, linewidth=3, transform=where, zorder=10)
    middle = end - length / 2.0
    axes.text(middle, 0.04, f"{length} m", ha="center", va="bottom", fontsize=9, color=INK, transform=where, zorder=10)


def _north_arrow(axes: Axes) -> None:
    """In the upper left corner of the map."""
    axes.annotate(
        "",
        xy=(0.05, 0.97),
        xytext=(0.05, 0.89),
        xycoords="axes fraction",
        textcoords="axes fraction",
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 2, "mutation_scale": 18},
        zorder=10,
    )
    axes.text(0.05, 0.885, "N", ha="center", va="top", fontsize=12, weight="bold", color=INK, transform=axes.transAxes)


def _panel(
    side: Axes, numbers: list[tuple[str, Sequence[str]]], estimate: Estimate, truth_track: Matrix | None
) -> None:
    """The numbers, and what the lines mean."""
    y = 1.0
    for name, value in numbers:
        side.text(0.0, y, name, fontsize=8.5, color="#64727f", va="top")
        for line in value:
            y -= 0.034
            side.text(0.0, y, line, fontsize=11, color=INK, va="top")
        y -= 0.048
    for line in _notes(estimate, room=math.floor((y - LEGEND_TOP) / 0.030)):
        side.text(0.0, y, line, fontsize=8.5, color=INK, va="top")
        y -= 0.030
    handles: list[Line2D | Patch] = [
        Line2D(
            [], [], color=DRONE, linewidth=2.2, marker="o", label="drone, from \N{WHITE CIRCLE} to \N{BLACK CIRCLE}"
        ),
        Line2D([], [], color=RAY, linewidth=1.2, label="bearings"),
        Line2D([], [], color=TARGET, marker="D", linestyle="none", label="target at the last sighting"),
    ]
    if estimate.covariance is not None:
        handles.append(Patch(facecolor=(*_rgb(TARGET), 0.18), edgecolor=TARGET, label="95 % ellipse"))
    if estimate.first is not None:
        hollow = Line2D([], [], color=TARGET, marker="D", linestyle="none", label="target at the first sighting")
        hollow.set_markerfacecolor("white")
        hollow.set_markeredgewidth(1.8)
        handles.insert(3, hollow)
    if _moves(estimate):
        handles.append(Line2D([], [], color=TARGET, linewidth=2.0, label="its way in 2 s"))
    if truth_track is not None and len(truth_track):
        handles.append(Line2D([], [], color=TRUTH, linestyle=(0, (4, 3)), marker="x", label="truth"))
    side.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(-0.02, -0.02), fontsize=9.5, frameon=False, labelcolor=INK
    )


def _numbers(
    flight: FlightSightings, estimate: Estimate, truth_track: Matrix | None, geodetic: bool, sited: bool
) -> list[tuple[str, Sequence[str]]]:
    numbers: list[tuple[str, Sequence[str]]] = []
    if geodetic:
        place = enu_to_geodetic(estimate.position_enu_m, flight.origin)
        where = (f"{place.lat_deg:.7f}, {place.lon_deg:.7f}", f"{place.alt_m:.1f} m {_DATUM_SAID[place.datum]}")
        numbers.append(("target at the last sighting", where))
    numbers.append(("depth at the first sighting", (f"{estimate.depth_m:.2f} m",)))
    if estimate.covariance is not None:
        circle, height = ce90_m(estimate.covariance[:2, :2]), le90_m(float(estimate.covariance[2, 2]))
        numbers.append((f"CE90 / LE90{'' if sited else ' beside the drone'}", (f"{circle:.2f} m / {height:.2f} m",)))
    if estimate.velocity_enu_m_s is not None:
        east, north = estimate.velocity_enu_m_s[:2]
        course = f" towards {math.degrees(math.atan2(east, north)) % 360.0:03.0f}\N{DEGREE SIGN}"
        numbers.append(("motion", (f"{math.hypot(east, north):.2f} m/s{course if _moves(estimate) else ''}",)))
    used = f"{estimate.sightings - estimate.rejected} of {estimate.sightings} sightings"
    numbers.append(("method", (f"{estimate.method}, {estimate.model}", used)))
    if truth_track is not None and len(truth_track):
        error = float(np.hypot(*(estimate.position_enu_m[:2] - truth_track[-1, 1:3])))
        numbers.append(("horizontal error at the last sighting", (f"{error:.2f} m",)))
    return numbers


def _notes(estimate: Estimate, room: int) -> list[str]:
    """What the operator should know, in as many lines as there is room for."""
    lines = [line for note in estimate.notes for line in textwrap.wrap(note, 52, initial_indent="\N{BULLET} ")]
    if len(lines) > max(room, 0):
        lines = [*lines[: max(room - 1, 0)], "\N{HORIZONTAL ELLIPSIS} (the rest is in answer.json)"]
    return lines


def _rgb(colour: str) -> tuple[float, float, float]:
    return int(colour[1:3], 16) / 255.0, int(colour[3:5], 16) / 255.0, int(colour[5:7], 16) / 255.0


def _shortened(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 1] + "\N{HORIZONTAL ELLIPSIS}"
