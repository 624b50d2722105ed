"""People's shadows: a picture of the ground that is darkened where the sun does not reach.

All shadows are one picture, so that they join where they meet and are equally dark inside, as the sun's are. (Bodies
thrown flat on the ground triangle by triangle would lie in the same plane many times over: whichever of them the depth
buffer let through would darken it, and the shadow would be full of lines that flicker from picture to picture.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.records import Image, Vector
from sitl.camera.rasterizer import TriangleBatch
from sitl.people.body import Body

_DARK = 110
"""Alpha of the shadow, of 255."""
_UP_M = 0.025
"""Over the ground, so that the depth buffer can tell them apart at 20 m; with 0.006 parts were missing at 6 m."""
_TEXEL_M = 0.02
"""At best; doubled until all shadows have room."""
_APART_M = 0.03
"""Between the points that a shadow is made of."""
_SIDE = (256, 512)
"""Texels across the picture: of one person, of more."""
_EDGE = 4
_CELLS = 24
"""Of the sheet that the picture is on, along a side: a rolling shutter bends it."""
_LOWEST_SUN = 0.08
_CLOSED = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
"""Texels; more than lie between such points."""


@dataclass(frozen=True, slots=True, eq=False)
class Cast:
    """The shadows at one time."""

    picture: Image
    """(n, n): how dark, 0 to 255; rows towards north, columns towards east."""
    sheet: Vector
    """(V, 3): where the sheet's vertices are, ENU."""


class Shadows:
    """The shadows of some people.

    Args:
        body: what every person's mesh is.
        people: how many.
        sun: (3,), towards it, ENU.
    """

    def __init__(self, body: Body, people: int, sun: Vector) -> None:
        self._slope = sun[:2] / max(_LOWEST_SUN, float(sun[2]))
        self._side = _SIDE[people > 1]
        steps = np.linspace(0.0, 1.0, _CELLS + 1)
        east, north = np.meshgrid(steps, steps)
        self._sheet = np.column_stack([east.ravel(), north.ravel(), np.zeros(east.size)])
        # Lying sun stretches the shadow, and what it is made of has to be so much denser.
        self._corners, self._parts = _spread(body, _APART_M / max(1.0, float(np.hypot(*self._slope))))

    def batch(self) -> TriangleBatch:
        """The sheet; place it and give it its picture before each picture is taken."""
        first = (np.arange(_CELLS)[:, None] * (_CELLS + 1) + np.arange(_CELLS)).ravel()
        above = first + _CELLS + 1
        triangles = np.concatenate(
            [np.stack([first, first + 1, above + 1], 1), np.stack([first, above + 1, above], 1)]
        ).astype(np.int32)
        colour = np.zeros((len(self._sheet), 4), np.uint8)
        colour[:, 3] = 255
        clear: Image = np.zeros((self._side, self._side), np.uint8)
        return TriangleBatch(np.zeros_like(self._sheet), triangles, self._sheet[:, :2], colour, clear, transparent=True)

    def cast(self, surfaces: Sequence[Vector]) -> Cast:
        """Throw people onto the ground along the sun's rays.

        Args:
            surfaces: (V, 3) each, the posed bodies, ENU.
        """
        flat = np.concatenate([self._thrown(surface) for surface in surfaces])
        low, high = flat.min(axis=0), flat.max(axis=0)
        texel_m = _TEXEL_M
        while float((high - low).max()) > (self._side - 2 * _EDGE) * texel_m:
            texel_m *= 2.0
        # The texels stay where they are on the ground, so that a shadow that stands still does.
        corner = np.floor(low / texel_m) - _EDGE
        place = np.floor(flat / texel_m).astype(np.intp) - corner.astype(np.intp)
        hit = np.zeros((self._side, self._side), np.uint8)
        hit[place[:, 1], place[:, 0]] = _DARK
        closed = cv2.morphologyEx(hit, cv2.MORPH_CLOSE, _CLOSED)
        picture: Image = np.asarray(cv2.GaussianBlur(closed, (3, 3), 0.0), np.uint8)
        sheet = self._sheet * (self._side * texel_m)
        sheet[:, :2] += corner * texel_m
        sheet[:, 2] = _UP_M
        return Cast(picture, sheet)

    def _thrown(self, surface: Vector) -> NDArray[np.float64]:
        """(S, 2): many points of a surface (V, 3), where their shadow falls."""
        thrown = surface[:, :2] - (surface[:, 2:] - _UP_M) * self._slope
        return np.asarray(sum(self._parts[:, k, None] * thrown[self._corners[:, k]] for k in range(3)))


def _spread(body: Body, apart_m: float) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Points all over a mesh, about so far apart: vertices (S, 3) and what part of each (S, 3)."""
    a, b, c = (body.vertices_m[body.triangles[:, k]] for k in range(3))
    sides = np.stack([np.linalg.norm(side, axis=1) for side in (c - b, a - c, b - a)], axis=1)
    # The longest side is the base; rows of points along it, up to the apex.
    apexes, bases_m = sides.argmax(axis=1), np.maximum(sides.max(axis=1), 1e-9)
    heights_m = np.linalg.norm(np.cross(b - a, c - a), axis=1) / bases_m
    corners, parts = [], []
    for triangle, apex, base_m, height_m in zip(body.triangles, apexes, bases_m, heights_m, strict=True):
        rows = math.ceil(height_m / apart_m) or 1
        for up in (np.arange(rows) + 0.5) / rows:
            count = math.ceil(base_m * (1.0 - up) / apart_m) or 1
            along = (np.arange(count) + 0.5) / count
            part = np.empty((count, 3), np.float32)
            part[:, apex] = up
            part[:, (apex + 1) % 3] = (1.0 - up) * along
            part[:, (apex + 2) % 3] = (1.0 - up) * (1.0 - along)
            parts.append(part)
            corners += [triangle] * count
    return np.array(corners, np.int32), np.concatenate(parts)
