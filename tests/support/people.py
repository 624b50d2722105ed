"""Rendered pictures of people for the tests of detection and tracking."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from mission.records import Box, Frame, Image
from sitl.camera.renderer import CameraPose, Renderer
from sitl.camera.view import PersonView, view_person
from sitl.scenario.schema import parse_scenario

FPS = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """A picture and what is true in it."""

    frame: Frame
    truth: PersonView
    roll_rad: float

    @property
    def box(self) -> Box:
        return self.truth.box


@cache
def film(people: str, frames: int = 1, every: int = 1, roll_deg: float = 0.0, seed: int = 5) -> tuple[Shot, ...]:
    """A standing camera 1.6 m above the ground that looks north, 5 degrees down, at the people (TOML)."""
    scenario = parse_scenario(f'name = "film"\nseed = {seed}\n' + people)
    renderer = Renderer(scenario, samples=1)
    down, roll = np.radians([5.0, roll_deg])
    # Columns: camera x (right), y (down), z (out) in east, north, up; then turned about its axis.
    upright = np.stack([[1.0, 0.0, 0.0], [0.0, -np.sin(down), -np.cos(down)], [0.0, np.cos(down), -np.sin(down)]], 1)
    pose = CameraPose(np.array([0.0, 0.0, 1.6]), upright @ Rotation.from_rotvec([0.0, 0.0, roll]).as_matrix())
    shots = []
    try:
        for i in range(frames):
            t = i * every / FPS
            truth = view_person(renderer.world, 0, pose, renderer.camera, t, 0.0)
            assert truth is not None
            shots.append(Shot(Frame(renderer.expose(lambda _: pose, t, 0.0), t, i), truth, float(roll)))
    finally:
        renderer.close()
    return tuple(shots)


def person(distance_m: float, bearing_deg: float = 0.0, walk_deg: float | None = None, speed_m_s: float = 0.6) -> str:
    """TOML of somebody; `walk_deg` 0 away, 90 to the right, 180 towards."""
    walk = "" if walk_deg is None else f"speed_m_s = {speed_m_s}\nwalk_from_line_of_sight_deg = {walk_deg}\n"
    return f"[[people]]\ndistance_m = {distance_m}\nbearing_deg = {bearing_deg}\n{walk}"


def hidden(frame: Frame, box: Box) -> Frame:
    """The frame with a grey board in front of a part of it."""
    image: Image = frame.image.copy()
    left, right = (int(np.clip(v, 0, image.shape[1])) for v in (box.left_px, box.right_px))
    image[:, left:right] = 110
    return Frame(image, frame.t_s, frame.index)
