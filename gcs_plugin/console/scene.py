"""What the map shows of the flight: the aircraft, its path, the rays to the target, the room that it may use."""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mission.camera import Camera
from mission.camera.model import CameraModel
from mission.geodesy import enu_to_geodetic
from mission.pose.buffer import Pose
from mission.records import FlightSightings, Frame, GeodeticOrigin, Vector
from mission.sighting import azimuth_of, camera_position
from mission.track import Track
from mission.vehicle.drone import Drone

Position = tuple[float, float]
"""Longitude and latitude, degrees."""
POSE_AGE_S: Final = 0.3
RAY_M: Final = 60.0
_PATH_POINTS: Final = 600
_PATH_STEP_M: Final = 0.1
_RAYS: Final = 80
_MEASURED_RAYS: Final = 30
_RAY_PERIOD_S: Final = 0.3
_FENCE_POINTS: Final = 48


@dataclass(frozen=True, slots=True)
class Aircraft:
    """Where the aircraft is."""

    position: Position
    heading_rad: float | None
    camera_rad: float | None
    """Where its camera looks, clockwise from north."""
    hfov_rad: float


@dataclass(frozen=True, slots=True)
class Drawn:
    """What is drawn; positions of lines in order."""

    aircraft: Aircraft | None = None
    path: tuple[Position, ...] = ()
    rays: tuple[tuple[Position, Position], ...] = ()
    fence: tuple[Position, ...] = ()


class Scene:
    """Collects what is drawn. Fed by the vehicle's own loop; `drawn` may be asked for in any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._path: deque[tuple[Vector, Position]] = deque(maxlen=_PATH_POINTS)
        self._rays: deque[tuple[Position, Position]] = deque(maxlen=_RAYS)
        self._fence: tuple[Position, ...] = ()
        self._aircraft: Aircraft | None = None
        self._ray_s = -math.inf

    def drawn(self) -> Drawn:
        """As of now."""
        with self._lock:
            return Drawn(self._aircraft, tuple(p for _, p in self._path), tuple(self._rays), self._fence)

    def begin(self) -> None:
        """A flight begins: the last one's lines go."""
        with self._lock:
            self._path.clear()
            self._rays.clear()
            self._fence, self._ray_s = (), -math.inf

    def look(self, drone: Drone, camera: Camera, now_s: float, *, flying: bool) -> None:
        """Take in where the aircraft is; its way is kept while an order flies it."""
        origin, pose = drone.origin, drone.pose_at(now_s - POSE_AGE_S)
        if origin is None or pose is None:
            return
        place = np.asarray(pose.position_enu_m)
        here = _position(place, origin)
        lens, heading = camera.intrinsics, drone.telemetry().heading_rad
        forward, right, _ = camera.mounting.body_from_camera.apply([0.0, 0.0, 1.0]).tolist()
        looks = None if heading is None else heading + math.atan2(right, forward)
        hfov = 2.0 * math.atan(lens.width_px / (2.0 * lens.fx))
        with self._lock:
            self._aircraft = Aircraft(here, heading, looks, hfov)
            if flying and (not self._path or np.linalg.norm(self._path[-1][0] - place) > _PATH_STEP_M):
                self._path.append((place, here))

    def sight(self, frame: Frame, track: Track, drone: Drone, camera: Camera) -> None:
        """A ray to the target, some three a second."""
        if track.state != "tracking" or frame.t_s - self._ray_s < _RAY_PERIOD_S:
            return
        pose, origin = drone.pose_at(frame.t_s), drone.origin
        if pose is None or origin is None:
            return
        self._ray_s = frame.t_s
        ray = ray_of(track.pixel, pose, camera, origin)
        with self._lock:
            self._rays.append(ray)

    def measured(self, flight: FlightSightings, camera: Camera) -> None:
        """The rays that the answer was made from, in place of those drawn on the way: with the poses that count."""
        model, origin = CameraModel(camera.intrinsics), flight.origin
        step = max(1, len(flight.sightings) // _MEASURED_RAYS)
        rays = []
        for seen in flight.sightings[::step]:
            turned = Rotation.from_quat(seen.world_from_camera_wxyz, scalar_first=True)
            east, north, _ = turned.apply(model.ray(np.array(seen.pixel))).tolist()
            start = np.array(seen.position_enu_m)
            end = start + RAY_M * np.array([east, north, 0.0]) / max(math.hypot(east, north), 1e-6)
            rays.append((_position(start, origin), _position(end, origin)))
        with self._lock:
            self._rays.clear()
            self._rays.extend(rays)

    def fence_around(self, drone: Drone, radius_m: float, now_s: float) -> None:
        """The flight may go this far from here."""
        origin, pose = drone.origin, drone.pose_at(now_s - POSE_AGE_S)
        if origin is None or pose is None:
            return
        turn = np.linspace(0.0, 2.0 * math.pi, _FENCE_POINTS + 1)
        centre = np.asarray(pose.position_enu_m)
        ring = [centre + radius_m * np.array([math.cos(a), math.sin(a), 0.0]) for a in turn]
        fence = tuple(_position(point, origin) for point in ring)
        with self._lock:
            self._fence = fence


def ray_of(pixel: tuple[float, float], pose: Pose, camera: Camera, origin: GeodeticOrigin) -> tuple[Position, Position]:
    """The line of sight of a pixel on the map, from the camera on."""
    azimuth, start = azimuth_of(pixel, pose, camera), camera_position(pose, camera)
    end = start + RAY_M * np.array([math.sin(azimuth), math.cos(azimuth), 0.0])
    return _position(start, origin), _position(end, origin)


def _position(enu_m: Vector, origin: GeodeticOrigin) -> Position:
    place = enu_to_geodetic(enu_m, origin)
    return round(place.lon_deg, 8), round(place.lat_deg, 8)
