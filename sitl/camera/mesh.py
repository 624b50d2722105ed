"""Shapes of the scenery as textured triangles: quads, boxes, cylinders, leafy crowns; shaded as they are made."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mission.records import Image, Vector
from sitl.camera.rasterizer import TriangleBatch
from sitl.scenario.scene import Light

Colour = tuple[float, float, float]
"""Red, green, blue, 0 to 1: multiplied with the texture."""

WHITE: Colour = (1.0, 1.0, 1.0)
_UP = np.array([0.0, 0.0, 1.0])


def sun_direction(light: Light) -> Vector:
    """(3,): towards the sun, ENU."""
    azimuth, elevation = math.radians(light.sun_azimuth_deg), math.radians(light.sun_elevation_deg)
    flat = math.cos(elevation)
    return np.array([flat * math.sin(azimuth), flat * math.cos(azimuth), math.sin(elevation)])


def shade(normals: Vector, sun: Vector) -> Vector:
    """(N,): light on surfaces with these unit normals (N, 3): sky from above and sun."""
    return np.asarray(np.clip(0.50 + 0.10 * normals[:, 2] + 0.48 * np.maximum(0.0, normals @ sun), 0.0, 1.0))


class Mesh:
    """Collects triangles that share a texture, which is only made when there are any."""

    def __init__(self, texture: Callable[[], Image], sun: Vector) -> None:
        self._texture = texture
        self._sun = sun
        self._vertices: list[Vector] = []
        self._triangles: list[NDArray[np.int32]] = []
        self._uv: list[Vector] = []
        self._colours: list[Vector] = []
        self._count = 0

    def add(self, vertices: Vector, triangles: NDArray[np.int32], uv: Vector, colours: Vector) -> None:
        """Add triangles: (V, 3) places, (T, 3) indices, (V, 2) texture places and (V, 3) colours 0 to 1, as shaded."""
        self._vertices.append(vertices)
        self._triangles.append(triangles + self._count)
        self._uv.append(uv)
        self._colours.append(colours)
        self._count += len(vertices)

    def grid(
        self,
        corner: Vector,
        right: Vector,
        up: Vector,
        uv_size: tuple[float, float],
        cell_m: float = 2.5,
        tint: Colour = WHITE,
    ) -> None:
        """Add a parallelogram, cut into cells so that perspective and rolling shutter bend it well.

        Args:
            corner: (3,), lower left as seen from its front.
            right: (3,), the lower edge.
            up: (3,), the left edge.
            uv_size: repeats of the texture along both edges.
            cell_m: largest side of a cell.
            tint: multiplied with the texture.
        """
        columns = max(1, math.ceil(float(np.linalg.norm(right)) / cell_m))
        rows = max(1, math.ceil(float(np.linalg.norm(up)) / cell_m))
        v, u = (a.ravel() for a in np.mgrid[0 : rows + 1, 0 : columns + 1])
        part_u, part_v = u / columns, v / rows
        vertices = corner + part_u[:, None] * right + part_v[:, None] * up
        first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
        above = first + columns + 1
        triangles = np.concatenate(
            [np.stack([first, first + 1, above + 1], 1), np.stack([first, above + 1, above], 1)]
        ).astype(np.int32)
        normal = np.cross(right, up)
        normal = normal / np.linalg.norm(normal)
        light = float(shade(normal[None, :], self._sun)[0])
        colours = np.tile(np.array(tint) * light, (len(vertices), 1))
        self.add(vertices, triangles, np.stack([part_u * uv_size[0], part_v * uv_size[1]], 1), colours)

    def box(
        self,
        middle: Vector,
        half_right: Vector,
        half_ahead: Vector,
        height_m: float,
        repeat_m: float,
        tint: Colour = WHITE,
    ) -> None:
        """Add an upright box without its floor; `middle` is that of the floor."""
        up = _UP * height_m
        corners = [middle + a * half_right + b * half_ahead for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        for k in range(4):
            edge = corners[(k + 1) % 4] - corners[k]
            self.grid(corners[k], edge, up, (float(np.linalg.norm(edge)) / repeat_m, height_m / repeat_m), tint=tint)
        size = (2.0 * float(np.linalg.norm(half_right)) / repeat_m, 2.0 * float(np.linalg.norm(half_ahead)) / repeat_m)
        self.grid(corners[0] + up, 2.0 * half_right, 2.0 * half_ahead, size, tint=tint)

    def cylinder(
        self, foot: Vector, radius_m: float, top_radius_m: float, height_m: float, tint: Colour = WHITE
    ) -> None:
        """Add an upright, tapering cylinder of eight sides."""
        angles = np.linspace(0.0, 2.0 * np.pi, 9)
        around = np.stack([np.cos(angles), np.sin(angles), np.zeros(9)], 1)
        levels = np.linspace(0.0, 1.0, max(2, math.ceil(height_m / 1.5) + 1))
        radii = radius_m + (top_radius_m - radius_m) * levels
        vertices = (foot + around[None] * radii[:, None, None] + _UP * (levels * height_m)[:, None, None]).reshape(
            -1, 3
        )
        first = (np.arange(len(levels) - 1)[:, None] * 9 + np.arange(8)).ravel()
        triangles = np.concatenate(
            [np.stack([first, first + 1, first + 10], 1), np.stack([first, first + 10, first + 9], 1)]
        ).astype(np.int32)
        uv = np.stack([np.tile(angles / np.pi, len(levels)), np.repeat(levels * height_m, 9)], 1)
        light = np.tile(shade(around, self._sun), len(levels))
        self.add(vertices, triangles, uv, light[:, None] * np.array(tint))

    def crown(self, rng: np.random.Generator, middle: Vector, radius_m: Vector, tint: Colour = WHITE) -> None:
        """Add a leafy blob: an ellipsoid (radii (3,)) whose surface is pushed in and out at random."""
        rings, sides = 6, 8
        polar = np.linspace(0.04, np.pi - 0.04, rings)
        around = np.linspace(0.0, 2.0 * np.pi, sides + 1)
        unit = np.stack(
            [
                np.sin(polar)[:, None] * np.cos(around),
                np.sin(polar)[:, None] * np.sin(around),
                np.repeat(np.cos(polar)[:, None], sides + 1, 1),
            ],
            -1,
        )
        push = rng.uniform(0.72, 1.15, (rings, sides + 1))
        push[:, -1] = push[:, 0]
        vertices = (middle + unit * push[:, :, None] * radius_m).reshape(-1, 3)
        first = (np.arange(rings - 1)[:, None] * (sides + 1) + np.arange(sides)).ravel()
        below = first + sides + 1
        triangles = np.concatenate(
            [np.stack([first, below, below + 1], 1), np.stack([first, below + 1, first + 1], 1)]
        ).astype(np.int32)
        size = float(np.mean(radius_m))
        uv = np.stack([np.tile(around * size / 1.6, rings), np.repeat(polar * size / 1.6, sides + 1)], 1)
        light = shade(unit.reshape(-1, 3), self._sun) * rng.uniform(0.8, 1.1, len(vertices))
        self.add(vertices, triangles, uv, np.clip(light, 0.0, 1.0)[:, None] * np.array(tint))

    def batch(self, *, sky: bool = False) -> TriangleBatch | None:
        """All that was added; None if nothing was."""
        if not self._vertices:
            return None
        colours = np.concatenate(self._colours)
        rgba = np.full((len(colours), 4), 255, np.uint8)
        rgba[:, :3] = np.clip(255.0 * colours, 0.0, 255.0)
        return TriangleBatch(
            vertices=np.concatenate(self._vertices),
            triangles=np.concatenate(self._triangles),
            uv=np.concatenate(self._uv),
            colour=rgba,
            texture=self._texture(),
            sky=sky,
        )
