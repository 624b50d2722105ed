"""Keeping the camera on the target: the tracker, the aim, and the heading that follows from both."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from mission.camera.camera import Camera
from mission.camera.model import CameraModel
from mission.planning.aim import BANDWIDTH_S, LOOK_AHEAD_S, PRESUMED_HEIGHT_M, Aim, presumed_range, wrapped
from mission.pose.buffer import Pose, heading
from mission.records import Box, Frame, Vector
from mission.sighting import azimuth_of, camera_position, roll_of, rotation_shift, world_from_camera
from mission.timing.background_rotation import Turn
from mission.track import Track
from mission.vehicle.drone import Drone

EXPECTED_RAD = math.radians(12.0)
"""How far from its aim a target may come back: what it walked meanwhile, and what the aim lags."""
GIMBAL_AHEAD_S = 0.1
"""How long a gimbal takes to follow new angles, about."""
FACED_RAD = math.radians(30.0)
"""A gimbal turns so far at least, from the nose."""
TRIM_PER_S = 0.4
"""Of what the target is off the middle, how much is added to the ordered angles in a second."""
LARGEST_TRIM_RAD = math.radians(40.0)
LIKE_SIZE = 1.8
"""Ratio of apparent heights that may be the same person's."""


class TargetTracker(Protocol):
    """Keeps to one person from frame to frame (`mission.track.Tracker`)."""

    def start(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> None:
        """The target is in this box."""
        ...

    def take_back(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> bool:
        """Follow the target again if it is who is in this box, after it was lost."""
        ...

    def update(
        self,
        frame: Frame,
        shift_px: tuple[float, float] = (0.0, 0.0),
        roll_rad: float = 0.0,
        passed: tuple[float, float] = (0.0, 0.0),
    ) -> Track:
        """Where it is in the next frame; the camera's rotation moved it by `shift_px`, its travel by `passed` heights.

        Both are image motion since the last frame that the camera's own motion explains.
        """
        ...


class Pointing:
    """Follows the target in the picture and tells the aircraft where to point its nose.

    Args:
        drone: the aircraft.
        camera: its camera.
        tracker: started on the target.
        cautious: whether the time of the video against the telemetry is not known yet.
    """

    def __init__(self, drone: Drone, camera: Camera, tracker: TargetTracker, *, cautious: bool) -> None:
        self._drone = drone
        self._camera = camera
        self._tracker = tracker
        self._aim = Aim(cautious=cautious)
        self._pose: Pose | None = None
        self._pixel = (camera.intrinsics.cx, camera.intrinsics.cy)
        self._height_px: float | None = None
        self._gimbal = drone.gimbal if camera.gimbal != "none" else None
        self._elevation_rad = 0.0
        self._observed_s = 0.0
        self._trim_rad = [0.0, 0.0]
        self.offset_s = 0.0
        """How much later than telemetry the video's clock runs."""
        self.roll_rad = 0.0
        """The camera's roll about its optical axis at the last frame, as reported."""

    @property
    def on_gimbal(self) -> bool:
        """Whether the camera is on a gimbal."""
        return self._gimbal is not None

    def follow(self, frame: Frame, turn: Turn | None = None) -> Track:
        """Track the target into a frame and take its bearing into the aim.

        Args:
            frame: the newest.
            turn: how the camera turned since the last frame, where the picture tells; the telemetry tells it else.
        """
        pose = self._drone.pose_at(frame.t_s - self.offset_s)
        self.roll_rad = 0.0 if pose is None else roll_of(pose, self._camera)
        track = self._tracker.update(frame, self._shift(pose, turn), self.roll_rad, self._passed(pose))
        if track.state == "tracking":
            self._pixel = track.pixel
        if pose is not None:
            self._pose = pose
            if track.state == "tracking":
                self._observe(track, pose)
        return track

    def pass_over(self, frame: Frame) -> None:
        """Take in where the camera was at a frame in which the target is not followed."""
        pose = self._drone.pose_at(frame.t_s - self.offset_s)
        if pose is not None:
            self._pose, self.roll_rad = pose, roll_of(pose, self._camera)

    def expects(self, box: Box) -> bool:
        """Whether somebody in this box of the last frame is where the target should be, and of its size."""
        if self._pose is None or self._height_px is None:
            return False
        expected = self.azimuth(self._pose.t_s)
        larger = box.height_px / self._height_px
        if expected is None or not 1.0 / LIKE_SIZE < larger < LIKE_SIZE:
            return False
        return abs(wrapped(azimuth_of(box.centre_px, self._pose, self._camera) - expected)) < EXPECTED_RAD

    def resume(self, box: Box) -> None:
        """The target is in this box of the last frame."""
        self._pixel = box.centre_px

    def _observe(self, track: Track, pose: Pose) -> None:
        if self._camera.gimbal != "none":
            self._observe_gimbal(track, pose)
        self._height_px = track.box.height_px
        focal_px = self._camera.intrinsics.fy
        if self._aim.point_m is None:
            self._aim.range_m = presumed_range(track.height_px or track.box.height_px, focal_px)
        azimuth = azimuth_of(track.pixel, pose, self._camera)
        away_m = None if track.height_px is None else presumed_range(track.height_px, focal_px)
        self._aim.observe(azimuth, camera_position(pose, self._camera), pose.t_s, away_m)

    def trust(self, offset_s: float) -> None:
        """The video's time is known from here on: follow fast, and lead."""
        self.offset_s = offset_s
        self._aim = self._aim.trusting()
        if self._pose is not None:  # the pose that was taken for the last frame's is of another time
            self._pose = self._drone.pose_at(self._pose.t_s - offset_s) or self._pose

    def steer(self, now_s: float, beside_rad: float = 0.0) -> None:
        """Order the heading that puts the target in the middle.

        Args:
            now_s: program time.
            beside_rad: point this far beside it, clockwise.
        """
        if self._gimbal is not None:
            self._point(now_s, beside_rad)
            return
        azimuth = self.azimuth(now_s + LOOK_AHEAD_S)
        if azimuth is not None:
            self._drone.aim(wrapped(azimuth + beside_rad - self._camera_azimuth()))

    def _point(self, now_s: float, beside_rad: float) -> None:
        """Turn the gimbal where it is ours; else the nose, which a gimbal that follows it goes along with."""
        azimuth = self.azimuth(now_s + GIMBAL_AHEAD_S)
        if azimuth is None or self._gimbal is None:
            return
        if not self._gimbal.ours:
            self._drone.aim(wrapped(azimuth + beside_rad))
            return
        wanted = wrapped(azimuth + beside_rad)
        self._gimbal.point(wanted + self._trim_rad[0], self._elevation_rad + self._trim_rad[1])

    def face(self, now_s: float) -> None:
        """Turn the nose to the target where the gimbal that we point would come near its stop in yaw."""
        azimuth = self.azimuth(now_s)
        if self._gimbal is None or not self._gimbal.ours or azimuth is None or self._pose is None:
            return
        if abs(wrapped(azimuth - heading(self._pose.world_from_body_wxyz))) > FACED_RAD:
            self._drone.aim(azimuth)

    def _observe_gimbal(self, track: Track, pose: Pose) -> None:
        """Where the target is in elevation, and by how much the lens looks beside where it was told to."""
        ray, axis = (
            world_from_camera(pose, self._camera).apply(one)
            for one in (CameraModel(self._camera.intrinsics).ray(np.array(track.pixel)), [0.0, 0.0, 1.0])
        )
        elevation = math.atan2(ray[2], math.hypot(ray[0], ray[1]))
        span_s = min(0.3, max(0.0, pose.t_s - self._observed_s))
        part = 1.0 if self._observed_s == 0.0 else 1.0 - math.exp(-span_s / BANDWIDTH_S)
        self._elevation_rad += part * (elevation - self._elevation_rad)
        self._observed_s = pose.t_s
        if self._gimbal is None or not self._gimbal.ours:
            return
        # An integral: the gimbal's own idea of north may not be the one that its attitude is told by.
        off = wrapped(math.atan2(ray[0], ray[1]) - math.atan2(axis[0], axis[1]))
        up = elevation - math.asin(max(-1.0, min(1.0, float(axis[2]))))
        for place, error in enumerate((off, up)):
            trimmed = self._trim_rad[place] + TRIM_PER_S * span_s * error
            self._trim_rad[place] = max(-LARGEST_TRIM_RAD, min(LARGEST_TRIM_RAD, trimmed))

    def azimuth(self, t_s: float) -> float | None:
        """The target's azimuth at a time, clockwise from north; None before it was seen with a known pose."""
        place = self.place(t_s)
        return None if place is None else self._aim.azimuth(t_s, place)

    def presumed_range_m(self) -> float:
        """How far away somebody of ordinary size would be; good enough to choose a pattern, never an answer."""
        place = self.place(self._aim.t_s)
        if place is None or self._aim.point_m is None:
            return self._aim.range_m
        return float(np.linalg.norm(self._aim.point_m - place[:2]))

    def off_axis_rad(self) -> float:
        """How far beside the middle of the picture the target was last seen."""
        lens = self._camera.intrinsics
        return math.atan2(self._pixel[0] - lens.cx, lens.fx)

    def place(self, t_s: float) -> Vector | None:
        """Where the camera is at a time soon after the newest pose, ENU, shape (3,); None before the first one."""
        if self._pose is None:
            return None
        return camera_position(self._pose, self._camera) + self._pose.velocity_enu_m_s * (t_s - self._pose.t_s)

    def _passed(self, pose: Pose | None) -> tuple[float, float]:
        """How far the camera's travel moved somebody of ordinary height in the picture, in their own heights."""
        if pose is None or self._pose is None:
            return 0.0, 0.0
        # Not the difference of the positions: they jump where the autopilot's filter is reset.
        travel = 0.5 * (self._pose.velocity_enu_m_s + pose.velocity_enu_m_s) * (pose.t_s - self._pose.t_s)
        right, down, ahead = (world_from_camera(pose, self._camera).inv().apply(travel) / PRESUMED_HEIGHT_M).tolist()
        lens = self._camera.intrinsics
        x, y = (self._pixel[0] - lens.cx) / lens.fx, (self._pixel[1] - lens.cy) / lens.fy
        return x * ahead - right, y * ahead - down

    def _shift(self, pose: Pose | None, turn: Turn | None) -> tuple[float, float]:
        if turn is not None:
            model = CameraModel(self._camera.intrinsics)
            now = Rotation.from_rotvec(turn.rotation_vector).inv().apply(model.ray(np.array(self._pixel)))
            x, y = model.project(now).tolist() if now[2] > 0.1 else self._pixel
            return x - self._pixel[0], y - self._pixel[1]
        if pose is None or self._pose is None:
            return 0.0, 0.0
        return rotation_shift(self._pixel, self._pose, pose, self._camera)

    def _camera_azimuth(self) -> float:
        """Azimuth of the camera's axis relative to the nose of a level aircraft."""
        forward, right, _ = self._camera.mounting.body_from_camera.apply([0.0, 0.0, 1.0])
        return math.atan2(right, forward)
