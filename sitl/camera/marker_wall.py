"""A white wall with a row of ArUco markers, as `sidestep calibrate baseline` wants it (Kim & Yow 2015, III-D)."""

from __future__ import annotations

import math
from functools import partial

import cv2
import numpy as np

from mission.records import Image, Vector
from sitl.camera.mesh import Mesh
from sitl.camera.rasterizer import TriangleBatch
from sitl.scenario.scene import MarkerWall

_MARGIN_M = 0.02
"""How far the markers stand off the wall, so that neither shines through the other."""
_EDGE_M = 1.0
"""Of bare wall, on all sides of the row."""
_CELL_PX = 16
_QUIET = 1.0 / 6.0
"""White around a marker, over its side: one cell, so that a marker of 4 x 4 with its border fills 128 px of texture."""
_UP = np.array([0.0, 0.0, 1.0])


def marker_wall(wall: MarkerWall, sun: Vector) -> list[TriangleBatch]:
    """The wall and its markers, 0, 1, 2, ... from left to right as the drone sees them.

    Args:
        wall: where it stands.
        sun: towards it, ENU.
    """
    bearing = math.radians(wall.bearing_deg)
    ahead = np.array([math.sin(bearing), math.cos(bearing), 0.0])
    right = np.array([math.cos(bearing), -math.sin(bearing), 0.0])
    middle = wall.distance_m * ahead + wall.middle_m * _UP
    first = middle - wall.left_m * right
    length = (wall.markers - 1) * wall.spacing_m
    plain = Mesh(lambda: np.full((2, 2, 3), 255, np.uint8), sun)
    corner = first - _EDGE_M * right - middle[2] * _UP + _MARGIN_M * ahead
    plain.grid(corner, (length + 2.0 * _EDGE_M) * right, (wall.middle_m + _EDGE_M) * _UP, (1.0, 1.0))
    meshes = [plain]
    side = wall.marker_m * (1.0 + 2.0 * _QUIET)
    for number in range(wall.markers):
        mesh = Mesh(partial(_marker, number), sun)
        at = first + number * wall.spacing_m * right
        mesh.grid(at - 0.5 * side * (right + _UP), side * right, side * _UP, (1.0, 1.0))
        meshes.append(mesh)
    return [batch for mesh in meshes if (batch := mesh.batch()) is not None]


def _marker(number: int) -> Image:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    picture = np.full((8 * _CELL_PX, 8 * _CELL_PX), 255, np.uint8)
    picture[_CELL_PX:-_CELL_PX, _CELL_PX:-_CELL_PX] = cv2.aruco.generateImageMarker(dictionary, number, 6 * _CELL_PX)
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), np.uint8)
