"""Following one person through a part of a recorded video, as the procedure does in flight, and what that tells."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import cast

from mission.bundle import BundleSolution
from mission.camera.camera import Camera
from mission.detect import Detector
from mission.errors import DetectionError
from mission.estimate import ESTIMATORS
from mission.estimate.noise_fit import with_fitted_noise
from mission.observation.file_video import Picture
from mission.pose.buffer import Pose, PoseAt
from mission.procedure.flight_record import PICTURES, FlightRecord
from mission.procedure.pointing import Pointing, TargetTracker
from mission.records import Detection, Estimate, FlightSightings, Frame, GeodeticOrigin, NoiseModel, TargetPrior
from mission.vehicle.drone import Drone

_START_TRIES_S = 3.0
"""How long it is tried to begin following somebody whom the detector saw."""


@dataclass(frozen=True, slots=True)
class _Watched:
    """What `Pointing` asks of a drone that flew long ago: where it was."""

    at: PoseAt

    def pose_at(self, t_s: float) -> Pose | None:
        return self.at(t_s)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What was seen of one person."""

    record: FlightRecord
    share: float
    """Of the frames, those in which the person was tracked."""
    last_s: float
    """Video time of the last frame looked at."""


def follow(
    pictures: Iterable[Picture],
    looks: dict[float, Detection],
    name: str,
    duration_s: float,
    pose_at: PoseAt,
    offset_s: float,
    camera: Camera,
    detector: Detector,
    tracker: TargetTracker,
) -> Seen:
    """Follow the person who was detected.

    Args:
        pictures: of the part of the video, from the first detection on.
        looks: by video time: where the person was detected; the tracker is started on one of them.
        name: of the flight's record.
        duration_s: of the part, for how often a picture is kept.
        pose_at: the camera carrier's pose at a time of the log.
        offset_s: how much later than the log's clock the video's runs.
        camera: lens and mounting.
        detector: looks again where the tracker does not take a detection.
        tracker: not yet started.

    Raises:
        DetectionError: the tracker cannot be started on the person.
    """
    record = FlightRecord(name, camera, interval_s=max(duration_s, 1.0) / PICTURES)
    pointing = Pointing(cast(Drone, _Watched(pose_at)), camera, tracker, cautious=False)
    pointing.trust(offset_s)
    started, begun_s, last_s, tracked, number = False, None, 0.0, 0, 0
    why = "nobody was there when the video was looked at again"
    for picture in pictures:
        last_s = picture.t_s
        begun_s = last_s if begun_s is None else begun_s
        frame: Frame
        if not started:
            if last_s - begun_s > _START_TRIES_S:
                break
            look = _nearest(looks, last_s)
            if look is None:
                continue
            frame = picture.frame()
            pointing.pass_over(frame)
            try:
                tracker.start(frame, _again(detector, frame, look).box, pointing.roll_rad)
            except DetectionError as error:
                why = error.cause
                continue
            started = True
            continue
        frame = picture.frame()
        track = pointing.follow(frame)
        record.add(frame, track, pointing.roll_rad)
        number += 1
        tracked += track.state == "tracking"
        if track.state == "lost":
            break
    if not started:
        raise DetectionError(f"the person could not be followed: {why}")
    return Seen(record, tracked / max(number, 1), last_s)


def _nearest(looks: dict[float, Detection], t_s: float) -> Detection | None:
    """The detection of this very picture."""
    return next((one for at_s, one in looks.items() if abs(at_s - t_s) < 1e-3), None)


def _again(detector: Detector, frame: Frame, look: Detection) -> Detection:
    """The better detector's box of the same person, where it has one: followed bodies begin with whole ones."""
    found = [one for one in detector.detect(frame.image) if one.box.overlap(look.box) > 0.3]
    return max(found, key=lambda one: one.box.overlap(look.box), default=look)


def sightings(
    seen: Seen,
    origin: GeodeticOrigin,
    pose_at: PoseAt,
    offset_s: float,
    noise: NoiseModel,
    prior: TargetPrior,
) -> tuple[FlightSightings, BundleSolution]:
    """The sightings with the poses steadied by the background, where it allows that, and the noise that they support.

    Args:
        seen: of the person.
        origin: of the local frame.
        pose_at: the carrier's pose at a time of the log.
        offset_s: between video and log.
        noise: of the pose at a frame's time.
        prior: of the person.
    """
    steadied = seen.record.steadied(pose_at, offset_s, noise)
    stated = seen.record.sightings(origin, pose_at, offset_s, noise, prior, steadied)
    return with_fitted_noise(stated, steadied=steadied.reason is None), steadied


def estimate(flight: FlightSightings, steadied: BundleSolution, notes: tuple[str, ...] = ()) -> Estimate:
    """Where the person was.

    Raises:
        EstimateRefused: what was seen supports no position.
    """
    found = ESTIMATORS["batch"].estimate(flight)
    return replace(found, notes=(*found.notes, steadied.note(), *notes))
