"""The procedure of the paper's Figure 2 as a state machine: hover, detect, choose, centre, sidestep, estimate, report.

It can be aborted at every step, and it always ends in the autopilot's hold, or where the pilot took the aircraft. It knows
aircraft only as `Drone` and reports only to its `Watcher`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from mission.aim import Aim, wrapped
from mission.camera.file import Camera
from mission.camera.time_offset import TimeOffset, TimeOffsetMeter
from mission.detect import Detector, choose
from mission.drones.drone import Drone, Order, OrderState
from mission.errors import (
    DetectionError,
    EstimateRefused,
    FlightEnded,
    FlightRefused,
    LinkError,
    SidestepError,
    VideoError,
)
from mission.estimate import ESTIMATORS
from mission.estimate.noise_fit import fit_noise
from mission.flight_record import FlightRecord, KeyFrame, noise_of
from mission.pattern import lateral_path
from mission.pose import Pose
from mission.records import Box, Detection, Estimate, FlightSightings, Frame, GeodeticOrigin, Matrix
from mission.settings import MissionSettings
from mission.sighting import azimuth_of, rotation_shift, world_from_camera
from mission.track import Track, Tracker
from mission.video import VideoSource

VIDEO_LOST_S = 1.0
"""No new picture for this long: the video has stopped."""
CENTRED_RAD = math.radians(3.0)
CENTRE_TIMEOUT_S = 12.0
WIGGLE_RAD = math.radians(10.0)
WIGGLE_PERIOD_S = 2.0
WIGGLE_TURNS = 1.5
ORDER_TIMEOUT_S = 15.0
LOCAL_ORIGIN = GeodeticOrigin(0.0, 0.0, 0.0)
"""Stands for an unknown place, for aircraft without a global position."""


class Stage(Enum):
    """Where the procedure is."""

    HOVER = "hover"
    DETECT = "detect"
    CENTRE = "centre"
    SIDESTEP = "sidestep"
    ESTIMATE = "estimate"
    REPORT = "report"
    HOLD = "hold"


@dataclass(frozen=True, slots=True)
class TargetChoice:
    """Which of the people in view is meant; with neither, the one nearest the image centre."""

    box: Box | None = None
    point: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """A finished sidestep: the answer and all that decided it."""

    flight: FlightSightings
    estimate: Estimate
    comparisons: tuple[Estimate, ...]
    """The closed forms on the same sightings, where they apply."""
    geodetic: bool
    """Whether the flight's origin is a real place."""
    offset: TimeOffset | None
    drone_track: Matrix
    key_frames: tuple[KeyFrame, ...]
    target_picture: bytes | None
    last_frame_s: float
    """Program time of the last frame of the pattern."""


class Watcher(Protocol):
    """Who is told of what happens. Called from the procedure's own thread: keep it short."""

    def stage(self, stage: Stage, text: str) -> None:
        """A new stage, or news of the present one."""
        ...

    def frame(self, frame: Frame, track: Track | None) -> None:
        """A frame was used."""
        ...

    def sightings(self, flight: FlightSightings) -> None:
        """The sightings of a flight, before they are estimated from: keep them whatever follows."""
        ...

    def located(self, located: Located) -> None:
        """The answer: store and publish it."""
        ...


