"""A rendered flight: its frames as the mission gets them, its reported poses, and the truth of both."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mission.camera import Camera
from mission.planning.pattern import lateral_path
from mission.pose.buffer import Pose
from mission.records import Frame, GeodeticOrigin, NoiseModel, Vector
from mission.vehicle.mavlink.pose_quality import attitude_covariance, noise_model, position_covariance
from mission.vehicle.state.vehicle_state import VehicleState
from sitl.autopilot.estimate_errors import NoiseName, preset_of
from sitl.autopilot.rotation import Vec
from sitl.camera.airframe import body_from_camera
from sitl.camera.renderer import CameraPose, Renderer, matrix_from_wxyz
from sitl.camera.view import PersonView, view_person
from sitl.evaluation.rendered.aircraft import TURN_S, Flown, fly
from sitl.evaluation.rendered.case import Case
from sitl.evaluation.rendered.codec import H264
from sitl.evaluation.rendered.scenes import TAKE_OFF_HEIGHT_M, WALKED_S, scenario, surroundings
from sitl.people.world import World
from sitl.simulation.processes import camera_of

Stage = Literal["turn", "pattern"]
_NEAREST_M = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One frame of a flight with what is true in it."""

    frame: Frame
    """As decoded; its time is the video's: the telemetry's plus the case's offset."""
    capture_s: float
    """When the middle row was exposed, on the telemetry's clock."""
    stage: Stage
    camera: CameraPose
    """True, at the capture."""
    target: PersonView | None
    """Where the person truly is in the picture; None when partly behind the camera."""


class RenderedFlight:
    """Turns to a person and flies the pattern; the pattern begins at 0 s of the telemetry's clock.

    Args:
        case: what is flown. Nothing is rendered before `moments` is iterated.
    """

    def __init__(self, case: Case) -> None:
        self.case = case
        self.scenario = scenario(case)
        self.world = World(self.scenario)
        self.camera: Camera = camera_of(self.scenario)
        """As a good calibration would describe it."""
        self.origin: GeodeticOrigin = self.scenario.home.origin
        vehicle = told_state(case.noise, case.seed)
        self.noise: NoiseModel = noise_model(vehicle)
        """What the mission takes the reported pose to be."""
        east, north, _ = self.world.person_centroid(0, 0.0, -WALKED_S).tolist()
        azimuth = math.atan2(east, north)
        path = lateral_path(case.flown, azimuth)
        self.duration_s = path.duration_s
        """Of the pattern."""
        covariance = position_covariance(vehicle), attitude_covariance(vehicle)
        self._flown: Flown = fly(case, path, azimuth, TAKE_OFF_HEIGHT_M, self.origin, self._bearing, covariance)
        self._body_from_camera = body_from_camera(math.radians(self.scenario.camera.tilt_down_deg))

    def pose_at(self, t_s: float) -> Pose | None:
        """The reported pose of the aircraft, as `Drone.pose_at`; None where nothing was reported."""
        return self._flown.pose_at(t_s)

    def true_pose(self, t_s: float) -> Pose:
        """The true pose of the aircraft at a time of the telemetry's clock."""
        return self._flown.true_pose(t_s)

    def true_camera(self, t_s: float) -> CameraPose:
        """The true pose of the camera at a time of the telemetry's clock."""
        pose = self.true_pose(t_s)
        world_from_body = matrix_from_wxyz(pose.world_from_body_wxyz)
        arm = world_from_body @ np.array(self.scenario.camera.position_body_m)
        return CameraPose(pose.position_enu_m + arm, world_from_body @ self._body_from_camera)

    def target(self, t_s: float) -> Vector:
        """(3,): centroid of the person's surface, ENU: what an estimate is scored against."""
        return self.world.person_centroid(0, t_s, -WALKED_S)

    def target_velocity(self, t_s: float) -> Vector:
        """(3,): of the person's walk, ENU."""
        return self.world.person_velocity(0, t_s, -WALKED_S)

    def moments(self, *, turn: bool = True) -> Iterator[Moment]:
        """The frames, rendered, encoded and decoded one by one.

        Args:
            turn: begin with the turn to the person, and not with the pattern.

        Raises:
            VideoError: there is no software renderer or no H.264.
        """
        settings = self.scenario.camera
        renderer = Renderer(self.scenario, extra=surroundings(self.case, self.scenario))
        codec = H264(settings)
        first = -math.floor(TURN_S * settings.fps) if turn else 0
        try:
            for k in range(first, math.floor(self.duration_s * settings.fps) + 1):
                t_s = k / settings.fps
                image = codec.through(renderer.expose(self.true_camera, t_s, -WALKED_S))
                pose = self.true_camera(t_s)
                seen = view_person(self.world, 0, pose, self.camera.intrinsics, t_s, -WALKED_S)
                frame = Frame(image, t_s + self.case.offset_s, k - first)
                yield Moment(frame, t_s, "turn" if k < 0 else "pattern", pose, seen)
        finally:
            renderer.close()

    def _bearing(self, t_s: float, place: Vec) -> float:
        east, north, _ = self.target(t_s).tolist()
        return math.atan2(east - place[0], north - place[1])


def flights(cases: Iterable[Case]) -> Iterator[RenderedFlight]:
    """One flight after the other; only the one that is looked at is kept."""
    for case in cases:
        yield RenderedFlight(case)


def told_state(noise: NoiseName, seed: int) -> VehicleState:
    """What the mission has heard from an autopilot about the quality of its position."""
    state = VehicleState()
    state.gps_accuracy_m = preset_of(noise, seed).gnss_accuracy_m[0]
    return state
