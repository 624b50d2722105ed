"""The rendered wall is the one that `sidestep calibrate baseline` measures."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

import sitl
from mission.calibration.wall import MarkerWall
from sitl.camera.airframe import body_from_camera, level_world_from_body_wxyz
from sitl.camera.renderer import CameraPose, Renderer, matrix_from_wxyz
from sitl.scenario.schema import read_scenario
from sitl.simulation.processes import camera_of

WALL = Path(sitl.__file__).parent / "scenarios" / "ardrone-wall" / "wall.toml"


def _always(pose: CameraPose, _t_s: float) -> CameraPose:
    return pose


def test_the_camera_s_place_is_read_from_the_wall_to_the_centimetre_all_along_the_pattern() -> None:
    scenario = read_scenario(WALL)
    wall = scenario.marker_wall
    assert wall is not None
    looked = MarkerWall("4X4_50", wall.marker_m, wall.spacing_m)
    bearing = math.radians(wall.bearing_deg)
    left = np.array([-math.cos(bearing), math.sin(bearing), 0.0])
    world_from_camera = matrix_from_wxyz(level_world_from_body_wxyz(bearing)) @ body_from_camera(0.0)
    renderer = Renderer(scenario, samples=1)
    try:
        for travel_m in (0.0, 5.0, 10.0):
            pose = CameraPose(travel_m * left + np.array([0.0, 0.0, 1.0]), world_from_camera)
            picture = renderer.expose(partial(_always, pose), 0.0, None)
            small = np.asarray(cv2.resize(picture, (640, 480), interpolation=cv2.INTER_AREA), np.uint8)
            sight = looked.look(small, camera_of(scenario).intrinsics)
            assert sight is not None
            assert sight.position_m == pytest.approx([wall.left_m - travel_m, 0.0, -wall.distance_m], abs=0.02)
    finally:
        renderer.close()
