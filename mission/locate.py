"""The procedure of the paper's Figure 2 as a state machine: hover, detect, choose, centre, sidestep, estimate, report.

It can be aborted at every step, and it always ends in the autopilot's hold, or where the pilot took the aircraft. It
knows aircraft only as `Drone` and reports only to its `Watcher`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from mission.aim import Aim, wrapped
from mission.camera.camera import Camera
from mission.camera.time_offset import TimeOffset, TimeOffsetMeter
from mission.detect import Detector, choose
from mission.drones.drone import Drone
from mission.errors import DetectionError, EstimateRefused, FlightEnded, LinkError, VideoError
from mission.estimate import ESTIMATORS
from mission.estimate.noise_fit import fit_noise, rescaled
from mission.flight_loop import FlightLoop
from mission.flight_record import FlightRecord
from mission.located import Located, Stage, TargetChoice, Watcher
from mission.pattern import lateral_path
from mission.pose import Pose
from mission.records import Box, Detection, FlightSightings, Frame, GeodeticOrigin
from mission.settings import MissionSettings
from mission.sighting import azimuth_of, rotation_shift, world_from_camera
from mission.track import Track
from mission.video import VideoSource

SAME_PERSON = 0.3
"""Overlap of two looks' boxes that are the same person."""
CENTRED_RAD = math.radians(3.0)
CENTRE_TIMEOUT_S = 12.0
STEADY_S = 0.4
"""The target is centred when it has been for this long."""
WIGGLE_RAD = math.radians(10.0)
WIGGLE_PERIOD_S = 1.6
WIGGLE_TURNS = 1.0
ORDER_TIMEOUT_S = 15.0
LOCAL_ORIGIN = GeodeticOrigin(0.0, 0.0, 0.0)
"""Stands for an unknown place, for aircraft without a global position."""


class TargetTracker(Protocol):
    """Keeps to one person from frame to frame (`mission.track.Tracker`)."""

    def start(self, frame: Frame, box: Box) -> None:
        """The target is in this box."""
        ...

    def update(self, frame: Frame, shift_px: tuple[float, float] = (0.0, 0.0)) -> Track:
        """Where it is in the next frame; `shift_px` is the image motion that the camera's rotation explains."""
        ...


@dataclass(frozen=True, slots=True)
class _Wiggle:
    """A yaw to and fro around where the target is expected."""

    aim: Aim
    started_s: float

    def over(self, now_s: float) -> bool:
        return now_s - self.started_s > WIGGLE_TURNS * WIGGLE_PERIOD_S

    def azimuth(self, now_s: float) -> float:
        phase = 2.0 * math.pi * (now_s - self.started_s) / WIGGLE_PERIOD_S
        return self.aim.predicted(now_s) + WIGGLE_RAD * math.sin(phase)


