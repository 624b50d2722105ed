"""What varies from flight to flight, and flights drawn at random."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mission.planning.pattern import fitted
from mission.settings import PatternSettings
from sitl.autopilot.estimate_errors import NoiseName
from sitl.people.walk import Walk
from sitl.scenario.scene import Person, ScenarioWalk

SceneName = Literal["street", "featureless", "crowd", "night", "crossing"]

NEAREST_M = 2.0
"""No drawn walk comes nearer to the drone than this: the person would not fit into the picture."""
STANDING_SHARE = 0.15
WALKED_S = 1.5
"""People walk for this long before the pattern begins, so that they do so evenly by then."""
CROWD_DISTANCE_M = (2.4, 2.9)
"""People must be this near to fill 40 % of the picture."""
CROSSING_DISTANCE_M = (5.0, 9.0)
"""Room for somebody to pass between."""


@dataclass(frozen=True, slots=True)
class Case:
    """One flight. The same case gives the same flight, bit for bit."""

    seed: int
    """Of scenery, clothes, light, wind, and all noise."""
    distance_m: float = 5.5
    """Of the person from the drone when the pattern begins."""
    walk_deg: float | None = 90.0
    """Direction of the walk from the line of sight: 0 away, 90 to the right, 180 towards; None stands."""
    speed_m_s: float = 0.6
    walks: ScenarioWalk | None = None
    """How the person walks, in place of straight at `speed_m_s`: first towards `walk_deg`."""
    noise: NoiseName = "good"
    """How well the autopilot knows its pose."""
    scene: SceneName = "street"
    offset_s: float = 0.1
    """How much later than the telemetry the video's clock runs."""
    size_px: tuple[int, int] = (640, 480)
    renderings: Literal[1, 2, 4] = 1
    """Renderings per picture: 1 has no motion blur, but costs half of 2."""
    pattern: PatternSettings = field(default_factory=PatternSettings)
    height_m: float = 1.75
    """Of the person."""
    build: float = 1.0
    """Breadth and depth of the person for their height."""
    stride: float = 1.0
    """Length of the person's steps for their speed."""

    @property
    def flown(self) -> PatternSettings:
        """The pattern, shortened for a near person as the mission does."""
        return fitted(self.pattern, self.distance_m)

    @property
    def name(self) -> str:
        """Says most of it."""
        walk = "stands" if self.walk_deg is None else f"{self.walk_deg:.0f}deg"
        if self.walks is not None:
            walk = f"{self.walks}-{walk}"
        return f"{self.scene}-{self.noise}-{self.distance_m:.2f}m-{walk}-{self.seed}"


def drawn_cases(
    count: int,
    seed: int,
    noise: NoiseName = "good",
    scene: SceneName = "street",
    *,
    first: int = 0,
    offset_s: tuple[float, float] = (0.0, 0.3),
    distance_m: tuple[float, float] = (2.75, 11.0),
    walks: ScenarioWalk | None = None,
) -> Iterator[Case]:
    """Flights past people anywhere who walk anywhere; the k-th is the same whatever the count.

    Args:
        count: how many.
        seed: of the draw.
        noise: the autopilot's.
        scene: what there is to see.
        first: number of the first one, to go on with a broken run.
        offset_s: smallest and largest time offset of the video.
        distance_m: smallest and largest distance when the pattern begins.
        walks: how the people walk; straight at constant speed, or not at all, when None.
    """
    for k in range(first, first + count):
        rng = np.random.default_rng([seed, k])
        yield _drawn(rng, int(rng.integers(1, 2**31)), noise, scene, offset_s, distance_m, walks)


_DISTANCES_M: dict[SceneName, tuple[float, float]] = {"crowd": CROWD_DISTANCE_M, "crossing": CROSSING_DISTANCE_M}


def _drawn(
    rng: np.random.Generator,
    seed: int,
    noise: NoiseName,
    scene: SceneName,
    offset_s: tuple[float, float],
    distance_m: tuple[float, float],
    walks: ScenarioWalk | None,
) -> Case:
    body = np.random.default_rng([seed, 4])
    while True:
        stands = rng.uniform() < STANDING_SHARE and walks is None
        near_m, far_m = _DISTANCES_M.get(scene, distance_m)
        case = Case(
            seed,
            distance_m=float(rng.uniform(near_m, far_m)),
            walk_deg=None if stands else _direction_deg(rng, scene),
            speed_m_s=0.0 if stands else float(rng.uniform(0.3, 1.0)),
            noise=noise,
            scene=scene,
            offset_s=float(rng.uniform(*offset_s)),
            renderings=2 if scene == "night" else 1,
            walks=walks,
            height_m=float(rng.uniform(1.5, 1.95)),
            build=float(body.uniform(0.85, 1.2)),
            stride=float(body.uniform(0.85, 1.15)),
        )
        if nearest_m(case) >= NEAREST_M:
            return case


def _direction_deg(rng: np.random.Generator, scene: SceneName) -> float:
    """Anywhere; along the lanes of a crowd, since who walks into one is hidden by it."""
    if scene == "crowd":
        return float(rng.choice((-90.0, 90.0)))
    return float(rng.uniform(-180.0, 180.0))


def nearest_m(case: Case) -> float:
    """How near the person comes to the drone's start and to the point of return."""
    if case.walks is not None:
        return _nearest_drawn_m(case)
    if case.walk_deg is None:
        return case.distance_m
    pattern = case.flown
    t = np.linspace(-2.0, 2.0 * pattern.leg_duration_s, 40)
    walk = math.radians(case.walk_deg)
    ahead = case.distance_m + case.speed_m_s * t * math.cos(walk)
    right = case.speed_m_s * t * math.sin(walk)
    drone = -0.5 * pattern.length_m * (1.0 - np.cos(math.pi * np.clip(t, 0.0, None) / pattern.leg_duration_s))
    return float(np.hypot(ahead, right - drone).min())


def drawn_person(case: Case, heading_deg: float) -> Person:
    """Somebody who walks as `case.walks` says, from north of the drone; the same for the same case."""
    return Person(
        distance_m=case.distance_m,
        bearing_deg=0.0,
        walk_heading_deg=heading_deg,
        walks=case.walks,
        walk_seed=case.seed % 2**31,
    )


def _nearest_drawn_m(case: Case) -> float:
    pattern = case.flown
    # The line of sight is north here; walks turn with the heading that they are drawn for.
    walk = Walk(drawn_person(case, ((case.walk_deg or 0.0) + 180.0) % 360.0 - 180.0))
    begin = walk.at(WALKED_S)
    t = np.linspace(-WALKED_S, 2.0 * pattern.leg_duration_s, 40)
    people = [walk.at(WALKED_S + float(at_s)) for at_s in t]
    ahead = case.distance_m + np.array([p.north_m - begin.north_m for p in people])
    right = np.array([p.east_m - begin.east_m for p in people])
    drone = -0.5 * pattern.length_m * (1.0 - np.cos(math.pi * np.clip(t, 0.0, None) / pattern.leg_duration_s))
    return float(np.hypot(ahead, right - drone).min())
