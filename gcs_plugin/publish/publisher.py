"""What becomes of an answer: it is told at once, then stored, then given to the autopilot, then drawn for people.

Telling waits for nothing: the place is with the ground station and on the terminal before a disk is asked. Whatever
fails afterwards (a log that another program holds, a region of interest refused, a picture that does not fit on the
disk) is told and noted, and takes nothing back.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial

from gcs_plugin.cot.publisher import TakPublisher
from gcs_plugin.durable import write_whole
from gcs_plugin.flight_report.attitude_view import steady_view
from gcs_plugin.flight_report.contact_sheet import contact_sheet
from gcs_plugin.flight_report.flight_folder import FlightFolder
from gcs_plugin.flight_report.outcome import Outcome
from gcs_plugin.flight_report.plan_view import plan_view
from gcs_plugin.geotags.log import Geotag, GeotagLog, Provenance, make_geotag
from gcs_plugin.geotags.siting import Sited, sited
from gcs_plugin.publish.adsb import AdsbMirror
from gcs_plugin.publish.autopilot_handoff import WORDS, AutopilotHandoff, What
from gcs_plugin.publish.messages import Link, StatusTexts, camera_tracking_geo_status
from gcs_plugin.terminal.progress import Progress
from mission.bundle import PointTrails
from mission.errors import AnswerError, SettingsError, SidestepError
from mission.estimate.answer_line import estimate_line
from mission.estimate.noise_fit import with_fitted_noise
from mission.procedure.flight_record import KeyFrame
from mission.procedure.result import LocateResult, Stage
from mission.records import Estimate, FlightSightings, Frame
from mission.settings import AnswerSettings
from mission.track import Track
from mission.vehicle.drone import Drone

SEEN_FRAMES = 12
"""Pictures kept for a flight without an answer, the newest."""
SEEN_INTERVAL_S = 0.5


@dataclass(frozen=True, slots=True)
class Times:
    """The two clocks: the program's, and UTC."""

    clock: Callable[[], float] = time.monotonic
    utc: Callable[[], datetime] = lambda: datetime.now(UTC)

    def utc_of(self, t_s: float) -> datetime:
        """UTC of a program time."""
        return self.utc() - timedelta(seconds=self.clock() - t_s)


