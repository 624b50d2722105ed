"""The flights of `sidestep calibrate baseline`: the paper's pattern along a wall with markers, out and back, repeated.

The wall's markers say where the camera really was; the aircraft's own poses say where it thinks that it was.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Protocol

import numpy as np

from mission.calibration.baseline import DELAYS_S, HOVER_S, IMAGES, INTERVAL_S, WallRun, travel_of, video_delay
from mission.calibration.wall import WallSight
from mission.camera.camera import Camera
from mission.errors import FlightEnded, LinkError, VideoError
from mission.planning.pattern import legs, paper_path
from mission.pose.buffer import Pose, PoseAt, heading
from mission.procedure.flight_loop import FlightLoop
from mission.records import CameraIntrinsics, Frame, Image, Vector
from mission.vehicle.drone import Bounds, Drone
from mission.video import VideoSource

ORDER_TIMEOUT_S = 15.0
RETURN_M_S = 1.0
POSE_WAIT_S = 2.0
"""Across a gap in what the aircraft tells there is no pose for a moment."""
_POSE_STEP_S = 0.02
_PEAK_SPEED = 1.875
"""Of a minimum-jerk leg over its mean."""
AGAIN = 3
"""Runs in which the video stood still, and which are flown again, at most: a busy computer, a passing interference."""
PATIENCE = 15
"""So often may the video stand still (`VIDEO_LOST_S`) before it is given up where its pictures are not needed."""

_log = logging.getLogger(__name__)


class Wall(Protocol):
    """Tells where the camera was (`mission.calibration.wall.MarkerWall`)."""

    def look(self, image: Image, lens: CameraIntrinsics) -> WallSight | None:
        """From one picture; None when it cannot be told."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class WallFlight:
    """One run: travel at each image, true and reckoned; (images,) m, NaN where it is not known."""

    true_m: Vector
    reckoned_m: Vector


