"""A human body: a skinned mesh posed by linear blend skinning, and the centroid of its surface.

The mesh (`sitl/data/human_male.npz`, CC0) stands upright with x forward, y to its left, z up and z = 0 under its soles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files

import numpy as np
from numpy.typing import NDArray

from mission.records import Vector

Indices = NDArray[np.int32]

REST_HEIGHT_M = 1.75
"""Height of the mesh as stored."""

PELVIS, SPINE_1, SPINE_2, SPINE_3, NECK, HEAD = range(6)
CLAVICLE, UPPER_ARM, LOWER_ARM, HAND = range(6, 10)
THIGH, CALF, FOOT, BALL = range(10, 14)
RIGHT = 8
"""Added to a left limb's bone gives the right one."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """The mesh with its bones."""

    vertices_m: Vector
    """(V, 3), in the rest pose."""
    triangles: Indices
    """(T, 3)."""
    material: NDArray[np.uint8]
    """(T,): what each triangle is made of, see `sitl.camera.appearance`."""
    weights: Vector
    """(V, B): how much each vertex follows each bone; rows add up to 1."""
    heads_m: Vector
    """(B, 3): where each bone starts in the rest pose."""
    parent: Indices
    """(B,): -1 for the root."""

    def pose(self, rotations: Vector, root_m: Vector) -> Vector:
        """Pose the mesh by linear blend skinning.

        Args:
            rotations: (B, 3, 3), of each bone in the body's frame, relative to the rest pose (not to the parent).
            root_m: (3,), where the pelvis goes, relative to its place in the rest pose.

        Returns:
            (V, 3), metres, body frame.
        """
        joints = np.empty_like(self.heads_m)
        joints[0] = self.heads_m[0] + root_m
        for bone in range(1, len(joints)):
            up = self.parent[bone]
            joints[bone] = joints[up] + rotations[up] @ (self.heads_m[bone] - self.heads_m[up])
        shift = joints - np.einsum("bij,bj->bi", rotations, self.heads_m)
        affine = self.weights @ np.concatenate([rotations.reshape(-1, 9), shift], axis=1)
        linear = affine[:, :9].reshape(-1, 3, 3)
        return np.asarray(np.matmul(linear, self.vertices_m[:, :, None])[:, :, 0] + affine[:, 9:])

    def surface_centroid(self, vertices_m: Vector) -> Vector:
        """Area-weighted centroid of a posed surface.

        This is the point that an image-based method can be scored against: it is about 5 cm ahead of the mesh's root,
        and the root itself would add a false 3 % of height.

        Args:
            vertices_m: (V, 3), any frame.

        Returns:
            (3,), in the same frame.
        """
        a, b, c = (vertices_m[self.triangles[:, k]] for k in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return np.asarray(area @ (a + b + c) / (3.0 * area.sum()))


@cache
def read_body() -> Body:
    """The body that comes with the program."""
    with as_file(files("sitl") / "data" / "human_male.npz") as path, np.load(path, allow_pickle=False) as stored:
        weights = stored["weights"].astype(np.float64)
        return Body(
            vertices_m=stored["verts"].astype(np.float64),
            triangles=stored["faces"].astype(np.int32),
            material=stored["mat"],
            weights=weights / weights.sum(axis=1, keepdims=True),
            heads_m=stored["heads"].astype(np.float64),
            parent=stored["parent"].astype(np.int32),
        )
