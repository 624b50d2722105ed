"""The procedure of the paper's Figure 2 as a state machine: detect, choose, hover, centre, sidestep, estimate, report.

The paper's aircraft hovers by itself while people are looked for. So does ours: control is taken only when the target
was found, so that an order for a box with nobody in it leaves the aircraft to whoever flies it.

It can be aborted at every step, and it always ends in the autopilot's hold, or where the pilot took the aircraft. It
knows aircraft only as `Drone` and reports only to its `Watcher`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from mission.bundle import BundleSolution
from mission.camera.camera import Camera
from mission.detect import Confirmation, Detector, choose
from mission.errors import DetectionError, EstimateRefused, FlightEnded, FlightRefused, LinkError, VideoError
from mission.estimate import ESTIMATORS
from mission.estimate.noise_fit import with_fitted_noise
from mission.estimate.passes import Passes
from mission.planning.pattern import lateral_path
from mission.planning.pattern_choice import chosen_pattern
from mission.planning.planner import SideRoom
from mission.pose.buffer import PoseAt
from mission.procedure.centring import Centring
from mission.procedure.flight_loop import FlightLoop
from mission.procedure.flight_record import PICTURES, FlightRecord
from mission.procedure.pointing import Pointing, TargetTracker
from mission.procedure.regain import Regain
from mission.procedure.reposition import follow_path
from mission.procedure.result import LocateResult, Stage, TargetChoice, Watcher
from mission.records import FlightSightings, GeodeticOrigin, NoiseModel, TargetPrior
from mission.settings import MissionSettings, PatternSettings
from mission.sighting import level_mounting
from mission.timing.flight_offset import FlightOffset, offset_uncertain
from mission.timing.time_offset import TimeOffset, TimeOffsetMeter
from mission.vehicle.drone import Drone
from mission.vehicle.pilot.preconditions import gimbal_refusal, unfit
from mission.video import VideoSource

POSE_AGE_S = 0.2
PRESUMED_UP_M = 2.0
"""Height above the target's ground for the choice of a pattern, where the aircraft does not tell its own."""
"""A pose this old is in the buffer on both of its sides."""
ORDER_TIMEOUT_S = 15.0
BAD_LINK = 0.1
"""Fraction of lost packets that an operator whose target was lost should hear of."""
LOCAL_ORIGIN = GeodeticOrigin(0.0, 0.0, 0.0)
"""Stands for an unknown place, for aircraft without a global position."""


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What the aircraft had told when the pattern was over."""

    pose_at: PoseAt
    origin: GeodeticOrigin | None
    noise: NoiseModel
    """Of the reported pose at its own time."""
    notes: tuple[str, ...] = ()
    """What was wrong with poses and video, and was put right."""
    doubt: str = ""
    """Why the attitude of a gimbal's camera is only believed where the pictures confirm it."""


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
        serve: called in every turn of the flight's loop: what else this thread has to do meanwhile.
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
        serve: Callable[[], None] = lambda: None,
    ) -> None:
        self._drone = drone
        self._camera = camera
        self._detector = detector
        self._settings = settings
        self._watcher = watcher
        self._clock = clock
        self._loop = FlightLoop(drone, video, aborted, clock, partial(watcher.stage, Stage.DETECT), serve)
        self._tracker = tracker
        pose = None if camera.gimbal == "none" else drone.pose_at(clock() - POSE_AGE_S)
        meter = TimeOffsetMeter(camera, mounting=level_mounting(pose, camera)) if settings.video.check_offset else None
        self._offset = FlightOffset(meter)
        self._gimbal = drone.gimbal if camera.gimbal != "none" else None
        self._told_lost = False
        self._unsaved: FlightRecord | None = None
        self._keeping = False
        self._prior = TargetPrior()
        self._passes = Passes()
        self._before: str | None = None
        self._pointing = Pointing(drone, camera, tracker, cautious=settings.video.check_offset)
        self._regain = Regain(self._loop, detector, tracker, self._pointing, watcher, clock)

    def run(self, choice: TargetChoice, flight_id: str) -> LocateResult:
        """Fly the whole procedure, with as many sidesteps as the settings want.

        Args:
            choice: which person is meant.
            flight_id: names the flight in its log; each sidestep adds its number.

        Returns:
            The last sidestep's answer; the watcher has been told each of them.

        Raises:
            FlightRefused: the aircraft does not take the order; nothing was flown.
            FlightEnded: abort, pilot, or failsafe.
            DetectionError: nobody in view, or lost before enough was seen.
            EstimateRefused: what was seen supports no position.
            LinkError, VideoError: the link or the video is gone.
        """
        try:
            self._check_aircraft()
            self._drone.begin(self._settings.limits.bounds())
            self._acquire(choice)
            self._hover()
            self._prior = self._settings.prior.prior(self._take_off_up_m())
            self._offset.found = self._centre()
            located = self._estimate(self._sidestep(f"{flight_id}-1"))
            for number in range(2, self._settings.repeat + 1):
                if located.ended:
                    break
                self._reposition(located)
                located = self._estimate(self._sidestep(f"{flight_id}-{number}"))
            return located
        except (DetectionError, EstimateRefused) as error:
            loss = self._drone.telemetry().packet_loss
            if loss is None or loss < BAD_LINK:
                raise
            cause = f"{error.cause}; meanwhile the link loses {100.0 * loss:.0f} % of the packets"
            raise type(error)(cause, f"{error.remedy} A better link may help.".lstrip()) from error
        finally:
            if self._gimbal is not None:
                self._gimbal.release()
            if self._loop.ours:
                self._watcher.stage(Stage.HOLD, "giving control back, holding")
                unconfirmed = self._loop.release_control()
                if unconfirmed:
                    self._watcher.stage(Stage.HOLD, f"hold is not confirmed ({unconfirmed}): take over by hand")
            if self._keeping:  # an abort met it: what it does by now is known before the end is told
                self._loop.wait_for_work()
            if self._unsaved is not None:  # after the hold: the disk may be slow
                self._watcher.sightings(self._flight(self._unsaved, self._told(), self._pointing.offset_s))

    def _check_aircraft(self) -> None:
        """Before the search, which takes seconds; the pilot process looks at more before it takes control."""
        telemetry = self._drone.telemetry()
        reason = unfit(telemetry, self._settings.link.min_battery)
        reason = reason or gimbal_refusal(telemetry, ignored=self._settings.camera.ignore_gimbal)
        if reason is not None:
            raise FlightRefused(reason, "Nothing was flown.")

    def _hover(self) -> None:
        self._watcher.stage(Stage.HOVER, "taking control, hovering")
        self._loop.fly(self._drone.hover())
        for frame in self._loop.until_done(ORDER_TIMEOUT_S):
            track = self._pointing.follow(frame)
            self._watcher.frame(frame, track)
            if track.state == "lost" and not self._regain.run(Stage.HOVER, lambda _: None, steer=False):
                raise DetectionError("the target was lost while control was taken", "Try again.")
        if self._gimbal is not None:
            why = self._loop.meanwhile(self._gimbal.take)
            told = f"the gimbal stays where it is ({why}): the nose is turned" if why else "pointing the gimbal"
            self._watcher.stage(Stage.HOVER, told)

    def _gimbal_lost(self) -> None:
        """Tell once who took the gimbal; it is not fought, and the flight goes on while the target stays in view."""
        if self._gimbal is not None and self._gimbal.lost and not self._told_lost:
            self._told_lost = True
            self._watcher.stage(Stage.SIDESTEP, f"{self._gimbal.lost}: it is left to them")

    def _take_off_up_m(self) -> float | None:
        """Up coordinate of the take-off point in the local frame, None where it is not known."""
        height_m, pose = self._drone.telemetry().height_m, self._drone.pose_at(self._clock() - POSE_AGE_S)
        return None if height_m is None or pose is None else float(pose.position_enu_m[2]) - height_m

    def _acquire(self, choice: TargetChoice) -> None:
        """Look for people until one is seen in two looks running, and start tracking the chosen one."""
        self._watcher.stage(Stage.DETECT, "looking for a person")
        confirmation = Confirmation()
        refused: DetectionError | None = None
        timeout_s = self._settings.detect.timeout_s
        for frame in self._loop.frames(timeout_s):
            found = self._loop.meanwhile(partial(self._detector.detect, frame.image))
            self._watcher.frame(frame, None)
            steady = confirmation.confirmed(found)
            if steady:
                height, width = frame.image.shape[:2]
                target = choose(steady, (width, height), choice.box, choice.point)
                try:
                    self._loop.meanwhile(partial(self._tracker.start, frame, target.box))
                except DetectionError as error:
                    refused = error  # the detector took something else for a person; the next look may show more
                    continue
                others = f" (and {len(steady) - 1} more in view)" if len(steady) > 1 else ""
                self._watcher.stage(Stage.DETECT, f"found a person{others}")
                return
        raise refused or DetectionError(
            f"no person found in {timeout_s:.0f} s", "Turn the camera towards the person, or fly nearer (HOG: 11 m)."
        )

    def _centre(self) -> TimeOffset | None:
        return Centring(
            self._loop, self._drone, self._pointing, self._offset.meter, self._regain, self._watcher, self._clock
        ).run()

    def _sidestep(self, flight_id: str) -> FlightRecord:
        azimuth = self._pointing.azimuth(self._clock())
        if azimuth is None:
            raise DetectionError("the target's bearing is not known", "Wait for telemetry and try again.")
        pattern, said = self._pattern()
        path = lateral_path(pattern, azimuth)
        flown = f"{pattern.kind}, {pattern.length_m:.1f} m, {path.duration_s:.0f} s"
        self._watcher.stage(Stage.SIDESTEP, ", ".join(part for part in (flown, said) if part))
        record = FlightRecord(flight_id, self._camera, interval_s=path.duration_s / PICTURES)
        moving_aim = self._settings.pattern.kind != "paper"
        order = self._drone.fly(path)
        self._loop.fly(order)
        try:
            for frame in self._loop.frames(path.duration_s + ORDER_TIMEOUT_S):
                # The order is done when the aircraft is at rest again; the pattern's last frame is sooner than that.
                if (
                    order.started_s is not None
                    and frame.t_s - self._pointing.offset_s > order.started_s + path.duration_s
                ):
                    break
                track = self._pointing.follow(frame)
                self._watcher.frame(frame, track)
                record.add(frame, track, self._pointing.roll_rad)
                self._offset.add(frame)
                if track.state == "lost":
                    self._gimbal_lost()
                    self._watcher.stage(Stage.SIDESTEP, "the target was lost; using what was seen")
                    break
                self._gimbal_lost()
                if moving_aim:
                    self._pointing.steer(self._clock())
        except (FlightEnded, LinkError, VideoError):
            self._unsaved = record
            raise
        return record

    def _pattern(self) -> tuple[PatternSettings, str]:
        """What to fly past the target, and what is to be said of it."""
        settings, telemetry, bounds = self._settings, self._drone.telemetry(), self._settings.limits.bounds()
        height_m = min(max(telemetry.height_m or PRESUMED_UP_M, bounds.min_height_m), bounds.max_height_m)
        room = SideRoom.within(bounds, height_m)
        room = replace(room, max_time_s=room.max_time_s / settings.repeat)
        choose = partial(
            chosen_pattern,
            settings.pattern,
            self._pointing.presumed_range_m(),
            self._camera,
            self._pose_noise(self._drone.noise()),
            self._prior,
            room,
        )
        return choose() if settings.pattern.accuracy_percent is None else self._loop.meanwhile(choose)

    def _reposition(self, located: LocateResult) -> None:
        """Keep to the target, and go back to the distance at which it was first seen."""
        place = self._pointing.place(self._clock())
        path = None if place is None else follow_path(located.estimate, place, self._clock())
        if path is None:
            return
        self._watcher.stage(Stage.REPOSITION, "following the target")
        self._loop.fly(self._drone.fly(path))
        for frame in self._loop.until_done(path.duration_s + ORDER_TIMEOUT_S):
            track = self._pointing.follow(frame)
            self._watcher.frame(frame, track)
            if track.state == "lost":
                raise DetectionError("the target was lost while following it", "Choose it again.")
            self._pointing.steer(self._clock())

    def _estimate(self, record: FlightRecord) -> LocateResult:
        self._watcher.stage(Stage.ESTIMATE, f"estimating from {len(record.seen)} frames")
        located, ended = self._loop.through(partial(self._answer, record, self._told(), self._loop.last_frame_s))
        if located.offset is not None and located.offset.offset_s != self._pointing.offset_s:
            self._pointing.trust(located.offset.offset_s)
        if ended is None:
            self._watcher.stage(Stage.REPORT, "reporting")
        else:
            located = replace(located, ended=ended.cause)
            self._watcher.stage(Stage.REPORT, f"the flight ended here ({ended.cause}); reporting what was seen")
        self._watcher.located(located)
        self._keeping = True
        _, afterwards = self._loop.through(partial(self._watcher.keep, located))
        self._keeping = False
        return located if ended is not None or afterwards is None else replace(located, ended=afterwards.cause)

    def _told(self) -> Told:
        poses = self._drone.poses()
        notes = tuple(note for note in (self._drone.pose_note(), self._loop.video_note) if note)
        doubt = self._drone.telemetry().gimbal_doubt
        return Told(poses, self._drone.origin, self._drone.noise(), notes, doubt)

    def _answer(self, record: FlightRecord, told: Told, last_frame_s: float) -> LocateResult:
        """In a thread of its own: the aircraft itself is not asked, since only the flight's loop speaks to it."""
        offset_s = self._pointing.offset_s
        if self._offset.measure_again(told.pose_at) and self._offset.found is not None:
            offset_s = self._offset.found.offset_s
        steadied = record.steadied(told.pose_at, offset_s, self._pose_noise(told.noise))
        flight = self._flight(record, told, offset_s, steadied)
        flight = replace(with_fitted_noise(flight, steadied=steadied.reason is None), continues=self._before)
        self._before = flight.id
        self._watcher.sightings(flight)
        if told.doubt and steadied.reason is not None:
            raise EstimateRefused(
                f"{told.doubt}, and the background could not confirm where the camera looked ({steadied.reason})",
                "Fly where the ground shows texture, or use a gimbal that reports measured angles.",
            )
        estimate = self._passes.estimate(flight)
        estimate = replace(estimate, notes=(*estimate.notes, steadied.note(), *told.notes))
        comparisons = []
        for name in ("stereo", "three-image", "four-image"):
            try:
                comparisons.append(ESTIMATORS[name].estimate(flight))
            except EstimateRefused:
                continue
        return LocateResult(
            flight=flight,
            estimate=estimate,
            comparisons=tuple(comparisons),
            geodetic=told.origin is not None,
            offset=self._offset.found,
            drone_track=record.drone_track(told.pose_at, offset_s),
            key_frames=tuple(record.key_frames),
            target_picture=record.target_picture(),
            last_frame_s=last_frame_s,
            steadied=steadied,
            as_reported=self._flight(record, told, offset_s) if steadied.reason is None else None,
        )

    def _flight(
        self, record: FlightRecord, told: Told, offset_s: float, steadied: BundleSolution | None = None
    ) -> FlightSightings:
        noise = self._pose_noise(told.noise)
        return record.sightings(told.origin or LOCAL_ORIGIN, told.pose_at, offset_s, noise, self._prior, steadied)

    def _pose_noise(self, noise: NoiseModel) -> NoiseModel:
        """Of the reported pose at a frame's time."""
        if self._offset.found is not None:
            return offset_uncertain(noise, self._offset.found.sigma_s)
        if self._settings.video.latency_s is None and not self._camera.latency_s:
            return offset_uncertain(noise)
        return noise
