"""The loop that serves one connected vehicle: it steps the component and carries out one order after another.

Everything happens in this one loop, whose silence the stations see; only what would make it wait (opening the video,
looking for people, writing pictures) is done in other threads meanwhile.
"""

from __future__ import annotations

import logging
import math
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Protocol, TypeVar

from pymavlink.dialects.v20 import all as mavlink
from rich.console import Console

from gcs_plugin.component import CameraComponent, Follow, HandToAutopilot, LocateOrder, Mark, NextCandidate, Order
from gcs_plugin.component.commands import CANCELLED
from gcs_plugin.component.tracking import TrackedBox
from gcs_plugin.console.desk import ConsoleDesk
from gcs_plugin.console.watch import ConsoleWatcher
from gcs_plugin.cot.publisher import TakPublisher
from gcs_plugin.flight_report.flight_folder import FlightFolder
from gcs_plugin.geotags.log import Geotag, GeotagLog
from gcs_plugin.locate_session import FlightDevices, LocateSession, known_camera, open_camera
from gcs_plugin.publish.autopilot_handoff import WORDS, AutopilotHandoff, What
from gcs_plugin.publish.messages import Link
from gcs_plugin.publish.publisher import Times
from gcs_plugin.serve.follow import Choose, Following, next_candidate
from gcs_plugin.serve.report import Report
from gcs_plugin.serve.workers import in_the_background
from gcs_plugin.terminal.progress import Progress
from mission.addresses import without_secrets
from mission.camera import Camera
from mission.detect import Detector, choose
from mission.errors import FlightEnded, FlightRefused, LinkError, SidestepError
from mission.procedure.pointing import Pointing, TargetTracker
from mission.procedure.result import TargetChoice
from mission.records import Frame
from mission.settings import CameraSettings, MissionSettings, VideoSettings
from mission.track import Tracker
from mission.vehicle.drone import Drone
from mission.video import VideoSource, VideoState

_logger = logging.getLogger(__name__)
Result = TypeVar("Result")

IDLE_WAIT_S: Final = 0.1
BUSY_WAIT_S: Final = 0.05
LAST_PATIENCE_S: Final = 3.0
"""For what is being written when the program is to end: MAVProxy gives it four seconds."""
LONG_WAIT_S: Final = 2.0
"""From then on the operator is told what the video's opening waits for."""
VIEWERS_AGAIN_S: Final = 5.0
"""Between attempts to open a video that only the page's viewers want."""
FRESH_S: Final = 2.0
"""A target that was tracked this recently is still the one that is meant."""


class Ending(Protocol):
    """The end of the program (`gcs_plugin.terminal.abort.Abort`)."""

    in_flight: bool

    def asked(self) -> bool:
        """Whether the operator wants an end."""
        ...


@dataclass(frozen=True, slots=True)
class ServeContext:
    """What outlives a connection."""

    detector: Detector
    log: GeotagLog
    console: Console
    times: Times
    abort: Ending
    tracker: Callable[[], TargetTracker] = Tracker
    """Makes one for each order."""
    open_camera: Callable[[MissionSettings, Callable[[str], None]], tuple[VideoSource, Camera]] = open_camera
    tak: TakPublisher | None = None
    """Shows targets and drone on TAK maps."""
    console_desk: ConsoleDesk | None = None
    """Of the page in the browser."""


