"""Lateral patterns: the paper's one-way flight, out and back (the default) and S, as bounded paths.

Why out and back: one-way flight cannot tell walking from parallax; being at the same place at two times can.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mission.records import Vector
from mission.settings import PatternSettings
from mission.vehicle.drone import Knot, Path

PAPER_INTERVAL_S = 0.5
"""Time between the paper's images (Section III-D)."""
PAPER_BASELINE_M = (0.0, 0.0, 0.4750, 0.5175, 0.7575, 0.9125, 1.005, 1.0875, 1.2675, 1.4650, 1.8925)
"""Travel since the previous image, images 0 to 10 (Table II)."""

KNOT_INTERVAL_S = 0.1
LARGEST_SHARE = 0.9
"""Length of the pattern over the target's distance: 42 degrees to the side."""


def left_of(heading_rad: float) -> Vector:
    """Unit vector to the left of a heading (clockwise from north), ENU, shape (3,)."""
    return np.array([-np.cos(heading_rad), np.sin(heading_rad), 0.0])


def fitted(settings: PatternSettings, range_m: float) -> PatternSettings:
    """The pattern, shortened where the aircraft could not turn fast enough to keep so near a target in view.

    A near target needs less: what counts is the angle under which it is seen to move. The distance is only presumed, so
    this decides how far is flown, and nothing else.

    Args:
        settings: the pattern wanted. The paper's own is never changed.
        range_m: about how far away the target is.
    """
    if settings.kind == "paper":
        return settings
    return settings.model_copy(update={"length_m": max(1.0, min(settings.length_m, LARGEST_SHARE * range_m))})


def lateral_path(settings: PatternSettings, heading_rad: float) -> Path:
    """The pattern of the settings, sideways to a heading (clockwise from north)."""
    sideways = left_of(heading_rad) * (1.0 if settings.side == "left" else -1.0)
    if settings.kind == "paper":
        return paper_path(sideways, settings.baseline_m or PAPER_BASELINE_M)
    turns = (1.0, 0.0) if settings.kind == "out-and-back" else (1.0, -1.0, 0.0)
    stops = [0.0] + [turn * settings.length_m for _ in range(settings.passes) for turn in turns]
    durations = [settings.leg_duration_s * max(1.0, abs(b - a) / settings.length_m) ** 0.5 for a, b in pairwise(stops)]
    return legs(sideways, stops, durations)


def legs(direction_enu: Vector, stops_m: list[float], durations_s: list[float]) -> Path:
    """Minimum-jerk legs along a line, at rest at each stop.

    Args:
        direction_enu: unit vector, shape (3,).
        stops_m: distances from the start along the direction, first 0.
        durations_s: time for each leg, one fewer than the stops.
    """
    knots = [Knot(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
    start_s = 0.0
    for (a, b), duration in zip(pairwise(stops_m), durations_s, strict=True):
        count = max(4, round(duration / KNOT_INTERVAL_S))
        for k in range(1, count + 1):
            s = k / count
            along = a + (b - a) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
            speed = (b - a) / duration * 30.0 * s * s * (1.0 - s) ** 2
            knots.append(_knot(start_s + s * duration, along, speed, direction_enu))
        start_s += duration
    return Path(tuple(knots))


def paper_path(direction_enu: Vector, baseline_m: tuple[float, ...] = PAPER_BASELINE_M) -> Path:
    """The paper's one-way pattern: 11 images at 0.5 s with the travel of Table II, then a stop within 1.5 s.

    Args:
        direction_enu: unit vector, shape (3,).
        baseline_m: travel since the previous image at each image, the first 0 (`sidestep calibrate baseline`).
    """
    travel = np.cumsum((0.0, *baseline_m[1:]))
    times = PAPER_INTERVAL_S * np.arange(len(travel))
    speed = np.gradient(travel, PAPER_INTERVAL_S)
    speed[:2] = 0.0
    knots = [_knot(float(t), float(x), float(v), direction_enu) for t, x, v in zip(times, travel, speed, strict=True)]
    stop_s = 1.5
    knots.append(_knot(float(times[-1]) + stop_s, float(travel[-1] + speed[-1] * stop_s / 2.0), 0.0, direction_enu))
    return Path(tuple(knots))


def _knot(t_s: float, along_m: float, speed_m_s: float, direction_enu: Vector) -> Knot:
    east, north, up = (direction_enu * along_m).tolist()
    v_east, v_north, v_up = (direction_enu * speed_m_s).tolist()
    return Knot(t_s, (east, north, up), (v_east, v_north, v_up))
