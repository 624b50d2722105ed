"""The mission's own eyes on a rendered flight: detector, tracker, pointing, time offset, record; without the wire."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import cast

from mission.detect import Confirmation, Detector, choose
from mission.errors import DetectionError
from mission.pose.buffer import Pose
from mission.procedure.flight_record import PICTURES, FlightRecord
from mission.procedure.pointing import Pointing, TargetTracker
from mission.records import NoiseModel
from mission.timing.flight_offset import UNKNOWN_OFFSET_S, FlightOffset, offset_uncertain
from mission.timing.time_offset import TimeOffset, TimeOffsetMeter
from mission.track import Track
from mission.vehicle.drone import Drone
from sitl.camera.view import PersonView
from sitl.evaluation.rendered.flight import Moment, RenderedFlight


@dataclass(frozen=True, slots=True)
class _Watched:
    """What `Pointing` asks of a drone: where it was. It takes no orders."""

    flight: RenderedFlight

    def pose_at(self, t_s: float) -> Pose | None:
        return self.flight.pose_at(t_s)


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """A frame of the pattern: what the tracker made of it, and what is true."""

    capture_s: float
    track: Track
    truth: PersonView | None


@dataclass(slots=True)
class Replay:
    """What the mission has at the end of the pattern, and what the simulation knows of it."""

    record: FlightRecord
    offset: TimeOffset | None = None
    """As measured on the turn, or where that did not tell it well enough on the pattern too; None where neither did."""
    tracked: list[Tracked] = field(default_factory=list)
    track_ms: float = 0.0
    """Processor time per frame of the pattern, for the target."""
    steady_ms: float = 0.0
    """And for the background."""
    render_ms: float = 0.0
    """Processor time per frame that the simulation took."""

    @property
    def offset_s(self) -> float:
        """How much later than telemetry the video's clock is taken to run."""
        return 0.0 if self.offset is None else self.offset.offset_s

    def pose_noise(self, stated: NoiseModel) -> NoiseModel:
        """The noise of the pose at a frame's time, as `mission.procedure.locate` takes it: worse where the offset is.

        Args:
            stated: of the aircraft.
        """
        return offset_uncertain(stated, UNKNOWN_OFFSET_S if self.offset is None else self.offset.sigma_s)

    @property
    def share(self) -> float:
        """Of the pattern's frames, those in which the target was tracked."""
        return sum(one.track.state == "tracking" for one in self.tracked) / max(1, len(self.tracked))


def replay(
    flight: RenderedFlight,
    detector: Detector,
    tracker: TargetTracker,
    look: Callable[[Moment], None] | None = None,
) -> Replay:
    """Find the person, measure the time offset on the turn, and follow them through the pattern as the mission does.

    The operator's click decides who is meant.

    Args:
        flight: to be rendered.
        detector: finds people.
        tracker: not yet started.
        look: is shown each moment of the pattern, outside of the times that are taken.

    Raises:
        DetectionError: nobody is found before the pattern begins, or not where the operator clicks.
    """
    record = FlightRecord(flight.case.name, flight.camera, interval_s=flight.duration_s / PICTURES)
    followed = Replay(record)
    pointing = Pointing(cast(Drone, _Watched(flight)), flight.camera, tracker, cautious=True)
    meter = TimeOffsetMeter(flight.camera)
    offset = FlightOffset(meter)
    search = _Search(detector, tracker)
    mission_s, frames, began_s = 0.0, 0, time.process_time()
    for moment in flight.moments():
        frames += 1
        frame = moment.frame
        asked_s = time.process_time()
        if moment.stage == "turn":
            turn = meter.add(frame)
            if search.found:
                pointing.follow(frame, turn)
            else:
                search.look(moment)
            mission_s += time.process_time() - asked_s
            continue
        if not search.found:
            raise DetectionError("nobody was found before the pattern began")
        if not followed.tracked:
            offset.found = followed.offset = meter.measure(flight.pose_at)
            pointing.trust(followed.offset_s)
            asked_s = time.process_time()
        track = pointing.follow(frame)
        tracked_s = time.process_time()
        record.add(frame, track, pointing.roll_rad)
        added_s = time.process_time()
        offset.add(frame)
        mission_s += time.process_time() - asked_s
        followed.track_ms += 1e3 * (tracked_s - asked_s)
        followed.steady_ms += 1e3 * (added_s - tracked_s)
        followed.tracked.append(Tracked(moment.capture_s, track, moment.target))
        if look is not None:
            look(moment)
        if track.state == "lost":
            break
    offset.measure_again(flight.pose_at)
    followed.offset = offset.found
    followed.track_ms /= max(1, len(followed.tracked))
    followed.steady_ms /= max(1, len(followed.tracked))
    followed.render_ms = 1e3 * (time.process_time() - began_s - mission_s) / max(1, frames)
    return followed


class _Search:
    """Two looks running that show the same person, as `mission.procedure.locate` wants it."""

    def __init__(self, detector: Detector, tracker: TargetTracker) -> None:
        self._detector, self._tracker = detector, tracker
        self._confirmation = Confirmation()
        self.found = False

    def look(self, moment: Moment) -> None:
        steady = self._confirmation.confirmed(self._detector.detect(moment.frame.image))
        if steady and moment.target is not None:
            height, width = moment.frame.image.shape[:2]
            try:
                target = choose(steady, (width, height), point=moment.target.pixel)
                self._tracker.start(moment.frame, target.box)
            except DetectionError:
                return  # not the one who is meant; the next look may show more
            self.found = True
