"""A geotag in words, for the remarks and balloons of map programs."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.grid import grid_reference

_COMPASS: Final = ("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW")
MOVES_SIGMAS: Final = 2.0
"""A speed below this many of its own sigmas may as well be none."""


def name_of(geotag: Geotag) -> str:
    """What the target is called on a map."""
    return f"Target {geotag.number}" if geotag.number else f"Target {geotag.id}"


def moves(geotag: Geotag) -> bool:
    """Whether the data tell that the target moves: its speed stands out of its own uncertainty."""
    speed = geotag.speed_m_s
    if not speed or geotag.velocity_enu_m_s is None:
        return False
    along = np.array(geotag.velocity_enu_m_s[:2]) / speed
    covariance = np.array(geotag.covariance, dtype=np.float64)[3:5, 3:5]
    return speed >= MOVES_SIGMAS * math.sqrt(max(float(along @ covariance @ along), 0.0))


def motion_in_words(geotag: Geotag) -> str:
    """Speed and course, or that it stands."""
    if geotag.speed_m_s is None or geotag.course_rad is None or not moves(geotag):
        return "motion not estimated" if geotag.velocity_enu_m_s is None else "not seen to move"
    degrees = math.degrees(geotag.course_rad)
    return f"{geotag.speed_m_s:.1f} m/s {_COMPASS[round(degrees / 22.5) % 16]} ({degrees:.0f}°)"


def accuracy_in_words(geotag: Geotag) -> str:
    """How sure the place is."""
    ellipse = geotag.ellipse
    return (
        f"CE90 {geotag.ce90_m:.1f} m, LE90 {geotag.le90_m:.1f} m, 95 % ellipse {ellipse.semi_major_m:.1f} x "
        f"{ellipse.semi_minor_m:.1f} m, major axis {math.degrees(ellipse.azimuth_rad):.0f}°"
    )


def place_in_words(geotag: Geotag) -> str:
    """Decimal degrees and grid reference."""
    lat_deg, lon_deg = geotag.place.lat_deg, geotag.place.lon_deg
    return f"{lat_deg:.7f}, {lon_deg:.7f} ({grid_reference(lat_deg, lon_deg)})"


def description(geotag: Geotag) -> str:
    """Everything that somebody at a map should know, in sentences."""
    lines = [place_in_words(geotag), accuracy_in_words(geotag), motion_in_words(geotag), *geotag.notes]
    return ". ".join(line.rstrip(".") for line in lines) + "."
