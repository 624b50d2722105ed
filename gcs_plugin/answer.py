"""What becomes of an answer: the geotag first, then the aircraft and the ground station, then pictures for people.

The geotag is on the disk before anything is sent. What cannot be done afterwards (a region of interest refused, a
picture that does not fit on the disk) is told and logged, and takes nothing back.
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

import numpy as np

from gcs_plugin.adsb import AdsbMirror
from gcs_plugin.contact_sheet import contact_sheet
from gcs_plugin.durable import write_whole
from gcs_plugin.flight_folder import FlightFolder
from gcs_plugin.geotags import Geotag, GeotagLog, Provenance, make_geotag
from gcs_plugin.plan_view import plan_view
from gcs_plugin.progress import Progress
from gcs_plugin.publish import Link, StatusTexts, camera_tracking_geo_status
from gcs_plugin.push_back import WORDS, PushBack, What
from gcs_plugin.steady_view import steady_view
from mission.drones.drone import Drone
from mission.errors import AnswerError, SettingsError, SidestepError
from mission.estimate.answer_line import estimate_line
from mission.estimate.noise_fit import supported
from mission.flight_record import KeyFrame
from mission.located import Located, Stage
from mission.records import Estimate, FlightSightings, Frame
from mission.settings import AnswerSettings
from mission.steady import PointTrails
from mission.track import Track

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


class Answer:
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
    ) -> None:
        self._drone = drone
        self._link = link
        self._settings = settings
        self._folder = folder
        self._log = log
        self._progress = progress
        self._provenance = provenance
        self._times = times
        self._push_back = None if link is None else PushBack(drone, link, settings)
        self._texts = StatusTexts(link) if link is not None and settings.statustext else None
        self._stage: Stage | None = None
        self._timing: dict[str, float] = {}
        self._log_failed = False
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sidestep-log")
        self._flights: list[FlightSightings] = []
        self._seen: deque[KeyFrame] = deque(maxlen=SEEN_FRAMES)
        self.geotag: Geotag | None = None
        """The acknowledged geotag."""

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
        if track is not None and (not self._seen or frame.t_s - self._seen[-1].t_s >= SEEN_INTERVAL_S):
            self._seen.append(KeyFrame(frame.image.copy(), frame.t_s, track))

    def sightings(self, flight: FlightSightings) -> None:
        """Keep the sightings, whatever follows."""
        self._flights.append(flight)
        self._attempt("sightings", lambda: self._folder.write_sightings(self._flights))

    def located(self, located: Located) -> None:
        """Log the geotag, then send it."""
        if located.geodetic:
            tag = self._geotag(located)
            logged = self._log.append(tag)
            self.geotag = logged.geotag
            if logged.warning:
                self._tell("geotag", logged.warning)
        published = self._sited(located.estimate)
        if self._link is not None and located.geodetic:
            self._link.send(self._geo_status(located, published))
        self._timing["last_frame_to_geotag_s"] = self._times.clock() - located.last_frame_s
        self._give_back("roi", located)
        self._timing["last_frame_to_roi_s"] = self._times.clock() - located.last_frame_s
        self._attempt("ADSB marker", self._show_as_traffic)
        self._say_result()

    def finish(self, located: Located) -> None:
        """After the aircraft holds: the waypoint, the pictures and `answer.json`."""
        self._give_back("waypoint", located)
        if self.geotag is not None:
            tag = self.geotag
            self._attempt("answer.json", lambda: self._folder.write_answer(tag))
        self._attempt("estimate.json", lambda: self._write_estimate(located))
        self._attempt("plan view", lambda: self._folder.write_plan_view(self._plan_view(located)))
        reported, steadied = located.as_reported, located.steadied
        if reported is not None:
            fitted = partial(supported, reported, steadied=False)
            self._attempt("sightings as reported", lambda: self._folder.write_as_reported(fitted()))
        if steadied is not None:
            view = partial(steady_view, steadied, located.flight.id)
            self._attempt("steady view", lambda: self._folder.write_steady_view(view()))
        if located.key_frames:
            trails = None if steadied is None else steadied.trails
            sheet = partial(_contact_sheet, located.key_frames, trails)
            self._attempt("contact sheet", lambda: self._folder.write_contact_sheet(sheet()))

    def failed(self, error: SidestepError) -> None:
        """The flight gave no answer: keep why, and tell the ground station."""
        self._event("failed", str(error))
        self._attempt("answer.json", lambda: self._folder.write_no_answer(error))
        if self._seen:
            seen = tuple(self._seen)
            self._attempt("contact sheet", lambda: self._folder.write_contact_sheet(_contact_sheet(seen)))
        if self._texts is not None:
            self._texts.send(f"sidestep: no answer: {error.cause}")

    def close(self) -> None:
        """Wait until the flight's log is on the disk. Safe to call twice."""
        self._writer.shutdown(wait=True)

    def _write_estimate(self, located: Located) -> None:
        self._timing["frames_used_hz"] = self._progress.frame_rate_hz
        self._timing["sightings_hz"] = _rate(located)
        content = {
            "estimate": json.loads(estimate_line(located.estimate, located.flight.origin)),
            "comparisons": [json.loads(estimate_line(other, located.flight.origin)) for other in located.comparisons],
            "time_offset_s": None if located.offset is None else located.offset.offset_s,
            "timing": self._timing,
        }
        write_whole(self._folder.path / "estimate.json", f"{json.dumps(content, indent=2)}\n".encode())

    def _plan_view(self, located: Located) -> bytes:
        return plan_view(
            located.flight,
            self._sited(located.estimate),
            drone_track=located.drone_track,
            geodetic=located.geodetic,
        )

    def _geotag(self, located: Located) -> Geotag:
        estimate = self._sited(located.estimate)
        pose = self._drone.pose_at(estimate.t_s)
        return make_geotag(
            estimate,
            located.flight.origin,
            id=located.flight.id,
            time_utc=self._times.utc_of(estimate.t_s),
            provenance=replace(self._provenance, sightings_file=str(self._folder.sightings_path)),
            drone_enu_m=None if pose is None else pose.position_enu_m,
            geoid_separation_m=self._drone.telemetry().geoid_separation_m,
            picture=located.target_picture or b"",
        )

    def _sited(self, estimate: Estimate) -> Estimate:
        """With the uncertainty of the aircraft's own place, which a place on the earth has and a distance has not."""
        pose = self._drone.pose_at(estimate.t_s)
        if pose is None or estimate.covariance is None:
            return estimate
        covariance = estimate.covariance.copy()
        covariance[:3, :3] += pose.position_covariance_m2
        return replace(estimate, covariance=covariance)

    def _geo_status(self, located: Located, published: Estimate) -> object:
        pose = self._drone.pose_at(published.t_s)
        return camera_tracking_geo_status(
            published,
            located.flight.origin,
            None if pose is None else np.asarray(pose.position_enu_m),
            geoid_separation_m=self._drone.telemetry().geoid_separation_m,
        )

    def _give_back(self, what: What, located: Located) -> None:
        """To the autopilot, where the settings want it done without being asked for; not when others have it now."""
        tag, push_back = self.geotag, self._push_back
        if tag is None or push_back is None or not push_back.automatic(what):
            return
        if located.ended:
            self._tell(WORDS[what], f"not sent: the aircraft is not ours any more ({located.ended})")
        else:
            self._attempt(WORDS[what], lambda: self._tell(WORDS[what], push_back.do(what, tag)))

    def _show_as_traffic(self) -> None:
        """To a ground station, where the settings name one; goes on by itself until the marker's time is over."""
        url = self._settings.adsb_url
        if self.geotag is None or self._link is None or url is None:
            return
        system, component = self._link.source_system, self._link.source_component
        AdsbMirror(url, self.geotag, self._settings.adsb_lifetime_s, system=system, component=component)

    def _say_result(self) -> None:
        if self.geotag is None or self._texts is None:
            return
        tag = self.geotag
        self._texts.send(
            f"target {tag.number}: {tag.place.lat_deg:.6f} {tag.place.lon_deg:.6f} CE90 {tag.ce90_m:.1f} m"
        )

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
        self._writer.submit(self._write_event, self._times.utc(), kind, text)

    def _write_event(self, when: datetime, kind: str, text: str) -> None:
        """A full disk is told once and does not stop the flight."""
        try:
            self._folder.event(when, kind, text)
        except AnswerError as error:
            if not self._log_failed:
                self._progress.say(str(error))
            self._log_failed = True


def _contact_sheet(frames: Sequence[KeyFrame], trails: PointTrails | None = None) -> bytes:
    return contact_sheet(frames, started_s=frames[0].t_s, trails=trails)


def _rate(located: Located) -> float:
    sightings = located.flight.sightings
    span_s = sightings[-1].t_s - sightings[0].t_s
    return (len(sightings) - 1) / span_s if span_s > 0.0 else 0.0
