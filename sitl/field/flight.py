"""One field flight, rendered in lockstep with the mission's own eyes: pointing, time offset, tracking, background."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final, cast

import numpy as np

from mission.camera import Camera
from mission.errors import DetectionError
from mission.planning.pattern import lateral_path
from mission.pose.buffer import Pose
from mission.procedure.centring import GIMBAL_WIGGLES_RAD, WIGGLE_S
from mission.procedure.flight_record import PICTURES, FlightRecord
from mission.procedure.pointing import Pointing, TargetTracker
from mission.records import Box, Frame, NoiseModel, Vector
from mission.sighting import level_mounting
from mission.timing.flight_offset import UNKNOWN_OFFSET_S, FlightOffset, offset_uncertain
from mission.timing.time_offset import TimeOffset, TimeOffsetMeter
from mission.vehicle.drone import Drone
from mission.vehicle.mavlink.pose_quality import attitude_covariance, noise_model, position_covariance
from sitl.camera.renderer import CameraPose, Renderer, matrix_from_wxyz
from sitl.camera.view import PersonView, view_person
from sitl.evaluation.rendered.aircraft import SETTLE_S, TURN_S, Flown, fly
from sitl.evaluation.rendered.case import Case
from sitl.evaluation.rendered.codec import H264
from sitl.evaluation.rendered.flight import told_state
from sitl.field.aircraft import PointedGimbal
from sitl.field.case import FieldCase
from sitl.people.world import World
from sitl.scenario.scene import Light, Person
from sitl.scenario.schema import CameraSettings, Scenario, parse_scenario
from sitl.simulation.processes import camera_of

BEGIN_S: Final = -5.2
"""The first picture; the pattern begins at 0."""
_WIGGLE_FROM_S: Final = -3.6
_BESIDE_RAD: Final = math.radians(4.0)
"""How far the lens looks beside the person at first, in azimuth and elevation (standard deviation)."""
_WALKED_S: Final = 6.0
"""People move for this long before the pattern begins."""
_BOX_ERROR: Final = 0.05
"""Of an operator's box, relative to its size."""
_EXPOSURE_MS, _READOUT_MS, _FPS = 4.0, 16.0, 12.0


@dataclass(frozen=True, slots=True)
class _Watched:
    """What `Pointing` asks of a drone: where it was, and its gimbal. It takes no orders."""

    flight: FieldFlight
    gimbal: PointedGimbal

    def pose_at(self, t_s: float) -> Pose | None:
        return self.flight.pose_at(t_s, hold_s=0.25)

    def aim(self, heading_rad: float) -> None:
        """The nose keeps its heading."""


@dataclass(slots=True)
class FieldFollowed:
    """What the mission has at the end of the pattern."""

    record: FlightRecord
    offset: TimeOffset | None = None
    centred: list[float] = field(default_factory=list)
    """Of each frame of the pattern, how far the person truly was off the middle: the larger of the shares of the half
    width and the half height."""
    heights_px: list[float] = field(default_factory=list)
    tracked: int = 0

    def pose_noise(self, stated: NoiseModel) -> NoiseModel:
        """As `mission.procedure.locate` takes it."""
        return offset_uncertain(stated, UNKNOWN_OFFSET_S if self.offset is None else self.offset.sigma_s)


class FieldFlight:
    """Turns the gimbal to a person and flies the pattern; the pattern begins at 0 s of the telemetry's clock.

    Args:
        case: what is flown.
    """

    def __init__(self, case: FieldCase) -> None:
        self.case = case
        self.scenario = _scenario(case)
        self.world = World(self.scenario)
        self.camera: Camera = replace(camera_of(self.scenario), gimbal="mavlink", gimbal_age_s=0.05)
        self.origin = self.scenario.home.origin
        self._vehicle = told_state(case.noise, case.seed)
        east, north, _ = self.target(0.0).tolist()
        azimuth = math.atan2(east, north)
        path = lateral_path(case.pattern, azimuth)
        self.duration_s = path.duration_s
        covariance = position_covariance(self._vehicle), attitude_covariance(self._vehicle)
        flown_case = Case(seed=case.seed, noise=case.noise)
        nose = azimuth + float(np.random.default_rng([case.seed, 21]).uniform(-0.4, 0.4))
        self._flown: Flown = fly(
            flown_case, path, azimuth, case.height_m, self.origin, lambda _t, _place: nose, covariance
        )
        rng = np.random.default_rng([case.seed, 22])
        depression = math.atan2(case.height_m - 0.9, case.distance_m)
        look = azimuth + _BESIDE_RAD * float(rng.standard_normal()), -depression + 0.5 * _BESIDE_RAD
        self.gimbal = PointedGimbal(case, self._flown, -(SETTLE_S + TURN_S) + 0.01, look)
        self.gimbal.advance(BEGIN_S - 0.1)

    @property
    def noise(self) -> NoiseModel:
        """What the mission takes the lens's reported pose to be."""
        return self.gimbal.listener.noise(noise_model(self._vehicle), self.duration_s)

    def pose_at(self, t_s: float, *, hold_s: float = 0.0) -> Pose | None:
        """The reported pose with the gimbal's, as `Drone.pose_at`."""
        pose, turned = self._flown.pose_at(t_s), self.gimbal.at(t_s, hold_s=hold_s)
        return None if pose is None or turned is None else replace(pose, world_from_gimbal_wxyz=turned)

    def true_camera(self, t_s: float) -> CameraPose:
        """Of the lens."""
        pose = self._flown.true_pose(t_s)
        arm = matrix_from_wxyz(pose.world_from_body_wxyz) @ np.array(self.scenario.camera.position_body_m)
        lens = matrix_from_wxyz(self.gimbal.true_at(t_s)) @ _GIMBAL_FROM_CAMERA
        return CameraPose(pose.position_enu_m + arm, lens)

    def target(self, t_s: float) -> Vector:
        """(3,): centroid of the person's surface, ENU."""
        return self.world.person_centroid(0, t_s, -_WALKED_S)

    def seen(self, t_s: float) -> PersonView | None:
        """Where the person truly is in the picture."""
        return view_person(self.world, 0, self.true_camera(t_s), self.camera.intrinsics, t_s, -_WALKED_S)

    def frames(self) -> Iterator[tuple[Frame, float]]:
        """The frames one by one, each with its true time; the gimbal moves between them.

        Raises:
            VideoError: there is no software renderer or no H.264.
        """
        renderer, codec = Renderer(self.scenario), H264(self.scenario.camera)
        first, last = math.ceil(BEGIN_S * _FPS), math.floor(self.duration_s * _FPS)
        try:
            for k in range(first, last + 1):
                t_s = k / _FPS
                self.gimbal.advance(t_s + 1e-3 * (_EXPOSURE_MS + _READOUT_MS))
                image = codec.through(renderer.expose(self.true_camera, t_s, -_WALKED_S))
                yield Frame(image, t_s + self.case.offset_s, k - first), t_s
        finally:
            renderer.close()
        self.gimbal.advance(self.duration_s + 0.5)


