"""A flight without wires: an aircraft, a camera, a person and a clock that only move when the video is read."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from mission.camera import Camera, Mounting
from mission.camera.model import CameraModel
from mission.pose.buffer import Pose, PoseAt
from mission.records import Box, CameraIntrinsics, Detection, Frame, GeodeticOrigin, Image, NoiseModel, Vector
from mission.sighting import camera_position, world_from_camera
from mission.track import Track
from mission.vehicle.drone import (
    Bounds,
    CameraPointer,
    Capabilities,
    DroneEvent,
    OrderState,
    Path,
    Telemetry,
)
from mission.video.stats import VideoState, VideoStats

FRAME_S = 0.05
ORIGIN = GeodeticOrigin(37.2276, 126.8405, 30.0)
CAMERA = Camera(CameraIntrinsics(640, 480, 516.5, 516.5, 320.0, 240.0), Mounting.tilted(0.0), calibrated=True)
PERSON_HEIGHT_M = 1.75
ENU_FROM_NED = Rotation.from_matrix([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass
class FakeOrder:
    kind: str
    state: OrderState = OrderState.FLYING
    reason: str = ""
    started_s: float | None = None
    ended_s: float | None = None


@dataclass(frozen=True)
class PosesUntil:
    """What is told of the past by now."""

    t_s: float
    pose_at: PoseAt

    def at(self, t_s: float) -> Pose | None:
        return None if t_s > self.t_s + 1e-6 else self.pose_at(t_s)


@dataclass
class FakeDrone:
    """Goes where it is told, exactly, at a bounded yaw rate. Ends its order when `seize` is called."""

    t_s: float = 100.0
    position: Vector = field(default_factory=lambda: np.array([0.0, 0.0, 1.5]))
    heading: float = 0.0
    name: str = "fake"
    origin: GeodeticOrigin | None = ORIGIN
    connected: bool = True
    calls: list[str] = field(default_factory=list)
    order: FakeOrder | None = None
    refuse: str = ""
    capabilities: Capabilities = field(default_factory=lambda: Capabilities(True, True, 5.0))
    gimbal: CameraPointer | None = None

    def __post_init__(self) -> None:
        self._aim = self.heading
        self.packet_loss: float | None = None
        self._path: tuple[Path, float, Vector] | None = None
        self._poses: list[Pose] = []
        self._events: list[DroneEvent] = []
        self._remember()

    def connect(self, timeout_s: float) -> None: ...

    def close(self) -> None:
        self.calls.append("close")

    def telemetry(self) -> Telemetry:
        reported = (self.t_s, self.connected, True, True, "OFFBOARD", 0.9, 1.5, self.heading, True, True, 50.0, 20.0)
        return Telemetry(*reported, packet_loss=self.packet_loss)

    def pose_at(self, t_s: float) -> Pose | None:
        return next((pose for pose in reversed(self._poses) if abs(pose.t_s - t_s) < 1e-6), None)

    def poses(self) -> PoseAt:
        known = PosesUntil(self.t_s, self.pose_at)
        return known.at

    def keep_alive(self) -> None: ...

    def noise(self) -> NoiseModel:
        return NoiseModel()

    def pose_note(self) -> str:
        return ""

    def begin(self, bounds: Bounds) -> None:
        self.calls.append("begin")

    def take_off(self, height_m: float) -> FakeOrder:
        return self._ordered("take-off")

    def hover(self) -> FakeOrder:
        return self._ordered("hover")

    def turn_to(self, heading_rad: float) -> FakeOrder:
        self._aim = heading_rad
        return self._ordered("turn")

    def fly(self, path: Path) -> FakeOrder:
        order = self._ordered("path")
        self._path = (path, self.t_s, self.position.copy())
        return order

    def aim(self, heading_rad: float) -> None:
        self._aim = heading_rad

    def hold(self) -> FakeOrder:
        self._path = None
        return self._ordered("hold")

    def land(self) -> FakeOrder:
        return self._ordered("land")

    def events(self) -> list[DroneEvent]:
        events, self._events = self._events, []
        return events

    def seize(self, kind: str = "pilot", text: str = "the pilot chose LOITER") -> None:
        self._events.append(DroneEvent(self.t_s, kind, text))  # type: ignore[arg-type]  # tests name the kinds

    def advance(self, dt: float) -> None:
        self.t_s += dt
        turn = (self._aim - self.heading + math.pi) % (2 * math.pi) - math.pi
        self.heading += max(-1.5 * dt, min(1.5 * dt, turn))
        if self._path is not None:
            path, start, at = self._path
            t = min(self.t_s - start, path.duration_s)
            knots = [knot.t_s for knot in path.knots]
            self.position = at + np.array(
                [np.interp(t, knots, [knot.offset_enu_m[axis] for knot in path.knots]) for axis in range(3)]
            )
        if self.order is not None and self.order.state is OrderState.FLYING:
            busy = self._path is not None and self.t_s - self._path[1] < self._path[0].duration_s
            if not busy:
                self.order.state = OrderState.DONE
        self._remember()

    def _ordered(self, kind: str) -> FakeOrder:
        self.calls.append(kind)
        if self.refuse:
            self.order = FakeOrder(kind, OrderState.REFUSED, self.refuse)
        else:
            self.order = FakeOrder(kind, started_s=self.t_s)
        return self.order

    def _remember(self) -> None:
        world_from_body = ENU_FROM_NED * Rotation.from_euler("Z", self.heading)
        self._poses.append(
            Pose(
                self.t_s,
                self.position.copy(),
                np.zeros(3),
                world_from_body.as_quat(scalar_first=True),
                np.eye(3) * 1e-4,
                np.eye(3) * 1e-6,
            )
        )


@dataclass
class Walker:
    """A person with a constant velocity."""

    position: Vector
    velocity: Vector
    since_s: float = 100.0

    def at(self, t_s: float) -> Vector:
        return self.position + self.velocity * (t_s - self.since_s)


@dataclass
class FakeVideo:
    """A frame every 50 ms, at which time moves; blank pictures."""

    drone: FakeDrone
    stop_at_s: float = math.inf
    index: int = 0

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        self.drone.advance(FRAME_S)
        if self.drone.t_s >= self.stop_at_s:
            return None
        self.index += 1
        return Frame(BLANK, self.drone.t_s, self.index)

    def stats(self) -> VideoStats:
        return VideoStats(VideoState.PLAYING, 20.0, self.index, 0, 0, 0, 0.0, 0.0, "")

    def close(self) -> None: ...


BLANK: Image = np.zeros((480, 640, 3), dtype=np.uint8)


@dataclass
class Sight:
    """Where the walker appears in the picture; a detector and a tracker that see it perfectly."""

    drone: FakeDrone
    walker: Walker
    name: str = "sight"
    absent: bool = False
    gone_from_s: float = math.inf

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        seen = self._seen(self.drone.t_s)
        return [] if self.absent or seen is None else [Detection(seen[0], 1.0)]

    def start(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> None: ...

    def take_back(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> bool:
        self.gone_from_s = math.inf
        return True

    def update(
        self,
        frame: Frame,
        shift_px: tuple[float, float] = (0.0, 0.0),
        roll_rad: float = 0.0,
        passed: tuple[float, float] = (0.0, 0.0),
    ) -> Track:
        seen = self._seen(frame.t_s)
        if seen is None or frame.t_s >= self.gone_from_s:
            nowhere = Box(0.0, 0.0, 1.0, 1.0)
            return Track(frame.index, frame.t_s, "lost", nowhere, (0.0, 0.0), 1.0, None, None, 0.0)
        box, pixel = seen
        return Track(frame.index, frame.t_s, "tracking", box, pixel, 1.0, box.height_px, 0.03, 1.0)

    def _seen(self, t_s: float) -> tuple[Box, tuple[float, float]] | None:
        pose = self.drone.pose_at(t_s)
        assert pose is not None
        camera = world_from_camera(pose, CAMERA).inv().apply(self.walker.at(t_s) - camera_position(pose, CAMERA))
        if camera[2] < 0.3:
            return None
        x, y = CameraModel(CAMERA.intrinsics).project(camera).tolist()
        height = 516.5 * PERSON_HEIGHT_M / float(camera[2])
        if not 0.0 <= x <= 640.0:
            return None
        return Box(x - height / 5, y - height / 2, height / 2.5, height), (x, y)
