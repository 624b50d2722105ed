"""The scene of a scenario: the light, the people and what stands there; the schema is in `sitl.scenario.schema`."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sitl.scenario.table import Degrees, Table

ScenarioWalk = Literal[
    "real-like",
    "calm",
    "wandering",
    "turns",
    "stops",
    "starts",
    "weaving",
    "giving-way",
    "greeting",
    "crouching",
    "standing",
]
"""Of `sitl.people.drawn_walk`; nobody runs: the body has no gait for it."""

Colour = Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")]


class Light(Table):
    """How bright it is and where the sun stands."""

    brightness: float = Field(default=1.0, ge=0.2, le=1.5)
    sun_azimuth_deg: Degrees = 220.0
    sun_elevation_deg: float = Field(default=40.0, ge=5.0, le=90.0)


class Clothes(Table):
    """Colours (#rrggbb); what is left out comes from the seed."""

    shirt: Colour | None = None
    trousers: Colour | None = None
    hair: Colour | None = None
    skin: Colour | None = None


class WalkTurn(Table):
    """A change of direction, clockwise."""

    after_s: float = Field(ge=0.0, le=600.0)
    by_deg: Degrees


class Person(Table):
    """Somebody who stands or walks."""

    distance_m: float = Field(gt=0.5, le=200.0)
    bearing_deg: Degrees
    speed_m_s: float = Field(default=0.0, ge=0.0, le=2.5)
    walk_from_line_of_sight_deg: Degrees | None = None
    walk_heading_deg: Degrees | None = None
    at: Literal["start"] | None = None
    when: Literal["drone-moves", "drone-turns"] | None = None
    stop_after_s: float | None = Field(default=None, ge=0.0, le=600.0)
    turns: tuple[WalkTurn, ...] = ()
    walks: ScenarioWalk | None = None
    walk_seed: int = Field(default=1, ge=0, lt=2**31)
    height_m: float = Field(default=1.75, ge=1.5, le=1.95)
    build: float = Field(default=1.0, ge=0.8, le=1.3)
    stride: float = Field(default=1.0, ge=0.8, le=1.25)
    clothes: Clothes = Clothes()

    @model_validator(mode="after")
    def _one_direction_and_one_start(self) -> Self:
        if self.walk_from_line_of_sight_deg is not None and self.walk_heading_deg is not None:
            raise ValueError("give either walk_from_line_of_sight_deg or walk_heading_deg, not both")
        if self.at is not None and self.when is not None:
            raise ValueError('give either at = "start" or when, not both')
        if self.walks is not None and (self.turns or self.stop_after_s is not None or self.speed_m_s > 0.0):
            raise ValueError("walks draws speed, stops and turns itself: leave speed_m_s, stop_after_s and turns out")
        return self

    @property
    def heading_rad(self) -> float:
        """The way the person walks or faces, clockwise from true north; by default towards the drone's start."""
        if self.walk_heading_deg is not None:
            return math.radians(self.walk_heading_deg)
        off = 180.0 if self.walk_from_line_of_sight_deg is None else self.walk_from_line_of_sight_deg
        return math.radians(self.bearing_deg + off)

    @property
    def waits_for_drone(self) -> bool:
        """Whether the walk begins with what the drone does."""
        return self.when is not None


class Obstacle(Table):
    """Something to pass behind."""

    kind: Literal["wall", "hedge", "tree"]
    distance_m: float = Field(gt=0.5, le=100.0)
    bearing_deg: Degrees
    width_m: float = Field(default=1.5, gt=0.05, le=30.0)
    height_m: float = Field(default=2.2, gt=0.1, le=15.0)
    turn_deg: Degrees = 0.0


class MarkerWall(Table):
    """A wall with a row of ArUco markers (DICT_4X4_50), square to the line of sight."""

    distance_m: float = Field(gt=0.5, le=100.0)
    bearing_deg: Degrees
    markers: int = Field(default=18, ge=2, le=50)
    marker_m: float = Field(default=0.4, gt=0.02, le=2.0)
    """Side of a marker, without the white around it."""
    spacing_m: float = Field(default=0.8, gt=0.03, le=5.0)
    """From the middle of one to that of the next."""
    left_m: float = Field(default=0.0, ge=-50.0, le=50.0)
    """How far to the left of the drone's start marker 0 is; the others follow to the right."""
    middle_m: float = Field(default=1.0, gt=0.0, le=10.0)
    """Of the row, above the ground."""
