"""Where a walker's feet lead: position, heading and speed over the ground, from standstill through turns to a stop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mission.records import Vector
from sitl.people.drawn_walk import draw_walk
from sitl.scenario.scene import Person, ScenarioWalk

START_S = 0.6
"""Time from standstill to full speed, and back (about one step)."""
TURN_S = 0.8
"""Time that a change of direction takes."""

_STEP_S = 0.01
_DRAWN_S = 120.0
"""How long a drawn walk is one; who is watched for longer goes straight on."""


@dataclass(frozen=True, slots=True)
class Footing:
    """A walker at an instant."""

    east_m: float
    north_m: float
    heading_rad: float
    """Clockwise from true north."""
    speed_m_s: float
    way_m: float
    """Travelled since the walk began."""
    stature: float = 1.0
    """Height over the height standing: below 1 who crouches."""

    @property
    def velocity_enu_m_s(self) -> tuple[float, float, float]:
        """Velocity over the ground."""
        return self.speed_m_s * math.sin(self.heading_rad), self.speed_m_s * math.cos(self.heading_rad), 0.0


class Walk:
    """One person's walk, from the scenario."""

    def __init__(self, person: Person) -> None:
        bearing = math.radians(person.bearing_deg)
        self._start = (person.distance_m * math.sin(bearing), person.distance_m * math.cos(bearing))
        self.usual_speed_m_s = person.speed_m_s
        """What the length of the steps is for."""
        if person.walks is None:
            self._as_told(person)
        else:
            self._as_drawn(person, person.walks)
        self._ways = _integral(self._speeds)
        self._easts = _integral(self._speeds * np.sin(self._headings))
        self._norths = _integral(self._speeds * np.cos(self._headings))

    def _as_drawn(self, person: Person, walks: ScenarioWalk) -> None:
        """As people walk: `sitl.people.drawn_walk`, from standstill."""
        rng = np.random.default_rng((person.walk_seed, 21))
        kind = "any" if walks == "real-like" else walks
        drawn = draw_walk(rng, kind, _DRAWN_S, heading_rad=person.heading_rad)
        self._times = np.arange(0.0, _DRAWN_S, _STEP_S)
        self._speeds = np.interp(self._times, drawn.times_s, drawn.speed_m_s) * _ramp(self._times / START_S)
        self._headings = np.interp(self._times, drawn.times_s, drawn.heading_rad)
        self._statures = np.interp(self._times, drawn.times_s, drawn.stature)
        self.usual_speed_m_s = float(np.percentile(drawn.speed_m_s, 80))

    def _as_told(self, person: Person) -> None:
        """Straight at constant speed, but for the scenario's turns and stop."""
        events_s = [START_S, *(turn.after_s + TURN_S for turn in person.turns)]
        if person.stop_after_s is not None:
            events_s.append(person.stop_after_s + START_S)
        self._times = np.arange(0.0, max(events_s) + 2.0 * _STEP_S, _STEP_S)
        self._speeds = person.speed_m_s * _ramp(self._times / START_S)
        if person.stop_after_s is not None:
            self._speeds *= 1.0 - _ramp((self._times - person.stop_after_s) / START_S)
        self._headings = np.full_like(self._times, person.heading_rad)
        for turn in person.turns:
            self._headings += math.radians(turn.by_deg) * _ramp((self._times - turn.after_s) / TURN_S)
        self._statures = np.ones_like(self._times)

    def at(self, since_start_s: float | None) -> Footing:
        """The walker at a time since the walk began; None or a negative time is before it."""
        t = max(0.0, since_start_s or 0.0)
        beyond = max(0.0, t - float(self._times[-1]))
        east, north, heading, speed, way, stature = (
            float(np.interp(t, self._times, table))
            for table in (self._easts, self._norths, self._headings, self._speeds, self._ways, self._statures)
        )
        return Footing(
            east_m=self._start[0] + east + beyond * speed * math.sin(heading),
            north_m=self._start[1] + north + beyond * speed * math.cos(heading),
            heading_rad=heading,
            speed_m_s=speed,
            way_m=way + beyond * speed,
            stature=stature,
        )


def _ramp(part: Vector) -> Vector:
    """0 before, 1 after, smooth between."""
    clipped = np.clip(part, 0.0, 1.0)
    return np.asarray(clipped * clipped * (3.0 - 2.0 * clipped))


def _integral(rates: Vector) -> Vector:
    """Running integral by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum((rates[1:] + rates[:-1]) * 0.5 * _STEP_S)])
