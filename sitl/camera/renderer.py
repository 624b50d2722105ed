"""What the camera sees: one picture with lens, rolling shutter, motion blur and sensor noise.

Every vertex is placed where the camera saw it at the time of its own row. The picture is the mean of a few renderings
spread over the exposure, each shifted by part of a pixel: that is motion blur and antialiasing in one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.records import Image, Vector
from sitl.camera.appearance import Appearance
from sitl.camera.lens import Lens, distort
from sitl.camera.mesh import sun_direction
from sitl.camera.rasterizer import Rasterizer, TriangleBatch
from sitl.camera.scenery import scenery
from sitl.camera.sensor import Sensor
from sitl.camera.shadows import Shadows
from sitl.people.world import World
from sitl.scenario.schema import Scenario

_NEAREST_M = 0.05
_CULL_MARGIN = 0.06
"""Radians that the camera may turn during a picture."""
_JITTER_PX = {
    1: ((0.0, 0.0),),
    2: ((-0.25, -0.25), (0.25, 0.25)),
    4: ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375)),
}
"""Places within a pixel, by the number of renderings; none in the same row or column (rotated grid)."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Where the lens is and how it is turned."""

    position_enu_m: Vector
    """(3,)"""
    world_from_camera: Vector
    """(3, 3); camera x right, y down, z out."""


PoseAt = Callable[[float], CameraPose]
"""The camera's pose at a time, monotonic seconds."""


