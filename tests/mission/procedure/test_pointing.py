"""What the tracker is told of the camera's own motion."""

from __future__ import annotations

import numpy as np
import pytest

from mission.camera.model import CameraModel
from mission.planning.aim import PRESUMED_HEIGHT_M
from mission.pose.buffer import Pose, world_from_body
from mission.procedure.pointing import Pointing
from mission.records import Box, Frame, Vector
from mission.sighting import camera_position, world_from_camera
from mission.track import Track
from tests.support.fakes import CAMERA, FakeDrone

IMAGE = np.zeros((480, 640, 3), np.uint8)
PERSON = np.array([0.5, 6.0, 0.5 * PRESUMED_HEIGHT_M])
FRAME_S = 0.05


class Told:
    """A tracker that sees the person where they are, and notes what it is told."""

    def __init__(self) -> None:
        self.seen: tuple[float, float] = (0.0, 0.0)
        self.height_px = 0.0
        self.shifts: list[Vector] = []

    def start(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> None: ...

    def take_back(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> bool:
        return False

    def update(
        self,
        frame: Frame,
        shift_px: tuple[float, float] = (0.0, 0.0),
        roll_rad: float = 0.0,
        passed: tuple[float, float] = (0.0, 0.0),
    ) -> Track:
        self.shifts.append(np.array(shift_px) + self.height_px * np.array(passed))
        box = Box(self.seen[0], self.seen[1], 1.0, self.height_px)
        return Track(frame.index, frame.t_s, "tracking", box, self.seen, 1.0, self.height_px, 0.03, 1.0)


class Poses(FakeDrone):
    """Says where it is."""

    def at(self, pose: Pose) -> None:
        self._poses = [pose]


def pose(t_s: float, place: Vector, yaw_rad: float, velocity: Vector) -> Pose:
    attitude = world_from_body(0.0, 0.0, yaw_rad)
    return Pose(t_s, place, velocity, attitude, np.eye(3), np.eye(3))


def followed(velocity: Vector, yaw_rate_rad_s: float, jump_m: Vector | None = None) -> tuple[Vector, Vector]:
    """What the tracker was told in the second frame, and how the person moved in the picture. Shapes (2,)."""
    drone, tracker = Poses(), Told()
    pointing = Pointing(drone, CAMERA, tracker, cautious=False)
    pixels = []
    for k in range(2):
        t_s = k * FRAME_S
        true = pose(t_s, np.array([0.0, 0.0, 1.5]) + velocity * t_s, yaw_rate_rad_s * t_s, velocity)
        moved = true.position_enu_m + (np.zeros(3) if jump_m is None or k == 0 else jump_m)
        drone.at(pose(t_s, moved, yaw_rate_rad_s * t_s, velocity))
        seen = world_from_camera(true, CAMERA).inv().apply(PERSON - camera_position(true, CAMERA))
        x, y = CameraModel(CAMERA.intrinsics).project(seen).tolist()
        pixels.append(np.array([x, y]))
        tracker.seen, tracker.height_px = (x, y), CAMERA.intrinsics.fy * PRESUMED_HEIGHT_M / float(seen[2])
        pointing.follow(Frame(IMAGE, t_s, k))
    return tracker.shifts[1], pixels[1] - pixels[0]


@pytest.mark.parametrize(
    ("velocity", "yaw_rate_rad_s"),
    [
        ((1.5, 0.0, 0.0), 0.0),
        ((0.0, 5.0, 0.0), 0.0),
        ((0.0, 0.0, 1.0), 0.0),
        ((0.0, 0.0, 0.0), 0.4),
        ((1.5, 0.3, 0.2), 0.3),
    ],
    ids=["sideways", "ahead", "up", "turning", "all"],
)
def test_the_camera_s_own_motion_explains_how_somebody_who_stands_moves_in_the_picture(
    velocity: tuple[float, float, float], yaw_rate_rad_s: float
) -> None:
    told, moved = followed(np.array(velocity), yaw_rate_rad_s)
    assert told == pytest.approx(moved, abs=0.7)
    assert float(np.hypot(*moved)) > 1.0, "there is something to explain"


def test_a_reported_position_that_jumps_is_no_motion() -> None:
    velocity = np.array([1.0, 0.0, 0.0])
    told, _ = followed(velocity, 0.0, jump_m=np.array([2.0, -1.0, 0.0]))
    assert told == pytest.approx(followed(velocity, 0.0)[0], abs=0.1)
