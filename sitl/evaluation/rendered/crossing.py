"""Somebody in the target's own clothes who walks through between drone and target, or close behind the target."""

from __future__ import annotations

import math

import numpy as np

from mission.records import Vector
from sitl.evaluation.rendered.case import WALKED_S, Case
from sitl.scenario.scene import Clothes, Person

_RAMP_S = 0.3
"""What the first step costs of that (`sitl.people.walk`: a smooth start over 0.6 s)."""
_WHEN = (0.25, 0.75)
"""When they meet, as a share of the pattern."""
_WHERE = ((0.55, 0.85), (1.08, 1.25))
"""How far away the other one then is, as a share of the target's distance: in front, and behind."""
_BEHIND_SHARE = 0.3
_WAY_DEG = (65.0, 115.0)
"""Of the other one's walk, to either side of the line of sight."""
_SPEED_M_S = (0.5, 1.4)


def walked(t_s: float, speed_m_s: float, heading_rad: float) -> Vector:
    """(2,): east and north of the way that somebody who walks has gone at a time of the pattern."""
    way_m = speed_m_s * (t_s + WALKED_S - _RAMP_S)
    return way_m * np.array([math.sin(heading_rad), math.cos(heading_rad)])


def crossing(case: Case, target: Person, bearing_deg: float, rng: np.random.Generator) -> tuple[Person, Person]:
    """The target and whoever crosses the line of sight, both in the same clothes.

    Args:
        case: the flight.
        target: as it walks without the other one.
        bearing_deg: of the target when the pattern begins, from the drone's start.
        rng: of the scene.
    """
    clothes = Clothes(shirt=_colour(rng, 60, 230), trousers=_colour(rng, 30, 110))
    t_s = float(rng.uniform(*_WHEN)) * 2.0 * case.flown.leg_duration_s
    share = float(rng.uniform(*_WHERE[rng.uniform() < _BEHIND_SHARE]))
    side = 1.0 if rng.uniform() < 0.5 else -1.0
    heading = math.radians(bearing_deg + side * float(rng.uniform(*_WAY_DEG)))
    speed_m_s = float(rng.uniform(*_SPEED_M_S))
    bearing = math.radians(target.bearing_deg)
    begin = target.distance_m * np.array([math.sin(bearing), math.cos(bearing)])
    there = begin + walked(t_s, target.speed_m_s, target.heading_rad)
    drone = _drone(case, math.radians(bearing_deg), t_s)
    place = drone + share * (there - drone) - walked(t_s, speed_m_s, heading)
    passer = Person(
        distance_m=float(np.hypot(*place)),
        bearing_deg=math.degrees(math.atan2(place[0], place[1])),
        speed_m_s=speed_m_s,
        walk_heading_deg=(math.degrees(heading) + 180.0) % 360.0 - 180.0,
        height_m=float(rng.uniform(1.55, 1.9)),
        clothes=clothes,
    )
    return target.model_copy(update={"clothes": clothes}), passer


def _drone(case: Case, bearing_rad: float, t_s: float) -> Vector:
    """(2,): where the pattern has the drone, east and north: out to the left and back."""
    left_m = 0.5 * case.flown.length_m * (1.0 - math.cos(math.pi * t_s / case.flown.leg_duration_s))
    return -left_m * np.array([math.cos(bearing_rad), -math.sin(bearing_rad)])


def _colour(rng: np.random.Generator, low: int, high: int) -> str:
    return "#" + "".join(f"{int(value):02x}" for value in rng.integers(low, high, 3))