class ServeSession:
    """Serves a vehicle for as long as the connection lasts.

    Args:
        crew: what outlives it.
        drone: connected.
        link: the vehicle's, speaking as the component.
        component: listening.
    """

    def __init__(self, crew: ServeContext, drone: Drone, link: Link, component: CameraComponent) -> None:
        self._crew = crew
        self._drone = drone
        self._link = link
        self._component = component
        self._view: tuple[VideoSource, Camera] | None = None
        self._opened_with: tuple[VideoSettings, CameraSettings] | None = None
        self._needed_s = 0.0
        self._target: TrackedBox | None = None
        self._geotag: Geotag | None = None
        self._told = False
        self._no_video = ""
        self._no_video_before_s = -math.inf

    def run(self) -> None:
        """Serve until the program is to end.

        Raises:
            LinkError: the connection's process is gone.
        """
        desk = self._crew.console_desk
        if desk is not None:
            desk.attach(self._drone, self._component, known_camera(self._component.settings))
            self._component.visitor = desk
        try:
            while not self._crew.abort.asked():
                order = self._component.attend(IDLE_WAIT_S)
                self._look_after_the_link()
                if order is not None:
                    self._carry_out(order)
                elif desk is not None and desk.pictures.wanted:
                    self._play_for_viewers()
                elif self._view is not None and self._idle_s() >= self._component.settings.video.keep_open_s:
                    self._close_video()
        finally:
            self._component.visitor = None
            self._close_video()
            if desk is not None:
                desk.detach()

    def _play_for_viewers(self) -> None:
        """Somebody looks at the page: the video is open without an order, too."""
        self._needed_s = self._crew.times.clock()
        if (self._view is not None and self._plays_as_set()) or self._needed_s < self._no_video_before_s:
            return
        try:
            self._open_video()
        except SidestepError as error:
            self._no_video_before_s = self._crew.times.clock() + VIEWERS_AGAIN_S
            if str(error) != self._no_video:
                self._no_video = str(error)
                self._say(self._no_video)
                if self._crew.console_desk is not None:
                    self._crew.console_desk.said(error.cause)
        else:
            self._no_video = ""

    def _look_after_the_link(self) -> None:
        self._drone.keep_alive()
        if self._crew.tak is not None:
            self._crew.tak.drone(self._drone)
        for event in self._drone.events():
            if event.kind == "pilot-process-lost":
                raise LinkError(event.text, "Connecting again.")
            if event.kind in ("link-lost", "link-back", "slow-link"):
                self._say(f"{event.kind}: {event.text}")
            if event.kind == "slow-link":
                self._component.say(event.text)

    def _carry_out(self, order: Order) -> None:
        """Do it, and whatever comes of it be ready for the next one."""
        result = mavlink.MAV_RESULT_FAILED
        self._told = False
        self._drone.pose_at(self._crew.times.clock())  # it may have been sparing of telemetry: now somebody looks
        self._crew.abort.in_flight = True
        try:
            match order:
                case LocateOrder():
                    self._locate(order)
                case HandToAutopilot():
                    self._hand_to_autopilot(order)
                case Follow() | NextCandidate():
                    self._follow(order)
            result = mavlink.MAV_RESULT_ACCEPTED
        except SidestepError as error:
            result = self._result_of(error)
            self._say(str(error))
            if not self._told:
                self._component.say(error.cause)
            elif self._crew.console_desk is not None:
                self._crew.console_desk.said(error.cause)
        except Exception:  # noqa: BLE001  # a fault in one order must not take the others' answers, nor the component
            _logger.error("the order failed\n%s", without_secrets(traceback.format_exc()))
            self._component.say("internal error, see the log")
        finally:
            self._crew.abort.in_flight = False
            self._needed_s = self._crew.times.clock()
            self._component.ended(result)
            if self._crew.console_desk is not None:
                self._crew.console_desk.ended()

    def _result_of(self, error: SidestepError) -> int:
        if self._stopped():
            return CANCELLED
        refused = isinstance(error, FlightRefused)
        return int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED if refused else mavlink.MAV_RESULT_FAILED)

    def _locate(self, order: LocateOrder) -> None:
        settings, crew = self._component.settings, self._crew
        self._component.say("order taken" if self._plays_as_set() else "order taken, opening the video")
        prepared = in_the_background(crew.log.prepare)
        video, camera = self._open_video()
        self._await(prepared)  # a log that takes no geotag is found before the flight
        choice = self._choice(order.mark, camera)
        with FlightFolder(settings.answer.folder, crew.times.utc()) as folder, Progress(crew.console) as progress:
            progress.say(f"ordered to locate {choice}")
            parts = FlightDevices(
                self._drone, self._link, video, camera, crew.detector, crew.tracker(), crew.log, crew.tak
            )
            flight = LocateSession(parts, settings, choice, folder, progress, crew.times)
            try:
                self._told = settings.answer.statustext  # the answer itself tells of a flight without one
                desk = crew.console_desk
                told = flight.answer if desk is None else ConsoleWatcher(desk, flight.answer)
                located = flight.run(self._stopped, Report(self._component, told), self._component.step)
                self._component.tracking(None)
                self._meanwhile(partial(flight.answer.finish, located))
                progress.say(f"done: {folder.path}")
            finally:
                self._geotag = flight.answer.geotag or self._geotag
                flight.answer.close()

    def _hand_to_autopilot(self, order: HandToAutopilot) -> None:
        """The last answer to the autopilot, as region of interest and waypoint."""
        autopilot_handoff = AutopilotHandoff(self._link, self._component.settings.answer)
        wanted: list[tuple[What, bool]] = [("roi", order.roi), ("waypoint", order.waypoint)]
        for what in (name for name, is_asked in wanted if is_asked):
            asked = partial(autopilot_handoff.requested, what, self._geotag)
            said = self._await(in_the_background(asked), patience_s=0.0)  # half a plan changes nothing
            self._say(f"{WORDS[what]}: {said}")
            self._component.say(f"{WORDS[what]} {said}")

    def _follow(self, order: Follow | NextCandidate) -> None:
        """Track in the picture until told to stop; nothing flies."""
        settings = self._component.settings
        video, camera = self._open_video()
        tracker = self._crew.tracker()
        pointing = Pointing(self._drone, camera, tracker, cautious=settings.video.check_offset)
        following = Following(
            video,
            self._crew.detector,
            tracker.start,
            pointing,
            self._stopped,
            self._meanwhile,
            self._crew.times.clock,
            self._component.step,
        )
        following.run(self._chooser(order, camera), settings.detect.timeout_s, self._show)

    def _chooser(self, order: Follow | NextCandidate, camera: Camera) -> Choose:
        if isinstance(order, Follow):
            lens = camera.intrinsics
            marked = order.mark.choice(lens.width_px, lens.height_px)
            size = (lens.width_px, lens.height_px)
            return lambda people: choose(people, size, marked.box, marked.point)
        before = None if self._target is None else self._target.track.box
        return lambda people: next_candidate(people, before)

    def _choice(self, mark: Mark | None, camera: Camera) -> TargetChoice:
        """The marked person, else the tracked one, else whoever is nearest to the middle."""
        if mark is not None:
            return mark.choice(camera.intrinsics.width_px, camera.intrinsics.height_px)
        target = self._target
        if target is not None and not target.lost and self._crew.times.clock() - target.track.t_s < FRESH_S:
            return TargetChoice(box=target.track.box)
        return TargetChoice()

    def _show(self, seen: TrackedBox, frame: Frame) -> None:
        self._target = seen
        if self._crew.console_desk is not None:
            self._crew.console_desk.frame(frame, seen.track)
        self._component.tracking(seen)

    def _stopped(self) -> bool:
        return self._component.should_stop() or self._crew.abort.asked()

    def _open_video(self) -> tuple[VideoSource, Camera]:
        if self._view is not None and self._plays_as_set():
            return self._view
        self._close_video()
        settings, asked_s, told = self._component.settings, self._crew.times.clock(), False
        opening = in_the_background(partial(self._crew.open_camera, settings, self._say))
        while not opening.done():
            self._component.step(BUSY_WAIT_S)
            self._drone.keep_alive()
            if not told and self._crew.times.clock() - asked_s >= LONG_WAIT_S:
                self._component.say("waiting for the camera's first picture")
                self._say("still no picture: it begins at the camera's next key frame; let it send one every second")
                told = True
            if self._stopped():
                opening.add_done_callback(_close_unused)
                raise FlightEnded("aborted by the operator")
        self._view, self._opened_with = opening.result(), (settings.video, settings.camera)
        lens = self._view[1].intrinsics
        codec = self._view[0].stats().codec or self._component.picture.codec
        picture = replace(self._component.picture, width_px=lens.width_px, height_px=lens.height_px, codec=codec)
        self._component.picture = picture
        if self._crew.console_desk is not None:
            self._crew.console_desk.play(*self._view)
        return self._view

    def _idle_s(self) -> float:
        return self._crew.times.clock() - self._needed_s

    def _plays_as_set(self) -> bool:
        """Whether the video is open, runs, and was opened with the settings of now."""
        settings = self._component.settings
        if self._view is None or self._opened_with != (settings.video, settings.camera):
            return False
        stats = self._view[0].stats()
        return stats.state is VideoState.PLAYING and (stats.last_frame_age_s or 0.0) < FRESH_S

    def _close_video(self) -> None:
        if self._view is not None:
            if self._crew.console_desk is not None:
                self._crew.console_desk.play(None, None)
            self._view[0].close()
            self._view = None

    def _meanwhile(self, work: Callable[[], Result]) -> Result:
        """Do something long in another thread while the stations are served here."""
        return self._await(in_the_background(work))

    def _await(self, future: Future[Result], patience_s: float = LAST_PATIENCE_S) -> Result:
        """Serve the stations until it is done; when the program is to end, only so much longer."""
        asked_s: float | None = None
        while not future.done():
            self._component.step(BUSY_WAIT_S)
            if asked_s is None and self._crew.abort.asked():
                asked_s = self._crew.times.clock()
            if asked_s is not None and self._crew.times.clock() - asked_s >= patience_s:
                raise FlightEnded("the program ends")
        return future.result()

    def _say(self, text: str) -> None:
        self._crew.console.print(text, markup=False, highlight=False)


def _close_unused(opening: Future[tuple[VideoSource, Camera]]) -> None:
    if opening.exception() is None:
        opening.result()[0].close()