class WallFlights:
    """Flies the runs.

    Args:
        drone: connected and in the air, looking straight at the wall.
        video: its camera's pictures.
        camera: their lens, calibrated.
        wall: the markers.
        aborted: answers True as soon as the operator wants an end.
        clock: the program's clock, seconds.
    """

    def __init__(
        self,
        drone: Drone,
        video: VideoSource,
        camera: Camera,
        wall: Wall,
        aborted: Callable[[], bool],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._drone = drone
        self._camera = camera
        self._wall = wall
        self._loop = FlightLoop(drone, video, aborted, clock, _log.warning)
        self._clock = clock

    def run(self, runs: int, bounds: Bounds, left: bool, told: Callable[[int], None]) -> list[WallFlight]:
        """Fly that many runs, each to the side and back. One in which the video stood still is flown again.

        Args:
            runs: how many.
            bounds: of the flight.
            left: to which side.
            told: called with each run's number when it begins, and when it begins again.

        Raises:
            FlightRefused: the aircraft does not take an order.
            FlightEnded: abort, pilot, or failsafe; or nothing is known of where it is.
            CalibrationError: the wall was not seen at a run's start, or the flight was not along it.
            LinkError, VideoError: the link or the video is gone, or the video stood still in more runs than `AGAIN`.
        """
        try:
            self._drone.begin(bounds)
            self._loop.fly(self._drone.hover())
            for _ in self._loop.until_done(ORDER_TIMEOUT_S):
                pass
            start = self._drone_pose()
            nose = heading(start.world_from_body_wxyz)
            side = np.array([-math.cos(nose), math.sin(nose), 0.0]) * (1.0 if left else -1.0)
            flights: list[WallFlight] = []
            broken = 0
            while len(flights) < runs:
                number = len(flights) + 1
                told(number)
                self._drone.aim(nose)
                try:
                    flights.append(self._out(side, start.position_enu_m))
                except VideoError as error:
                    broken += 1
                    if broken > AGAIN:
                        raise
                    _log.warning("run %d is flown again: %s", number, error.cause)
                    self._loop.fly(self._drone.hover())
                    self._finish(ORDER_TIMEOUT_S)
                self._back(side, start.position_enu_m)
            return flights
        finally:
            self._loop.release_control()

    def _out(self, side: Vector, start_m: Vector) -> WallFlight:
        path = paper_path(side)
        times: list[float] = []
        sights: list[WallSight] = []

        def look(frame: Frame) -> None:
            sight = self._wall.look(frame.image, self._camera.intrinsics)
            if sight is not None and (not times or frame.t_s > times[-1]):
                times.append(frame.t_s)
                sights.append(sight)

        # From before the start on: image 0 lies between two pictures also where they come late.
        for frame in self._loop.frames(HOVER_S):
            look(frame)
        order = self._drone.fly(path)
        self._loop.fly(order)
        for frame in self._loop.until_done(path.duration_s + ORDER_TIMEOUT_S):
            look(frame)
        if order.started_s is None:
            raise LinkError("the aircraft did not say when the pattern began", "Try again.")
        run = WallRun(order.started_s, np.array(times), tuple(sights))
        # Beside the loop: the aircraft holds when the program is silent for half a second.
        return self._loop.meanwhile(partial(_flown, run, self._drone.poses(), start_m, side))

    def _back(self, side: Vector, start_m: Vector) -> None:
        far_m = float((self._drone_pose().position_enu_m - start_m) @ side)
        duration = max(3.0, _PEAK_SPEED * abs(far_m) / RETURN_M_S)
        path = legs(-side, [0.0, far_m], [duration])
        self._loop.fly(self._drone.fly(path))
        self._finish(path.duration_s + ORDER_TIMEOUT_S)

    def _finish(self, timeout_s: float) -> None:
        """Until the order is done and there are pictures; none are needed meanwhile."""
        for _ in self._patiently(lambda: self._loop.until_done(timeout_s)):
            pass

    def _patiently(self, frames: Callable[[], Iterator[Frame]]) -> Iterator[Frame]:
        """Frames of the loop, begun anew where the video stood still.

        Raises:
            VideoError: it does so all the time.
            SidestepError: what else `FlightLoop.frames` raises.
        """
        for left in reversed(range(PATIENCE)):
            try:
                yield from frames()
                return
            except VideoError:
                if left == 0:
                    raise

    def _drone_pose(self) -> Pose:
        """The newest, waited for where there was a gap.

        Raises:
            FlightEnded: there is none.
        """
        for _ in chain((None,), self._patiently(lambda: self._loop.frames(POSE_WAIT_S))):
            now = self._clock()
            for back_s in (0.05, 0.1, 0.2, 0.4):
                pose = self._drone.pose_at(now - back_s)
                if pose is not None:
                    return pose
        raise FlightEnded("the aircraft does not tell where it is", "Check the link.")


def _flown(run: WallRun, pose_at: PoseAt, start_m: Vector, side: Vector) -> WallFlight:
    stamped = run.times_s - _delay_s(run.times_s, run.sights, pose_at, start_m, side)
    return WallFlight(travel_of(replace(run, times_s=stamped)), _reckoned(run.started_s, pose_at))


def _delay_s(times_s: Vector, sights: Sequence[WallSight], pose_at: PoseAt, start_m: Vector, side: Vector) -> float:
    """Of the video against the poses: nobody tells the camera's latency to better than a tenth of a second."""
    if not sights:
        return 0.0
    asked = np.arange(times_s[0] - DELAYS_S[1], times_s[-1] - DELAYS_S[0], _POSE_STEP_S)
    poses = [pose_at(float(t_s)) for t_s in asked]
    reckoned = [math.nan if pose is None else float((pose.position_enu_m - start_m) @ side) for pose in poses]
    return video_delay(times_s, np.array([sight.position_m[0] for sight in sights]), asked, np.array(reckoned))


def _reckoned(started_s: float, pose_at: PoseAt) -> Vector:
    places = []
    for k in range(IMAGES):
        pose = pose_at(started_s + k * INTERVAL_S)
        places.append(np.full(2, np.nan) if pose is None else pose.position_enu_m[:2])
    moved: Vector = np.linalg.norm(np.array(places) - places[0], axis=1)
    return moved