class AnswerPublisher:
    """Stores and publishes; the `Watcher` of one flight.

    Args:
        drone: the aircraft, asked for what the geotag says of it.
        link: where answers are sent; None for an aircraft without MAVLink.
        settings: what is sent, and the stand-off.
        folder: of this flight.
        log: of all geotags.
        progress: what the person at the terminal sees.
        provenance: where the geotag will say that it comes from.
        times: program time and UTC.
        tak: shows target and drone on TAK maps; None for no such maps.
    """

    def __init__(
        self,
        drone: Drone,
        link: Link | None,
        settings: AnswerSettings,
        folder: FlightFolder,
        log: GeotagLog,
        progress: Progress,
        provenance: Provenance,
        times: Times,
        tak: TakPublisher | None = None,
    ) -> None:
        self._drone = drone
        self._link = link
        self._settings = settings
        self._folder = folder
        self._log = log
        self._progress = progress
        self._provenance = provenance
        self._times = times
        self._tak = tak
        self._push_back = None if link is None else AutopilotHandoff(link, settings)
        self._texts = StatusTexts(link) if link is not None and settings.statustext else None
        self._stage: Stage | None = None
        self._timing: dict[str, float] = {}
        self._log_failed = False
        self._site: Sited | None = None
        self._outcome = Outcome()
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sidestep-log")
        self._flights: list[FlightSightings] = []
        self._seen: deque[KeyFrame] = deque(maxlen=SEEN_FRAMES)
        self.geotag: Geotag | None = None
        """The newest answer as it was told; `outcome` says whether it is in the log."""

    @property
    def outcome(self) -> Outcome:
        """What became of the newest answer so far."""
        return self._outcome

    def stage(self, stage: Stage, text: str) -> None:
        """Tell the terminal and the flight's log; a new stage also goes to the ground station."""
        self._progress.stage(stage, text)
        self._event(stage.value, text)
        if self._texts is not None and stage is not self._stage:
            self._texts.send(f"sidestep: {text}")
        self._stage = stage

    def frame(self, frame: Frame, track: Track | None) -> None:
        """Tell the terminal, and keep a picture now and then in case the flight gives no answer."""
        self._progress.frame(frame, track)
        if self._tak is not None:
            self._tak.drone(self._drone)
        if track is not None and (not self._seen or frame.t_s - self._seen[-1].t_s >= SEEN_INTERVAL_S):
            self._seen.append(KeyFrame(frame.image.copy(), frame.t_s, track))

    def sightings(self, flight: FlightSightings) -> None:
        """Keep the sightings, whatever follows; nothing waits for the disk."""
        self._flights.append(flight)
        flights = tuple(self._flights)
        self._later(lambda: self._attempt("sightings", lambda: self._folder.write_sightings(flights)))

    def located(self, located: LocateResult) -> None:
        """Tell the ground station and the terminal. Called in the flight's own loop: nothing here waits.

        Raises:
            AnswerError: the estimate holds numbers that cannot be.
        """
        site = sited(located.estimate, located.flight, self._drone.pose_at)
        self._site, self._outcome = site, Outcome()
        self.geotag = self._log.numbered(self._geotag(located, site)) if located.geodetic else None
        if self._link is not None and self.geotag is not None:
            separation = self.geotag.geoid_separation_m
            origin = located.flight.origin
            self._link.send(
                camera_tracking_geo_status(site.estimate, origin, site.drone_enu_m, geoid_separation_m=separation)
            )
        if self._tak is not None and self.geotag is not None:
            self._tak.target(self.geotag)
        self._say_result(site.estimate)
        self._timing["last_frame_to_answer_s"] = self._times.clock() - located.last_frame_s

    def keep(self, located: LocateResult) -> None:
        """Store the answer that was told; in another thread, while the flight is watched."""
        if self.geotag is not None:
            self._store(self.geotag)
        self._timing["last_frame_to_geotag_s"] = self._times.clock() - located.last_frame_s
        self._attempt("ADSB marker", self._show_as_traffic)
        self._write_answer()

    def finish(self, located: LocateResult) -> None:
        """After the aircraft holds: the region of interest, the waypoint, the pictures, and what became of all that.

        Not before it holds: ArduPilot forgets its region of interest at the next setpoint with a heading.
        """
        self._outcome = replace(self._outcome, ended=located.ended)
        self._hand_to_autopilot("roi", located.ended)
        self._timing["last_frame_to_roi_s"] = self._times.clock() - located.last_frame_s
        self._hand_to_autopilot("waypoint", located.ended)
        self._try_again_to_log()
        self._write_answer()
        self._attempt("estimate.json", lambda: self._write_estimate(located))
        self._attempt("plan view", lambda: self._folder.write_plan_view(self._plan_view(located)))
        reported, steadied = located.as_reported, located.steadied
        if reported is not None:
            fitted = partial(with_fitted_noise, reported, steadied=False)
            self._attempt("sightings as reported", lambda: self._folder.write_as_reported(fitted()))
        if steadied is not None:
            view = partial(steady_view, steadied, located.flight.id)
            self._attempt("steady view", lambda: self._folder.write_steady_view(view()))
        if located.key_frames:
            trails = None if steadied is None else steadied.trails
            sheet = partial(_contact_sheet, located.key_frames, trails)
            self._attempt("contact sheet", lambda: self._folder.write_contact_sheet(sheet()))

    def failed(self, error: SidestepError) -> None:
        """The flight ended by an error: keep why, and tell the ground station. An answer that was told stands."""
        self._event("failed", str(error))
        if self.geotag is None:
            said = f"no answer: {error.cause}"
            self._attempt("answer.json", lambda: self._folder.write_no_answer(error))
        else:
            said = f"{error.cause}; target {self.geotag.number} stands"
            self._progress.say(said)
            self._outcome = replace(self._outcome, ended=error.cause)
            self._hand_to_autopilot("roi", error.cause)
            self._hand_to_autopilot("waypoint", error.cause)
            self._write_answer()
        if self._seen:
            seen = tuple(self._seen)
            self._attempt("contact sheet", lambda: self._folder.write_contact_sheet(_contact_sheet(seen)))
        if self._texts is not None:
            self._texts.send(f"sidestep: {said}")

    def close(self) -> None:
        """Wait until the flight's log is on the disk. Safe to call twice."""
        self._writer.shutdown(wait=True)

    def _write_estimate(self, located: LocateResult) -> None:
        self._timing["frames_used_hz"] = self._progress.frame_rate_hz
        self._timing["sightings_hz"] = _rate(located)
        content = {
            "estimate": json.loads(estimate_line(located.estimate, located.flight.origin)),
            "comparisons": [json.loads(estimate_line(other, located.flight.origin)) for other in located.comparisons],
            "time_offset_s": None if located.offset is None else located.offset.offset_s,
            "timing": self._timing,
        }
        write_whole(self._folder.path / "estimate.json", f"{json.dumps(content, indent=2)}\n".encode())

    def _plan_view(self, located: LocateResult) -> bytes:
        return plan_view(
            located.flight,
            located.estimate if self._site is None else self._site.estimate,
            drone_track=located.drone_track,
            geodetic=located.geodetic,
        )

    def _geotag(self, located: LocateResult, site: Sited) -> Geotag:
        return make_geotag(
            site.estimate,
            located.flight.origin,
            id=located.flight.id,
            time_utc=self._times.utc_of(site.estimate.t_s),
            provenance=replace(self._provenance, sightings_file=str(self._folder.sightings_path)),
            drone_enu_m=site.drone_enu_m,
            geoid_separation_m=self._drone.telemetry().geoid_separation_m,
            picture=located.target_picture or b"",
        )

    def _store(self, tag: Geotag) -> None:
        """In the log, or beside it; with what is known then, `answer.json` is written at once."""
        try:
            logged = self._log.append(tag)
        except AnswerError as error:
            self._outcome = replace(self._outcome, not_logged=str(error))
            self._not_logged(tag, error.cause, "")
        else:
            self.geotag = logged.geotag
            self._outcome = replace(
                self._outcome, logged=not logged.warning, log=str(logged.path), not_logged=logged.warning
            )
            if logged.geotag.number != tag.number:
                self._tell("geotag", f"target {tag.number} is number {logged.geotag.number} in the log")
            if logged.warning:
                self._not_logged(logged.geotag, logged.warning, f"; kept in {logged.path}")
        self._write_answer()

    def _not_logged(self, tag: Geotag, why: str, kept: str) -> None:
        self._tell("geotag", f"target {tag.number} is not logged: {why.rstrip('.')}{kept}")
        if self._texts is not None:
            self._texts.send(f"sidestep: target {tag.number} not logged: {why}")

    def _try_again_to_log(self) -> None:
        """The other program may be done with the log by now."""
        tag, outcome = self.geotag, self._outcome
        if tag is None or outcome.logged or not outcome.log or self._log.merge():
            return
        self._outcome = replace(outcome, logged=True, log=str(self._log.path), not_logged="")
        self._tell("geotag", f"target {tag.number} is in the log now")

    def _write_answer(self) -> None:
        if (tag := self.geotag) is not None:
            self._attempt("answer.json", lambda: self._folder.write_answer(tag, self._outcome))

    def _hand_to_autopilot(self, what: What, over: str) -> None:
        """To the autopilot, where the settings want it done without being asked for; not when the flight is over."""
        tag, autopilot_handoff = self.geotag, self._push_back
        if tag is None or autopilot_handoff is None or not autopilot_handoff.automatic(what):
            return
        try:
            said = f"not sent: the flight is over ({over})" if over else autopilot_handoff.do(what, tag)
        except AnswerError as error:
            said = f"failed: {error}"
        if what == "roi":
            self._outcome = replace(self._outcome, region_of_interest=said)
        else:
            self._outcome = replace(self._outcome, waypoint=said)
        self._tell(WORDS[what], said)

    def _show_as_traffic(self) -> None:
        """To a ground station, where the settings name one; goes on by itself until the marker's time is over."""
        url = self._settings.adsb_url
        if self.geotag is None or self._link is None or url is None:
            return
        system, component = self._link.source_system, self._link.source_component
        AdsbMirror(url, self.geotag, self._settings.adsb_lifetime_s, system=system, component=component)

    def _say_result(self, estimate: Estimate) -> None:
        text = _in_words(self.geotag, estimate)
        if self._texts is not None:
            self._texts.send(text)
        self._tell("answer", text)

    def _attempt(self, what: str, do: Callable[[], object]) -> None:
        """Something that may fail without taking the answer back."""
        try:
            do()
        except (AnswerError, SettingsError) as error:
            self._tell(what, str(error))

    def _tell(self, what: str, text: str) -> None:
        self._progress.say(f"{what}: {text}")
        self._event(what, text)

    def _event(self, kind: str, text: str) -> None:
        """A line of the flight's log, written in another thread: a slow disk must not silence the flight's own loop."""
        self._later(partial(self._write_event, self._times.utc(), kind, text))

    def _later(self, work: Callable[[], object]) -> None:
        """In the thread that writes; here, once that has ended."""
        try:
            self._writer.submit(work)
        except RuntimeError:  # closed: work of an aborted flight comes to its end
            work()

    def _write_event(self, when: datetime, kind: str, text: str) -> None:
        """A full disk is told once and does not stop the flight."""
        try:
            self._folder.event(when, kind, text)
        except AnswerError as error:
            if not self._log_failed:
                self._progress.say(str(error))
            self._log_failed = True


def _in_words(tag: Geotag | None, estimate: Estimate) -> str:
    if tag is not None:
        return f"target {tag.number}: {tag.place.lat_deg:.6f} {tag.place.lon_deg:.6f} CE90 {tag.ce90_m:.1f} m"
    east, north, up = estimate.position_enu_m
    return f"target: {east:+.1f} m E {north:+.1f} m N {up:+.1f} m up of the start"


def _contact_sheet(frames: Sequence[KeyFrame], trails: PointTrails | None = None) -> bytes:
    return contact_sheet(frames, started_s=frames[0].t_s, trails=trails)


def _rate(located: LocateResult) -> float:
    sightings = located.flight.sightings
    span_s = sightings[-1].t_s - sightings[0].t_s
    return (len(sightings) - 1) / span_s if span_s > 0.0 else 0.0
