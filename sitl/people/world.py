"""The people of a scenario: the surface of each body at any time, and the point that an estimate is scored against.

Local ENU around the scenario's home, up from the ground. Two instants tell when walks begin: `started_s`, the truth's
mark 0 (the drone flies sideways, or the camera's start if nobody waits for the drone), and `scene_started_s`, mark 1
(the camera's start), which is only needed when some people wait and others do not.
"""

from __future__ import annotations

import math

import numpy as np

from mission.records import Vector
from sitl.people import gait
from sitl.people.body import REST_HEIGHT_M, Body, read_body
from sitl.people.walk import Footing, Walk
from sitl.scenario.scene import Person
from sitl.scenario.schema import Scenario


class Walker:
    """One person of the scenario."""

    def __init__(self, person: Person, seed: int) -> None:
        self.person = person
        self._seed = seed
        self._walk = Walk(person)
        self._scale = person.height_m / REST_HEIGHT_M
        self._stride_m = person.stride * gait.stride_m(self._walk.usual_speed_m_s, person.height_m)
        # The scenario's places are those of the body's middle, not of the mesh's root.
        self._ahead_m = float(read_body().surface_centroid(gait.pose(0.0, 0.0, 0.0, seed))[0])

    def footing(self, t_s: float, started_s: float | None, scene_started_s: float | None = None) -> Footing:
        """Where the walk has led at a time (monotonic seconds)."""
        begun_s = started_s
        if not self.person.waits_for_drone and scene_started_s is not None:
            begun_s = scene_started_s
        return self._walk.at(None if begun_s is None else t_s - begun_s)

    def surface(self, t_s: float, started_s: float | None, scene_started_s: float | None = None) -> Vector:
        """(V, 3): the vertices of the posed body, ENU metres."""
        footing = self.footing(t_s, started_s, scene_started_s)
        usual = self._walk.usual_speed_m_s
        part = min(1.0, footing.speed_m_s / usual) if usual > 0.0 else 0.0
        phase = (footing.way_m / self._stride_m) % 1.0 if self._stride_m > 0.0 else 0.0
        # A broad body's steps are stretched with it, so that its planted foot stays where it is.
        own = gait.pose(phase, part * self._stride_m / (self._scale * self.person.build), t_s, self._seed)
        own[:, 0] -= self._ahead_m
        own *= [self._scale * self.person.build, self._scale * self.person.build, self._scale * footing.stature]
        s, c = math.sin(footing.heading_rad), math.cos(footing.heading_rad)
        placed = np.empty_like(own)
        placed[:, 0] = own[:, 0] * s - own[:, 1] * c + footing.east_m
        placed[:, 1] = own[:, 0] * c + own[:, 1] * s + footing.north_m
        placed[:, 2] = own[:, 2]
        return placed


class World:
    """Everybody in a scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.body: Body = read_body()
        self.walkers = tuple(Walker(person, scenario.seed * 100 + i) for i, person in enumerate(scenario.people))

    @property
    def waits_for_drone(self) -> bool:
        """Whether anybody waits for the drone to fly sideways."""
        return any(walker.person.waits_for_drone for walker in self.walkers)

    def person_surface(
        self, i: int, t_s: float, started_s: float | None, scene_started_s: float | None = None
    ) -> Vector:
        """(V, 3): person i's posed body, ENU metres."""
        return self.walkers[i].surface(t_s, started_s, scene_started_s)

    def person_centroid(
        self, i: int, t_s: float, started_s: float | None, scene_started_s: float | None = None
    ) -> Vector:
        """Area-weighted centroid of person i's posed surface: the truth to score a position against.

        Args:
            i: which person.
            t_s: monotonic seconds.
            started_s: mark 0 of the truth; None while nobody walks yet.
            scene_started_s: mark 1 of the truth.

        Returns:
            (3,), ENU metres.
        """
        return self.body.surface_centroid(self.person_surface(i, t_s, started_s, scene_started_s))

    def person_velocity(
        self, i: int, t_s: float, started_s: float | None, scene_started_s: float | None = None
    ) -> Vector:
        """(3,): velocity of person i's walk, ENU m/s, without the trunk's small motion within a stride."""
        return np.array(self.walkers[i].footing(t_s, started_s, scene_started_s).velocity_enu_m_s)