def matrix_from_wxyz(quaternion: Sequence[float] | Vector) -> Vector:
    """(3, 3) rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = np.asarray(quaternion, np.float64) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


class Renderer:
    """Makes the pictures of a scenario's camera, wherever it is."""

    def __init__(self, scenario: Scenario, *, extra: Sequence[TriangleBatch] = (), samples: int | None = None) -> None:
        """Build the scene.

        Args:
            scenario: what there is to see, and the camera.
            extra: further things that stand still (markers for tests).
            samples: renderings per picture (1, 2 or 4), instead of the scenario's.

        Raises:
            VideoError: there is no software renderer.
        """
        self.world = World(scenario)
        self.camera = scenario.camera.intrinsics
        self._exposure_s = scenario.camera.exposure_ms / 1000.0
        self._readout_s = scenario.camera.readout_ms / 1000.0
        self._samples = scenario.camera.renderings if samples is None else samples
        self._lens = Lens(self.camera)
        self._sensor = Sensor(scenario)
        canvas = self._lens.canvas
        self._rasterizer = Rasterizer(canvas.width_px, canvas.height_px, canvas.focal_px, canvas.centre_px)
        sun = sun_direction(scenario.light)
        self._parts: list[_Part] = []
        for batch in [*scenery(scenario), *extra]:
            self._add(batch)
        still = [part.batch for part in self._parts]
        self._still = np.concatenate([batch.vertices for batch in still]).astype(np.float32)
        # What is infinitely far (the sky) does not move with the camera's place.
        counts = [len(batch.vertices) for batch in still]
        self._anchored = np.repeat(np.array([0.0 if batch.sky else 1.0 for batch in still], np.float32), counts)[
            :, None
        ]
        self._people: list[_Figure] = []
        for i, person in enumerate(scenario.people):
            look = Appearance(self.world.body, person.clothes, np.random.default_rng([scenario.seed, 2, i]), sun)
            self._people.append(_Figure(look, self._add(look.batch())))
        self._shadows = Shadows(self.world.body, len(scenario.people), sun)
        self._sheet = self._add(self._shadows.batch())

    def _add(self, batch: TriangleBatch) -> _Part:
        first = self._parts[-1].vertices.stop if self._parts else 0
        part = _Part(self._rasterizer.add(batch), batch, slice(first, first + len(batch.vertices)))
        self._parts.append(part)
        return part

    def picture(
        self,
        camera_position_enu: Sequence[float] | Vector,
        world_from_camera_wxyz: Sequence[float] | Vector,
        t_s: float,
        started_s: float | None,
        *,
        velocity_enu_m_s: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> Image:
        """The picture of a camera that keeps its attitude and moves evenly; see `expose`."""
        position, velocity = np.asarray(camera_position_enu, np.float64), np.asarray(velocity_enu_m_s, np.float64)
        rotation = matrix_from_wxyz(world_from_camera_wxyz)
        return self.expose(lambda t: CameraPose(position + (t - t_s) * velocity, rotation), t_s, started_s)

    def expose(
        self, pose_at: PoseAt, t_s: float, started_s: float | None, scene_started_s: float | None = None
    ) -> Image:
        """Take a picture: `draw` and `develop`.

        Args:
            pose_at: the lens' pose at any time within half of exposure plus readout around `t_s`.
            t_s: when the middle row's exposure is half over, monotonic seconds.
            started_s: when walks begin (the truth's mark 0); None while nobody walks.
            scene_started_s: the truth's mark 1.

        Returns:
            BGR picture, (height, width, 3).
        """
        return self.develop(self.draw(pose_at, t_s, started_s, scene_started_s), t_s)

    def develop(self, light: Image, t_s: float) -> Image:
        """What lens and sensor make of the light at `t_s`; may run beside the next `draw`, in another thread."""
        return self._sensor.expose(self._lens.picture(light), t_s)

    def draw(self, pose_at: PoseAt, t_s: float, started_s: float | None, scene_started_s: float | None = None) -> Image:
        """The light of an exposure as a pinhole would have it, BGR, larger than the picture; see `expose`."""
        half_s = max(1e-3, 0.5 * (self._exposure_s + self._readout_s))
        times = (t_s - half_s, t_s, t_s + half_s)
        poses = [pose_at(t) for t in times]
        people = range(len(self._people))
        surfaces = [[self.world.person_surface(i, t, started_s, scene_started_s) for i in people] for t in times]
        for figure, surface in zip(self._people, surfaces[1], strict=True):
            self._rasterizer.paint(figure.body.number, figure.look.colours(surface))
        sheet = self._shaded(surfaces[1])
        seen = [self._points(pose, bodies, sheet) for pose, bodies in zip(poses, surfaces, strict=True)]
        motion = _Motion(seen, half_s, self._row_delay(seen[1]))
        return self._mean_over_exposure(motion, poses[1])

    def close(self) -> None:
        """Give the off-screen buffer back."""
        self._rasterizer.close()

    def _shaded(self, surfaces: list[Vector]) -> Vector:
        """(V, 3): where the sheet with the shadows of people with these surfaces is, ENU. It stands for the picture."""
        if not surfaces:
            return np.zeros((self._sheet.vertices.stop - self._sheet.vertices.start, 3))
        cast = self._shadows.cast(surfaces)
        self._rasterizer.cover(self._sheet.number, cast.picture)
        return cast.sheet

    def _points(self, pose: CameraPose, surfaces: list[Vector], sheet: Vector) -> NDArray[np.float32]:
        """(V, 3): every vertex of the scene, of people with these surfaces and of shadows, in the camera's frame."""
        place, rotation = pose.position_enu_m.astype(np.float32), pose.world_from_camera.astype(np.float32)
        points = np.empty((self._parts[-1].vertices.stop, 3), np.float32)
        points[: len(self._still)] = (self._still - self._anchored * place) @ rotation
        for figure, surface in zip(self._people, surfaces, strict=True):
            body = (surface - pose.position_enu_m) @ pose.world_from_camera
            points[figure.body.vertices] = body[figure.look.source]
        points[self._sheet.vertices] = (sheet - pose.position_enu_m) @ pose.world_from_camera
        return points

    def _mean_over_exposure(self, motion: _Motion, pose: CameraPose) -> Image:
        visible = [part for part in self._parts if part.may_be_seen(pose, self._lens)]
        for part in self._parts:
            self._rasterizer.show(part.number, part in visible)
        mean: Image | None = None
        for k in range(self._samples):
            delay_s = ((k + 0.5) / self._samples - 0.5) * self._exposure_s
            shift = np.array(_JITTER_PX[self._samples][k], np.float32) / self._rasterizer.focal_px
            points = motion.points(delay_s, shift)
            for part in visible:
                self._rasterizer.place(part.number, points[part.vertices])
            drawn = self._rasterizer.draw()
            if mean is None:
                mean = drawn.copy() if self._samples > 1 else drawn
            else:
                mean = np.asarray(cv2.addWeighted(mean, k / (k + 1.0), drawn, 1.0 / (k + 1.0), 0.0), np.uint8)
        assert mean is not None
        return np.asarray(cv2.cvtColor(mean, cv2.COLOR_BGRA2BGR), np.uint8)

    def _row_delay(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """(V, 1): how much later than the middle row each point's row is exposed, seconds."""
        if self._readout_s == 0.0:
            return np.zeros((len(points), 1), np.float32)
        depth = np.maximum(points[:, 2:], _NEAREST_M)
        low, high = self._lens.ideal_bounds
        rows = distort(np.clip(points[:, :2] / depth, low, high), self.camera)[:, 1:]
        part = np.clip(rows / self.camera.height_px, 0.0, 1.0) - 0.5
        return np.where(points[:, 2:] > _NEAREST_M, part * self._readout_s, 0.0).astype(np.float32)


class _Part:
    """A batch in the rasterizer, and where its vertices are among all of the scene's."""

    def __init__(self, number: int, batch: TriangleBatch, vertices: slice) -> None:
        self.number, self.batch, self.vertices = number, batch, vertices
        low, high = batch.vertices.min(axis=0), batch.vertices.max(axis=0)
        self._middle, self._radius_m = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
        self._always = batch.sky or self._radius_m == 0.0

    def may_be_seen(self, pose: CameraPose, lens: Lens) -> bool:
        """Whether the sphere around the batch reaches into the cone around all that the lens sees."""
        if self._always:
            return True
        away = (self._middle - pose.position_enu_m) @ pose.world_from_camera
        distance_m = float(np.linalg.norm(away))
        if distance_m <= self._radius_m:
            return True
        off_axis = np.arccos(np.clip(away @ lens.axis / distance_m, -1.0, 1.0))
        return bool(off_axis < lens.cone + np.arcsin(self._radius_m / distance_m) + _CULL_MARGIN)


@dataclass(frozen=True, slots=True, eq=False)
class _Figure:
    """A person in the scene."""

    look: Appearance
    body: _Part


class _Motion:
    """Points in the camera's frame as they move during a picture: a parabola through three instants."""

    def __init__(self, points: list[NDArray[np.float32]], half_s: float, row_delay_s: NDArray[np.float32]) -> None:
        before, self._middle, after = points
        self._rate = (after - before) / np.float32(2.0 * half_s)
        self._bend = (after + before - 2.0 * self._middle) / np.float32(2.0 * half_s**2)
        self._delay_s = row_delay_s

    def points(self, delay_s: float, shift: NDArray[np.float32]) -> NDArray[np.float32]:
        """(V, 3): at a time after the middle of each point's own row, moved by `shift` (x/z, y/z) in the picture."""
        delay = self._delay_s + np.float32(delay_s)
        points = self._middle + delay * (self._rate + delay * self._bend)
        points[:, :2] += shift * points[:, 2:]
        return np.asarray(points, np.float32)