def follow(flight: FieldFlight, tracker: TargetTracker) -> FieldFollowed:
    """Track the person from an operator's box, measure the time offset on a wiggle of the gimbal, follow the pattern.

    Raises:
        DetectionError: the person was lost before the pattern began.
    """
    record = FlightRecord(f"field-{flight.case.seed}", flight.camera, interval_s=flight.duration_s / PICTURES)
    followed = FieldFollowed(record)
    pointing = Pointing(cast(Drone, _Watched(flight, flight.gimbal)), flight.camera, tracker, cautious=True)
    meter = TimeOffsetMeter(flight.camera, mounting=level_mounting(flight.pose_at(BEGIN_S - 0.4), flight.camera))
    offset = FlightOffset(meter)
    started = False
    for frame, t_s in flight.frames():
        view = flight.seen(t_s)
        if not started:
            meter.add(frame)
            if view is None or not view.in_picture:
                raise DetectionError("the person is not in the picture at first")
            tracker.start(frame, _boxed(view.box, flight.case.seed))
            started = True
            continue
        now_s = frame.t_s
        if t_s < 0.0:
            track = pointing.follow(frame, meter.add(frame))
            if track.state == "lost":
                raise DetectionError("the person was lost before the pattern began")
            pointing.steer(now_s, _wiggle(t_s))
            continue
        if offset.found is None and followed.offset is None and not followed.centred:
            offset.found = followed.offset = meter.measure(flight.pose_at)
            pointing.trust(0.0 if offset.found is None else offset.found.offset_s)
        track = pointing.follow(frame)
        record.add(frame, track, pointing.roll_rad)
        offset.add(frame)
        followed.tracked += track.state == "tracking"
        lens = flight.camera.intrinsics
        if view is None:
            followed.centred.append(math.inf)
        else:
            x, y = abs(view.pixel[0] - lens.cx), abs(view.pixel[1] - lens.cy)
            followed.centred.append(max(2.0 * x / lens.width_px, 2.0 * y / lens.height_px))
            followed.heights_px.append(view.height_px)
        if track.state == "lost":
            break
        pointing.steer(now_s)
    offset.measure_again(flight.pose_at)
    followed.offset = offset.found
    return followed


def _wiggle(t_s: float) -> float:
    phase = (t_s - _WIGGLE_FROM_S) / WIGGLE_S
    return GIMBAL_WIGGLES_RAD[0] * math.sin(2.0 * math.pi * phase) if 0.0 < phase < 1.0 else 0.0


def _boxed(box: Box, seed: int) -> Box:
    """As an operator draws it."""
    a, b, c, d = (_BOX_ERROR * np.random.default_rng([seed, 23]).standard_normal(4)).tolist()
    width, height = box.width_px, box.height_px
    return Box(box.left_px + a * width, box.top_px + b * height, width * (1.0 + abs(c)), height * (1.0 + abs(d)))


_GIMBAL_FROM_CAMERA: Final = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def _scenario(case: FieldCase) -> Scenario:
    rng = np.random.default_rng([case.seed, 3])
    bearing_deg = float(rng.uniform(-180.0, 180.0))
    base = parse_scenario(f'name = "field"\nseed = {case.seed % 2**31}\n')
    camera = CameraSettings.model_validate(
        {
            "width_px": case.size_px[0],
            "height_px": case.size_px[1],
            "horizontal_fov_deg": case.hfov_deg,
            "position_body_m": (0.10, 0.0, 0.05),
            "fps": _FPS,
            "exposure_ms": _EXPOSURE_MS,
            "readout_ms": _READOUT_MS,
            "renderings": 1,
            "bitrate_kbit_s": 6000,
        }
    )
    person = Person(
        distance_m=case.distance_m,
        bearing_deg=bearing_deg,
        speed_m_s=0.0,
        walks=case.walks,
        walk_seed=case.seed % 2**31,
        walk_heading_deg=case.facing_deg,
        height_m=float(rng.uniform(1.55, 1.9)),
    )
    light = Light(brightness=float(rng.uniform(0.7, 1.2)), sun_azimuth_deg=float(rng.uniform(-180.0, 180.0)))
    return base.model_copy(update={"camera": camera, "people": (person,), "light": light})
