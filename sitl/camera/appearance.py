"""What a person looks like: skin, hair and clothes on the body's mesh, lit by the sun as the body moves."""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.typing import NDArray

from mission.records import Vector
from sitl.camera import textures
from sitl.camera.mesh import shade
from sitl.camera.rasterizer import TriangleBatch
from sitl.people.body import Body
from sitl.scenario.scene import Clothes

SKIN, SHIRT, TROUSERS, SHOES, HAIR = range(5)
"""Materials of the mesh's triangles."""

_SKINS = ((0.94, 0.76, 0.64), (0.82, 0.60, 0.45), (0.62, 0.42, 0.30), (0.42, 0.28, 0.20))
_HAIRS = ((0.10, 0.08, 0.07), (0.24, 0.16, 0.10), (0.45, 0.32, 0.18), (0.40, 0.39, 0.38))
_CLOTH_REPEAT_M = 0.5


class Appearance:
    """The look of one person; vertices are doubled where materials meet."""

    def __init__(self, body: Body, clothes: Clothes, rng: np.random.Generator, sun: Vector) -> None:
        self._triangles = body.triangles
        self._sun = sun
        material = np.repeat(body.material, 3)
        pairs, inverse = np.unique(np.stack([body.triangles.ravel(), material], 1), axis=0, return_inverse=True)
        self.source: NDArray[np.int64] = pairs[:, 0].astype(np.int64)
        """(W,): which of the mesh's vertices each drawn vertex is."""
        self._drawn = inverse.reshape(-1, 3).astype(np.int32)
        self._colour = _palette(clothes, rng)[pairs[:, 1]]
        rest = body.vertices_m[self.source]
        self._uv = np.stack([rest[:, 1] + 0.4 * rest[:, 0], rest[:, 2]], 1) / _CLOTH_REPEAT_M
        self._texture = textures.cloth(rng)

    def batch(self) -> TriangleBatch:
        """The triangles to draw; place and paint them before each picture."""
        count = len(self.source)
        return TriangleBatch(
            np.zeros((count, 3)), self._drawn, self._uv, np.full((count, 4), 255, np.uint8), self._texture
        )

    def colours(self, surface: Vector) -> NDArray[np.uint8]:
        """(W, 4): the lit colours of the drawn vertices of a posed surface (V, 3), ENU."""
        a, b, c = (surface[self._triangles[:, k]] for k in range(3))
        across = np.cross(b - a, c - a)
        normals = np.zeros_like(surface)
        for axis in range(3):
            for k in range(3):
                normals[:, axis] += np.bincount(self._triangles[:, k], across[:, axis], len(surface))
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        light = shade(normals, self._sun)[self.source]
        rgba = np.full((len(self.source), 4), 255, np.uint8)
        rgba[:, :3] = np.clip(255.0 * self._colour * light[:, None], 0.0, 255.0)
        return rgba


def _palette(clothes: Clothes, rng: np.random.Generator) -> Vector:
    """(5, 3): red, green, blue of each material."""
    # Any colour but those of skin; jeans and greys.
    shirt = colorsys.hsv_to_rgb(rng.uniform(0.15, 1.01) % 1.0, rng.uniform(0.15, 0.85), rng.uniform(0.25, 0.95))
    trousers = colorsys.hsv_to_rgb(rng.uniform(0.56, 0.68), rng.uniform(0.05, 0.6), rng.uniform(0.12, 0.45))
    skin, hair = _SKINS[int(rng.integers(4))], _HAIRS[int(rng.integers(4))]
    given = {SKIN: clothes.skin, SHIRT: clothes.shirt, TROUSERS: clothes.trousers, HAIR: clothes.hair}
    palette = np.array([skin, shirt, trousers, (0.13, 0.12, 0.12), hair])
    for material, colour in given.items():
        if colour is not None:
            palette[material] = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    return palette