class Locate:
    """One order to locate a target.

    Args:
        drone: connected and in the air.
        video: its camera's pictures.
        camera: intrinsics, mounting, shutter.
        detector: finds people.
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
        settings: MissionSettings,
        watcher: Watcher,
        aborted: Callable[[], bool],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._drone = drone
        self._video = video
        self._camera = camera
        self._detector = detector
        self._settings = settings
        self._watcher = watcher
        self._aborted = aborted
        self._clock = clock
        self._order: Order | None = None
        self._last_index = -1
        self._last_frame_s = clock()
        self._in_control = False
        self._aim = Aim()
        self._tracker = Tracker(detector)
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
            self._give_back()

    def _hover(self) -> None:
        self._watcher.stage(Stage.HOVER, "taking control, hovering")
        self._fly(self._drone.hover())
        self._in_control = True
        for _ in self._until_done(ORDER_TIMEOUT_S):
            pass

    def _acquire(self, choice: TargetChoice) -> None:
        self._watcher.stage(Stage.DETECT, "looking for a person")
        before: list[Detection] = []
        timeout_s = self._settings.detect.timeout_s
        for frame in self._frames(timeout_s):
            found = self._detector.detect(frame.image)
            steady = [d for d in found if any(d.box.overlap(other.box) > 0.3 for other in before)]
            before = found
            self._watcher.frame(frame, None)
            if steady or (choice.box is not None and found):
                height, width = frame.image.shape[:2]
                target = choose(steady or found, (width, height), choice.box, choice.point)
                self._tracker.start(frame, target.box)
                others = len(steady) - 1
                self._watcher.stage(
                    Stage.DETECT, "found a person" + (f" (and {others} more in view)" if others > 0 else "")
                )
                return
        raise DetectionError(
            f"no person found in {timeout_s:.0f} s", "Turn the camera towards the person, or fly nearer (HOG: 11 m)."
        )

    def _centre(self) -> TimeOffset | None:
        self._watcher.stage(Stage.CENTRE, "turning to the target")
        meter = TimeOffsetMeter(self._camera)
        centred_since: float | None = None
        wiggle_start: float | None = None
        offset: TimeOffset | None = None
        for frame in self._frames(CENTRE_TIMEOUT_S):
            track = self._follow(frame)
            if track.state == "lost":
                raise DetectionError("the target was lost while turning to it", "Try again, or choose it by a box.")
            meter.add(frame)
            now = self._clock()
            heading = self._aim.heading(now, self._camera_azimuth())
            if heading is None:
                continue
            if wiggle_start is not None:
                phase = (now - wiggle_start) / WIGGLE_PERIOD_S
                if phase < WIGGLE_TURNS:
                    heading += WIGGLE_RAD * math.sin(2.0 * math.pi * phase)
                    self._drone.aim(wrapped(heading))
                    continue
            self._drone.aim(heading)
            off_axis = abs(math.atan((track.pixel[0] - self._camera.intrinsics.cx) / self._camera.intrinsics.fx))
            if off_axis > CENTRED_RAD:
                centred_since = None
                continue
            centred_since = now if centred_since is None else centred_since
            if now - centred_since < 0.4:
                continue
            if not self._settings.video.check_offset:
                return None
            offset = meter.measure(self._drone.pose_at)
            if offset is not None or wiggle_start is not None:
                return self._take_offset(offset)
            self._watcher.stage(Stage.CENTRE, "a short yaw wiggle measures the video's time offset")
            wiggle_start, centred_since = now, None
        self._watcher.stage(Stage.CENTRE, "the target is not quite centred; going on")
        return self._take_offset(offset)

    def _take_offset(self, offset: TimeOffset | None) -> TimeOffset | None:
        if offset is None:
            self._watcher.stage(Stage.CENTRE, "the time offset could not be measured; using the camera's setting")
            return None
        self._offset_s = offset.offset_s
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
        self._fly(self._drone.fly(path))
        try:
            for frame in self._until_done(path.duration_s + ORDER_TIMEOUT_S):
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
        flight = self._flight(record)
        self._watcher.sightings(flight)
        estimate = ESTIMATORS["batch"].estimate(flight)
        comparisons = []
        for name in ("stereo", "three-image", "four-image"):
            try:
                comparisons.append(ESTIMATORS[name].estimate(flight))
            except EstimateRefused:
                continue
        located = Located(
            flight=flight,
            estimate=estimate,
            comparisons=tuple(comparisons),
            geodetic=self._drone.origin is not None,
            offset=offset,
            drone_track=record.drone_track(self._drone.pose_at, self._offset_s),
            key_frames=tuple(record.key_frames),
            target_picture=record.target_picture(),
            last_frame_s=self._last_frame_s,
        )
        self._watcher.stage(Stage.REPORT, "reporting")
        self._watcher.located(located)
        return located

    def _flight(self, record: FlightRecord) -> FlightSightings:
        flight = record.sightings(
            self._drone.origin or LOCAL_ORIGIN,
            self._drone.pose_at,
            self._offset_s,
            noise_of(self._drone, self._camera),
            self._settings.prior.prior(),
        )
        return fit_noise(flight)

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

    def _fly(self, order: Order) -> None:
        self._order = order

    def _until_done(self, timeout_s: float) -> Iterator[Frame]:
        """Frames until the order that is being flown is done."""
        order = self._order
        for frame in self._frames(timeout_s):
            yield frame
            if order is None or order.state is OrderState.DONE:
                return
        raise FlightEnded(f"the aircraft did not finish its {order.kind if order else 'order'}", "It holds its place.")

    def _frames(self, timeout_s: float) -> Iterator[Frame]:
        """New frames, newest first, until the time is over; raises as soon as anything ends the flight."""
        started = self._clock()
        self._last_frame_s = max(self._last_frame_s, started)
        while self._clock() - started < timeout_s:
            self._check()
            frame = self._video.latest(self._last_index, 0.05)
            if frame is None:
                if self._clock() - self._last_frame_s > VIDEO_LOST_S:
                    raise VideoError(
                        f"no picture for {VIDEO_LOST_S:.0f} s",
                        "Check the camera and the video link; the aircraft holds.",
                    )
                continue
            self._last_index, self._last_frame_s = frame.index, self._clock()
            yield frame

    def _check(self) -> None:
        """Raise when the operator, the pilot, a failsafe or the link ended the flight."""
        for event in self._drone.events():
            if event.kind in ("pilot", "failsafe", "deadman", "pilot-process-lost"):
                self._in_control = False
                raise FlightEnded(event.text, "Give the order again when the aircraft is yours.")
            if event.kind == "link-lost":
                raise LinkError(event.text, "Check the link; the autopilot's own failsafe holds the aircraft.")
        if self._aborted():
            raise FlightEnded("aborted by the operator", "")
        if not self._drone.telemetry().connected:
            raise LinkError("telemetry stopped", "Check the link; the autopilot's own failsafe holds the aircraft.")
        order = self._order
        if order is not None and order.state is OrderState.REFUSED:
            raise FlightRefused(order.reason, "Nothing was flown.")
        if order is not None and order.state is OrderState.ENDED:
            raise FlightEnded(order.reason, "")

    def _give_back(self) -> None:
        """Hold, unless the pilot has the aircraft already."""
        if not self._in_control:
            return
        self._watcher.stage(Stage.HOLD, "giving control back, holding")
        order = self._drone.hold()
        deadline = self._clock() + 5.0
        while order.state in (OrderState.PENDING, OrderState.FLYING) and self._clock() < deadline:
            self._drone.telemetry()
            self._video.latest(self._last_index, 0.05)
        self._in_control = False
        if order.state is not OrderState.DONE:
            self._watcher.stage(
                Stage.HOLD, f"hold is not confirmed: {order.reason or 'no answer'}; the pilot should take over"
            )