class Locate:
    """One order to locate a target.

    Args:
        drone: connected and in the air.
        video: its camera's pictures.
        camera: intrinsics, mounting, shutter.
        detector: finds people.
        tracker: follows one of them.
        settings: of the mission.
        watcher: is told of progress and of the answer.
        aborted: answers True as soon as the operator wants an end.
        clock: the program's clock, seconds.
    """

    def __init__(
        self,
        drone: Drone,
        video: VideoSource,
        camera: Camera,
        detector: Detector,
        tracker: TargetTracker,
        settings: MissionSettings,
        watcher: Watcher,
        aborted: Callable[[], bool],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._drone = drone
        self._camera = camera
        self._detector = detector
        self._settings = settings
        self._watcher = watcher
        self._clock = clock
        self._loop = FlightLoop(drone, video, aborted, clock)
        self._aim = Aim(cautious=settings.video.check_offset)
        self._tracker = tracker
        self._pose_before: Pose | None = None
        self._offset_s = 0.0

    def run(self, choice: TargetChoice, flight_id: str) -> Located:
        """Fly the whole procedure once.

        Args:
            choice: which person is meant.
            flight_id: names the flight in its log.

        Raises:
            FlightRefused: the aircraft does not take the order; nothing was flown.
            FlightEnded: abort, pilot, or failsafe.
            DetectionError: nobody in view, or lost before enough was seen.
            EstimateRefused: what was seen supports no position.
            LinkError, VideoError: the link or the video is gone.
        """
        try:
            self._drone.begin(self._settings.limits.bounds())
            self._hover()
            self._acquire(choice)
            offset = self._centre()
            record = self._sidestep(flight_id)
            return self._estimate(record, offset)
        finally:
            if self._loop.ours:
                self._watcher.stage(Stage.HOLD, "giving control back, holding")
                unconfirmed = self._loop.give_back()
                if unconfirmed:
                    self._watcher.stage(Stage.HOLD, f"hold is not confirmed ({unconfirmed}): take over by hand")

    def _hover(self) -> None:
        self._watcher.stage(Stage.HOVER, "taking control, hovering")
        self._loop.fly(self._drone.hover())
        for _ in self._loop.until_done(ORDER_TIMEOUT_S):
            pass

    def _acquire(self, choice: TargetChoice) -> None:
        """Look for people until one is seen in two looks running, and start tracking the chosen one."""
        self._watcher.stage(Stage.DETECT, "looking for a person")
        before: list[Detection] = []
        timeout_s = self._settings.detect.timeout_s
        for frame in self._loop.frames(timeout_s):
            found = self._loop.meanwhile(partial(self._detector.detect, frame.image))
            self._watcher.frame(frame, None)
            steady = [d for d in found if any(d.box.overlap(other.box) > SAME_PERSON for other in before)]
            before = found
            if steady:
                height, width = frame.image.shape[:2]
                target = choose(steady, (width, height), choice.box, choice.point)
                self._loop.meanwhile(partial(self._tracker.start, frame, target.box))
                others = f" (and {len(steady) - 1} more in view)" if len(steady) > 1 else ""
                self._watcher.stage(Stage.DETECT, f"found a person{others}")
                return
        raise DetectionError(
            f"no person found in {timeout_s:.0f} s", "Turn the camera towards the person, or fly nearer (HOG: 11 m)."
        )

    def _centre(self) -> TimeOffset | None:
        """Turn to the target, and measure the video's time offset on that turn or on a short wiggle after it."""
        self._watcher.stage(Stage.CENTRE, "turning to the target")
        meter = TimeOffsetMeter(self._camera)
        centred_since_s: float | None = None
        wiggle: _Wiggle | None = None
        offset: TimeOffset | None = None
        measuring = self._settings.video.check_offset
        for frame in self._loop.frames(CENTRE_TIMEOUT_S):
            track = self._follow(frame)
            if track.state == "lost":
                raise DetectionError("the target was lost while turning to it", "Try again, or choose it by a box.")
            now = self._clock()
            if measuring:
                meter.add(frame)
            if wiggle is not None and measuring:
                if not wiggle.over(now):
                    self._drone.aim(wrapped(wiggle.azimuth(now) - self._camera_azimuth()))
                    continue
                offset = self._take_offset(meter)
                measuring = False
            heading = self._aim.heading(now, self._camera_azimuth())
            if heading is None:
                continue
            self._drone.aim(heading)
            off_axis = math.atan((track.pixel[0] - self._camera.intrinsics.cx) / self._camera.intrinsics.fx)
            centred_since_s = None if abs(off_axis) > CENTRED_RAD else centred_since_s or now
            if centred_since_s is None or now - centred_since_s < STEADY_S:
                continue
            if not measuring:
                return offset
            # The first turn may have been enough to tell.
            if meter.measure(self._drone.pose_at) is not None:
                return self._take_offset(meter)
            self._watcher.stage(Stage.CENTRE, "a short yaw wiggle measures the video's time offset")
            wiggle, centred_since_s = _Wiggle(replace(self._aim), now), None
        self._watcher.stage(Stage.CENTRE, "the target is not quite centred; going on")
        return self._take_offset(meter) if measuring else offset

    def _take_offset(self, meter: TimeOffsetMeter) -> TimeOffset | None:
        """Measure the time offset and use it from here on; bearing rates so far were of other times, so forget them."""
        offset = meter.measure(self._drone.pose_at)
        if offset is None:
            self._watcher.stage(Stage.CENTRE, f"{meter.reason}; the camera's latency is used as it is")
            self._aim = replace(self._aim, cautious=False)
            return None
        self._offset_s = offset.offset_s
        self._aim = replace(self._aim, rate_rad_s=0.0, cautious=False)
        self._pose_before = None
        self._watcher.stage(
            Stage.CENTRE, f"video runs {1e3 * offset.offset_s:.0f} ms behind telemetry (+-{1e3 * offset.sigma_s:.0f})"
        )
        return offset

    def _sidestep(self, flight_id: str) -> FlightRecord:
        azimuth = self._aim.azimuth_rad
        if azimuth is None:
            raise DetectionError("the target's bearing is not known", "Wait for telemetry and try again.")
        path = lateral_path(self._settings.pattern, azimuth)
        self._watcher.stage(
            Stage.SIDESTEP,
            f"{self._settings.pattern.kind}, {self._settings.pattern.length_m:.1f} m, {path.duration_s:.0f} s",
        )
        record = FlightRecord(flight_id, self._camera, interval_s=path.duration_s / 15.0)
        moving_aim = self._settings.pattern.kind != "paper"
        self._loop.fly(self._drone.fly(path))
        try:
            for frame in self._loop.until_done(path.duration_s + ORDER_TIMEOUT_S):
                track = self._follow(frame)
                record.add(frame, track)
                if track.state == "lost":
                    self._watcher.stage(Stage.SIDESTEP, "the target was lost; using what was seen")
                    break
                heading = self._aim.heading(self._clock(), self._camera_azimuth())
                if moving_aim and heading is not None:
                    self._drone.aim(heading)
        except (FlightEnded, LinkError, VideoError):
            self._watcher.sightings(self._flight(record))
            raise
        return record

    def _estimate(self, record: FlightRecord, offset: TimeOffset | None) -> Located:
        self._watcher.stage(Stage.ESTIMATE, f"estimating from {len(record.seen)} frames")
        located = self._loop.meanwhile(partial(self._answer, record, offset, self._loop.last_frame_s))
        self._watcher.stage(Stage.REPORT, "reporting")
        self._loop.meanwhile(partial(self._watcher.located, located))
        return located

    def _answer(self, record: FlightRecord, offset: TimeOffset | None, last_frame_s: float) -> Located:
        flight = self._flight(record)
        flight = rescaled(flight, fit_noise(flight))
        self._watcher.sightings(flight)
        estimate = ESTIMATORS["batch"].estimate(flight)
        comparisons = []
        for name in (n for n in ("stereo", "three-image", "four-image") if n in ESTIMATORS):
            try:
                comparisons.append(ESTIMATORS[name].estimate(flight))
            except EstimateRefused:
                continue
        return Located(
            flight=flight,
            estimate=estimate,
            comparisons=tuple(comparisons),
            geodetic=self._drone.origin is not None,
            offset=offset,
            drone_track=record.drone_track(self._drone.pose_at, self._offset_s),
            key_frames=tuple(record.key_frames),
            target_picture=record.target_picture(),
            last_frame_s=last_frame_s,
        )

    def _flight(self, record: FlightRecord) -> FlightSightings:
        return record.sightings(
            self._drone.origin or LOCAL_ORIGIN,
            self._drone.pose_at,
            self._offset_s,
            self._drone.noise(),
            self._settings.prior.prior(),
        )

    def _follow(self, frame: Frame) -> Track:
        """Track the target into a frame and take its azimuth into the aim."""
        pose = self._drone.pose_at(frame.t_s - self._offset_s)
        shift = (0.0, 0.0)
        if pose is not None and self._pose_before is not None:
            centre = (self._camera.intrinsics.cx, self._camera.intrinsics.cy)
            shift = rotation_shift(centre, self._pose_before, pose, self._camera)
        track = self._tracker.update(frame, shift)
        if pose is not None:
            self._pose_before = pose
            if track.state == "tracking":
                self._aim.observe(azimuth_of(track.pixel, pose, self._camera), pose.t_s)
        self._watcher.frame(frame, track)
        return track

    def _camera_azimuth(self) -> float:
        """Azimuth of the camera's axis relative to the nose."""
        if self._pose_before is None:
            return 0.0
        axis = world_from_camera(self._pose_before, self._camera).apply([0.0, 0.0, 1.0])
        heading = self._drone.telemetry().heading_rad
        return 0.0 if heading is None else wrapped(math.atan2(axis[0], axis[1]) - heading)
