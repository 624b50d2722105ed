"""The place where a scenario happens: lawn, paths, houses, trees, street furniture, obstacles, sky; from the seed.

Nothing of it stands where it could come between the drone and a person, except the scenario's own obstacles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from mission.records import Image, Vector
from sitl.camera import textures
from sitl.camera.marker_wall import marker_wall
from sitl.camera.mesh import Colour, Mesh, sun_direction
from sitl.camera.rasterizer import TriangleBatch
from sitl.people.walk import Walk
from sitl.scenario.scene import Obstacle
from sitl.scenario.schema import Scenario

_CLEAR_OF_ACTION_M = 2.0
_DRONE_ROOM_M = 6.0
_WATCHED_S = 25.0
_SECTORS = 12
_NEAR_M = 7.0
_SKY_M = 400.0
_UP = np.array([0.0, 0.0, 1.0])
_WOOD: Colour = (0.42, 0.28, 0.16)


def scenery(scenario: Scenario) -> list[TriangleBatch]:
    """Everything in the scenario that does not move."""
    rng = np.random.default_rng([scenario.seed, 1])
    sun = sun_direction(scenario.light)
    meshes = _Meshes(scenario.seed, sun)
    _ground(meshes, rng)
    for obstacle in scenario.obstacles:
        _obstacle(meshes, rng, obstacle)
    if scenario.scenery:
        room = _ClearRoom(scenario)
        _houses(meshes, rng, room)
        _trees(meshes, rng, room)
        _street_furniture(meshes, rng, room)
    batches = [batch for mesh in meshes.all if (batch := mesh.batch()) is not None]
    if scenario.marker_wall is not None:
        batches += marker_wall(scenario.marker_wall, sun)
    return [_sky(rng), *(part for batch in batches for part in _sectors(batch))]


def _sectors(batch: TriangleBatch) -> list[TriangleBatch]:
    """Cut a batch by the direction from the origin, so that what the camera cannot see costs nothing."""
    middles = batch.vertices[batch.triangles].mean(axis=1)
    sector = np.floor(_SECTORS * (np.arctan2(middles[:, 0], middles[:, 1]) / (2.0 * np.pi) + 0.5)).astype(int)
    sector[np.hypot(middles[:, 0], middles[:, 1]) < _NEAR_M] = -1
    parts = []
    for number in np.unique(sector):
        used, triangles = np.unique(batch.triangles[sector == number], return_inverse=True)
        parts.append(
            replace(
                batch,
                vertices=batch.vertices[used],
                triangles=triangles.reshape(-1, 3).astype(np.int32),
                uv=batch.uv[used],
                colour=batch.colour[used],
            )
        )
    return parts


class _Meshes:
    """One mesh per texture."""

    def __init__(self, seed: int, sun: Vector) -> None:
        def mesh(number: int, make: Callable[[np.random.Generator], Image]) -> Mesh:
            return Mesh(lambda: make(np.random.default_rng([seed, 4, number])), sun)

        self.grass = mesh(0, textures.grass)
        self.paving = mesh(1, textures.paving)
        self.bricks = mesh(2, textures.bricks)
        self.roof = mesh(3, textures.roof)
        self.bark = mesh(4, textures.bark)
        self.leaves = mesh(5, textures.leaves)
        self.plain = mesh(6, textures.plain)
        self.fronts = [mesh(4 + columns, partial(textures.front, columns=columns)) for columns in (3, 4, 5)]
        self.all = [
            self.grass, self.paving, self.bricks, *self.fronts, self.roof, self.bark, self.leaves, self.plain,
        ]  # fmt: skip


class _ClearRoom:
    """Where people walk and the drone flies, and everything between: scenery keeps out of it."""

    def __init__(self, scenario: Scenario) -> None:
        angles = np.linspace(0.0, 2.0 * np.pi, 13)[:-1]
        points = [_DRONE_ROOM_M * np.stack([np.sin(angles), np.cos(angles)], 1)]
        for person in scenario.people:
            walk = Walk(person)
            track = [walk.at(t) for t in np.arange(0.0, _WATCHED_S, 1.0)]
            points.append(np.array([[f.east_m, f.north_m] for f in track]))
        points.extend(_place(obstacle)[None, :2] for obstacle in scenario.obstacles)
        self._hull = cv2.convexHull(np.concatenate(points).astype(np.float32))
        self._taken: list[tuple[Vector, float]] = []

    def take(self, place: Vector, radius_m: float) -> bool:
        """Claim a circle; False if it is in the way or taken."""
        inside = cv2.pointPolygonTest(self._hull, (float(place[0]), float(place[1])), True)
        if inside > -(_CLEAR_OF_ACTION_M + radius_m):
            return False
        if any(np.hypot(*(place - other)[:2]) < radius_m + space for other, space in self._taken):
            return False
        self._taken.append((place, radius_m))
        return True


def _ground(meshes: _Meshes, rng: np.random.Generator) -> None:
    """Lawn with two paths; cells are small near the origin and large far away."""
    far = np.array([32.0, 44.0, 64.0, 110.0, 200.0])
    lines = np.concatenate([-far[::-1], np.arange(-24.0, 24.1, 2.0), far])
    north, east = (a.ravel() for a in np.meshgrid(lines, lines, indexing="ij"))
    vertices = np.stack([east, north, np.zeros_like(east)], 1)
    row, column = (a.ravel() for a in np.mgrid[0 : len(lines) - 1, 0 : len(lines) - 1])
    corner = row * len(lines) + column
    corners = np.stack([corner, corner + 1, corner + len(lines) + 1, corner + len(lines)], 1)
    path_east, path_north = 2.0 * rng.integers(-3, 3), 2.0 * rng.integers(-4, 4)
    paved = (vertices[corner, 0] == path_east) | (vertices[corner, 1] == path_north)
    for mesh, cells, repeat_m, wear in ((meshes.grass, ~paved, 3.0, 0.08), (meshes.paving, paved, 2.0, 0.05)):
        quads = corners[cells]
        triangles = np.concatenate([quads[:, (0, 1, 2)], quads[:, (0, 2, 3)]]).astype(np.int32)
        used, renumbered = np.unique(triangles, return_inverse=True)
        colours = np.repeat(1.0 - wear * rng.uniform(0.0, 1.0, (len(used), 1)), 3, 1)
        mesh.add(vertices[used], renumbered.reshape(-1, 3).astype(np.int32), vertices[used, :2] / repeat_m, colours)


def _houses(meshes: _Meshes, rng: np.random.Generator, room: _ClearRoom) -> None:
    for k in range(16):
        bearing = 2.0 * math.pi * (k + rng.uniform(-0.3, 0.3)) / 16.0
        distance_m = rng.uniform(24.0, 46.0)
        place = np.array([distance_m * math.sin(bearing), distance_m * math.cos(bearing), 0.0])
        turn = bearing + rng.uniform(-0.5, 0.5)
        wide_m, deep_m, high_m = rng.uniform(8.0, 13.0), rng.uniform(6.0, 9.0), rng.uniform(4.8, 6.4)
        if not room.take(place, 0.5 * math.hypot(wide_m, deep_m)):
            continue
        right = 0.5 * wide_m * np.array([math.cos(turn), -math.sin(turn), 0.0])
        back = 0.5 * deep_m * np.array([math.sin(turn), math.cos(turn), 0.0])
        up = np.array([0.0, 0.0, high_m])
        mesh = meshes.fronts[int(rng.integers(3))]
        corners = [place + a * right + b * back for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        for i in range(4):
            mesh.grid(corners[i], corners[(i + 1) % 4] - corners[i], up, (1.0, 1.0))
        ridge = up + np.array([0.0, 0.0, 0.42 * deep_m])
        eaves = 1.08
        for sign in (-1.0, 1.0):
            corner = place + eaves * (-sign * right * -1.0 + sign * back) + up
            slope = place + ridge - (place + eaves * sign * back + up)
            meshes.roof.grid(corner, -2.0 * eaves * sign * right, slope, (wide_m / 2.5, deep_m / 4.0))
            gable = np.array(
                [place + sign * right - back + up, place + sign * right + back + up, place + sign * right + ridge]
            )
            meshes.bricks.add(
                gable,
                np.array([[0, 1, 2]], np.int32),
                np.array([[0.0, 0.0], [3.0, 0.0], [1.5, 1.5]]),
                np.full((3, 3), 0.8),
            )


def _tree(meshes: _Meshes, rng: np.random.Generator, foot: Vector, trunk_m: float, height_m: float) -> None:
    stem_m = 0.42 * height_m
    meshes.bark.cylinder(foot, 0.5 * trunk_m, 0.32 * trunk_m, 1.3 * stem_m)
    green = rng.uniform(0.75, 1.0)
    tint: Colour = (green * rng.uniform(0.8, 1.15), green, green * rng.uniform(0.7, 1.0))
    spread_m = 0.24 * height_m
    for _ in range(3):
        middle = foot + np.array([*rng.uniform(-0.6, 0.6, 2) * spread_m, stem_m + rng.uniform(0.25, 0.42) * height_m])
        meshes.leaves.crown(rng, middle, spread_m * rng.uniform(0.75, 1.1, 3), tint)


def _trees(meshes: _Meshes, rng: np.random.Generator, room: _ClearRoom) -> None:
    for _ in range(30):
        bearing, distance_m = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(11.0, 42.0)
        place = np.array([distance_m * math.sin(bearing), distance_m * math.cos(bearing), 0.0])
        height_m = rng.uniform(4.0, 9.0)
        if room.take(place, 0.3 * height_m):
            _tree(meshes, rng, place, rng.uniform(0.2, 0.45), height_m)


def _street_furniture(meshes: _Meshes, rng: np.random.Generator, room: _ClearRoom) -> None:
    for k in range(34):
        bearing, distance_m = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(9.0, 30.0)
        place = np.array([distance_m * math.sin(bearing), distance_m * math.cos(bearing), 0.0])
        turn = rng.uniform(0.0, 2.0 * math.pi)
        right, ahead = np.array([math.cos(turn), math.sin(turn), 0.0]), np.array([-math.sin(turn), math.cos(turn), 0.0])
        if not room.take(place, 1.0 if k % 5 else 2.4):
            continue
        if k % 5 == 0:  # a parked car
            paint: Colour = tuple(rng.uniform(0.15, 0.9, 3))
            meshes.plain.box(place + 0.3 * _UP, 2.1 * right, 0.85 * ahead, 0.55, 2.0, paint)
            meshes.plain.box(place + 0.85 * _UP, 1.15 * right, 0.75 * ahead, 0.55, 2.0, (0.16, 0.18, 0.20))
            for a in (-1.3, 1.3):
                meshes.plain.box(place + a * right, 0.32 * right, 0.87 * ahead, 0.6, 1.0, (0.08, 0.08, 0.08))
        elif k % 5 == 1:  # a lamp post
            meshes.plain.cylinder(place, 0.07, 0.05, 4.2, (0.30, 0.33, 0.33))
            meshes.plain.box(place + 4.2 * _UP, 0.22 * right, 0.12 * ahead, 0.15, 1.0, (0.85, 0.85, 0.8))
        elif k % 5 == 2:  # a bench
            meshes.plain.box(place + 0.40 * _UP, 0.8 * right, 0.22 * ahead, 0.06, 1.0, _WOOD)
            meshes.plain.box(
                place + 0.24 * ahead + [0, 0, 0.5], 0.8 * right, 0.03 * ahead, 0.4, 1.0, (0.42, 0.28, 0.16)
            )
            for a in (-0.65, 0.65):
                meshes.plain.box(place + a * right, 0.04 * right, 0.2 * ahead, 0.4, 1.0, (0.2, 0.2, 0.2))
        elif k % 5 == 3:  # a litter bin
            meshes.plain.cylinder(place, 0.24, 0.27, 0.85, (0.15, 0.35, 0.20))
        else:  # a bollard
            meshes.plain.cylinder(place, 0.08, 0.08, 0.95, (0.75, 0.12, 0.10))


def _place(obstacle: Obstacle) -> Vector:
    bearing = math.radians(obstacle.bearing_deg)
    return np.array([obstacle.distance_m * math.sin(bearing), obstacle.distance_m * math.cos(bearing), 0.0])


def _obstacle(meshes: _Meshes, rng: np.random.Generator, obstacle: Obstacle) -> None:
    place = _place(obstacle)
    turn = math.radians(obstacle.bearing_deg + obstacle.turn_deg)
    right = 0.5 * obstacle.width_m * np.array([math.cos(turn), -math.sin(turn), 0.0])
    ahead = np.array([math.sin(turn), math.cos(turn), 0.0])
    if obstacle.kind == "wall":
        meshes.bricks.box(place, right, 0.12 * ahead, obstacle.height_m, 1.1)
    elif obstacle.kind == "hedge":
        meshes.leaves.box(place, right, 0.35 * ahead, obstacle.height_m, 1.2)
    else:
        _tree(meshes, rng, place, obstacle.width_m, obstacle.height_m)


def _sky(rng: np.random.Generator) -> TriangleBatch:
    """A dome of directions down to just below the horizon."""
    rings, sides = 9, 24
    elevation = np.radians(np.linspace(90.0, -3.0, rings))
    around = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    vertices = np.stack(
        [
            np.cos(elevation)[:, None] * np.cos(around),
            np.cos(elevation)[:, None] * np.sin(around),
            np.repeat(np.sin(elevation)[:, None], sides + 1, 1),
        ],
        -1,
    ).reshape(-1, 3)
    vertices *= _SKY_M
    first = (np.arange(rings - 1)[:, None] * (sides + 1) + np.arange(sides)).ravel()
    below = first + sides + 1
    triangles = np.concatenate([np.stack([first, below, below + 1], 1), np.stack([first, below + 1, first + 1], 1)])
    part = np.linspace(0.998, 0.002, rings)
    uv = np.stack([np.tile(around * 3.0 / (2.0 * np.pi), rings), np.repeat(part, sides + 1)], 1)
    colour = np.full((len(vertices), 4), 255, np.uint8)
    return TriangleBatch(vertices, triangles.astype(np.int32), uv, colour, textures.sky(rng), sky=True)
