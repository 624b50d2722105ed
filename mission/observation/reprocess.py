"""A recorded video and its log in, located people out: which, where, how sure; and for the others why not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mission.camera.camera import UNCALIBRATED_FOCAL_SIGMA, Camera
from mission.camera.model import CameraModel
from mission.camera.mounting import Mounting
from mission.detect import Detector, NanoDetDetector, make_detector
from mission.detect.nanodet import NanoDet
from mission.errors import CalibrationError, DetectionError, EstimateRefused, VideoError
from mission.logs.pose_log import PoseLog
from mission.observation.candidates import Candidate, candidates
from mission.observation.file_video import FileVideo
from mission.observation.follow import estimate, follow, sightings
from mission.observation.self_calibration import FoundLens, find_focal_length, with_focal_length
from mission.observation.survey import Survey, survey
from mission.observation.time_search import FoundTime, find_time
from mission.observation.worth import Part, best_part
from mission.pose.buffer import PoseAt
from mission.records import Estimate, FlightSightings, Matrix, NoiseModel, TargetPrior, Vector
from mission.sighting import camera_position, world_from_camera
from mission.timing.flight_offset import offset_uncertain
from mission.track import Tracker

_GUESSED_HFOV_RAD = math.radians(70.0)
"""Of most cameras on drones, to a third: where nothing is known the flight's turns tell better."""
_HOPEFUL = 2.0
"""A part whose bound is worse than wanted by this factor is not measured: the bound is that of one good motion."""
_LEAST_LATERAL = 0.03
"""The camera must have gone to the side by this share of the distance."""
_LEAST_SHARE = 0.4
_RAY_TILT_RAD = math.radians(0.7)
_RAY_GROUND_M = 2.0
"""How far the ground may be from the take-off point's level, 1-sigma, where no terrain is given."""
_LEAST_DOWN_RAD = math.radians(4.0)
_MIDDLE_M = 0.85


@dataclass(frozen=True, slots=True)
class Options:
    """What is asked of a recorded flight."""

    wanted: float = 0.25
    """Largest 1-sigma of the distance, over the distance, that is given as a place."""
    detect_hz: float = 2.0
    offset_s: float | None = None
    """Video time less log time, where it is known."""
    hfov_rad: float | None = None
    """Full horizontal angle of view, where it is known and no camera file is given."""
    tilt_down_rad: float = 0.0
    """Of a fixed camera without a camera file."""
    most_targets: int = 50
    prior: TargetPrior = field(default_factory=lambda: TargetPrior(class_height="use"))


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """Somebody who was located."""

    candidate: Candidate
    part: Part
    flight: FlightSightings
    estimate: Estimate
    relative_sigma: float
    """1-sigma of the distance at the first sighting over the distance."""
    camera_path: Matrix
    """(n, 4): log time, east, north, up."""
    picture: bytes
    """JPEG; empty where there is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Ray:
    """Somebody who was seen but not located: a line of sight, and where it meets level ground where that is known."""

    candidate: Candidate
    t_s: float
    """Of the log."""
    camera_enu_m: Vector
    azimuth_rad: float
    elevation_rad: float
    ground_enu_m: Vector | None
    """(3,) where the line meets the take-off point's level; None where that is not known, or too flat."""
    ground_sigma_m: tuple[float, float] | None
    """Along and across the line of sight, on that ground."""
    why: str
    """Why there is no place."""


@dataclass(frozen=True, slots=True, eq=False)
class Reprocessed:
    """All that came of a flight."""

    survey: Survey
    time: FoundTime
    camera: Camera
    lens_note: str
    targets: tuple[Target, ...]
    rays: tuple[Ray, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Means:
    """What the work is done with; shared by all people of a flight."""

    looking: Detector
    """Twice a second."""
    starting: Detector
    network: NanoDet

    @classmethod
    def usual(cls) -> Means:
        """The network alone for looking, network and HOG for where to begin."""
        return cls(NanoDetDetector(), make_detector("auto"), NanoDet())


def reprocess(
    video: FileVideo,
    log: PoseLog,
    camera: Camera | None,
    options: Options,
    means: Means,
    name: str = "flight",
    progress: Callable[[str], None] = lambda _: None,
) -> Reprocessed:
    """Locate everybody whom a recorded flight shows well enough.

    Args:
        video: the pictures.
        log: the poses.
        camera: from a camera file, for pictures of the video's size; None where there is none.
        options: what is asked.
        means: detectors and network.
        name: of the flight, for the records.
        progress: is told what goes on.

    Raises:
        VideoError: no picture can be read.
        LogError: the log tells no attitude, or the video has no place in it.
        CalibrationError: the lens is not known and the flight does not tell it.
    """
    if log.pointing is None:
        log.pose_at()  # says why
    guess = _camera(video, log, camera, options)
    facts = video.facts

    def told(at_s: float) -> None:
        whole = f" of {facts.duration_s:.0f}" if facts.duration_s > 0.0 else ""
        progress(f"looking through the video: {at_s:.0f}{whole} s")

    seen = survey(video, guess, means.looking, options.detect_hz, told)
    if seen.pictures < 2:
        raise VideoError(f"The video {video.path.name} holds {seen.pictures} pictures", "Copy it from the card again.")
    lens, time, lens_note, notes = _placed(seen, video, log, camera, guess, options)
    progress(time.how)
    if seen.damaged:
        notes.append(f"{seen.damaged} packets of the video are damaged")
    pose_at, noise = log.pose_at(), offset_uncertain(log.noise, time.sigma_s)
    people = candidates(seen.looks, pose_at, lens, time.offset_s)
    targets: list[Target] = []
    rays: list[Ray] = []
    for one in people[: options.most_targets]:
        progress(f"person {one.number} of {len(people)}")
        found = _locate(one, video, log, lens, time, noise, pose_at, options, means, name)
        if isinstance(found, Target):
            targets.append(found)
        else:
            ray = _ray(one, log, lens, time.offset_s, pose_at, found)
            if ray is not None:
                rays.append(ray)
    if len(people) > options.most_targets:
        notes.append(f"{len(people) - options.most_targets} more people were seen than are looked at")
    return Reprocessed(seen, time, lens, lens_note, tuple(targets), tuple(rays), tuple(notes))


def _camera(video: FileVideo, log: PoseLog, camera: Camera | None, options: Options) -> Camera:
    """The camera as far as it is known before the video was looked through; straight ahead on a gimbal."""
    facts = video.facts
    if camera is None:
        hfov = options.hfov_rad or log.hfov_rad or _GUESSED_HFOV_RAD
        mounting = Mounting.tilted(options.tilt_down_rad)
        camera = Camera.from_field_of_view(facts.width_px, facts.height_px, hfov, mounting)
    if log.gimbal is not None:
        level = Mounting.tilted(0.0)
        camera = Camera(
            camera.intrinsics,
            level,
            camera.calibrated,
            camera.readout_s,
            camera.latency_s,
            camera.focal_sigma,
            camera.provenance,
        )
    return camera


def _placed(
    seen: Survey, video: FileVideo, log: PoseLog, camera: Camera | None, guess: Camera, options: Options
) -> tuple[Camera, FoundTime, str, list[str]]:
    """Lens and time of the video; the lens first roughly, since the time does not hang on it much."""
    begun = video.facts.created_utc_s
    start_s = None
    if begun is not None and log.utc_at_zero_s is not None:
        start_s = -(begun - log.utc_at_zero_s)
    sigma_s = 5.0
    if options.offset_s is not None:
        start_s, sigma_s = options.offset_s, 0.05
    time = find_time(seen.curve.turns(guess), log, guess, start_s, sigma_s)
    notes: list[str] = []
    if log.zoomed:
        notes.append("the camera was zoomed: the angle of view is the usual one of the flight")
    found = find_focal_length(seen.curve, log, guess, time.offset_s) if time.measured else None
    lens, note = _lens(guess, camera, found, log, options)
    if lens is not guess and time.measured:
        offset_s, offset_sigma = time.offset_s, 0.3
        pose_at = log.pose_at()
        turns = seen.curve.turns(lens, lambda t_s: pose_at(t_s - offset_s))
        time = find_time(turns, log, lens, offset_s, offset_sigma)
    return lens, time, note, notes


def _lens(
    guess: Camera, camera: Camera | None, found: FoundLens | None, log: PoseLog, options: Options
) -> tuple[Camera, str]:
    if camera is not None:
        note = camera.provenance or "camera file"
        if found is not None:
            off = found.camera.intrinsics.fx / guess.intrinsics.fx - 1.0
            if abs(off) > 4.0 * math.hypot(found.sigma, guess.focal_sigma):
                note += f"; the flight's turns speak of a focal length {100.0 * off:+.1f} % off"
                return with_focal_length(guess, 1.0, max(guess.focal_sigma, abs(off)), note), note
        return guess, note
    if found is not None:
        return found.camera, found.camera.provenance
    if options.hfov_rad is not None or log.hfov_rad is not None:
        whose = "as given" if options.hfov_rad is not None else "as the log says"
        hfov = options.hfov_rad or log.hfov_rad or 0.0
        note = f"{math.degrees(hfov):.1f} deg of view {whose}, not measured ({100 * UNCALIBRATED_FOCAL_SIGMA:.0f} %)"
        return guess, note
    raise CalibrationError(
        "the lens is not known, and the flight turned too little to tell its focal length",
        "Give the camera file (--camera, from `sidestep calibrate`) or the angle of view (--hfov-deg).",
    )


def _locate(
    one: Candidate,
    video: FileVideo,
    log: PoseLog,
    lens: Camera,
    time: FoundTime,
    noise: NoiseModel,
    pose_at: PoseAt,
    options: Options,
    means: Means,
    name: str,
) -> Target | str:
    """A target, or why there is none."""
    part = best_part(one, pose_at, lens, time.offset_s, noise, options.prior)
    if part.lateral < _LEAST_LATERAL:
        return (
            f"no lateral motion: the camera went {100.0 * part.lateral:.1f} % of the distance to the side while the "
            f"person was in view; it takes {100.0 * _LEAST_LATERAL:.0f} %"
        )
    if not part.relative_sigma <= _HOPEFUL * options.wanted:
        worth = "not at all" if math.isinf(part.relative_sigma) else f"to {100.0 * part.relative_sigma:.0f} % at best"
        return f"the path flown tells the distance {worth}; {100.0 * options.wanted:.0f} % are wanted"
    looks = {t_s: found for t_s, found in one.looks if part.from_s - 1e-3 <= t_s <= part.to_s}
    try:
        seen = follow(
            video.pictures(part.from_s, part.to_s),
            looks,
            f"{name}-{one.number}",
            part.to_s - part.from_s,
            pose_at,
            time.offset_s,
            lens,
            means.starting,
            Tracker(means.network),
        )
        if seen.share < _LEAST_SHARE:
            return f"the person was followed in only {100.0 * seen.share:.0f} % of the pictures"
        prior = options.prior
        flight, steadied = sightings(seen, log.origin, pose_at, time.offset_s, noise, prior)
        answer = estimate(flight, steadied, log.notes)
    except (DetectionError, EstimateRefused) as error:
        return error.cause
    relative = _relative_sigma(answer)
    if not relative <= options.wanted:
        return f"the distance is known to {100.0 * relative:.0f} % only; {100.0 * options.wanted:.0f} % are wanted"
    path = seen.record.drone_track(pose_at, time.offset_s)
    return Target(one, part, flight, answer, relative, path, seen.record.target_picture() or b"")


def _relative_sigma(answer: Estimate) -> float:
    """1-sigma of the longest axis on the ground over the distance, at the first sighting."""
    covariance = answer.covariance if answer.first is None else answer.first.covariance
    if covariance is None or not answer.depth_m > 0.0:
        return math.inf
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), 0.0)) / answer.depth_m


def _ray(one: Candidate, log: PoseLog, lens: Camera, offset_s: float, pose_at: PoseAt, why: str) -> Ray | None:
    """The line of sight in the middle of a track; None where the pose is not known there."""
    known = [(t_s, look, pose) for t_s, look in one.looks if (pose := pose_at(t_s - offset_s)) is not None]
    if not known:
        return None
    t_s, look, pose = known[len(known) // 2]
    place = camera_position(pose, lens)
    ray = world_from_camera(pose, lens).apply(CameraModel(lens.intrinsics).ray(np.array(look.box.centre_px)))
    ray = ray / np.linalg.norm(ray)
    elevation = math.asin(float(np.clip(ray[2], -1.0, 1.0)))
    ground, sigma = None, None
    if log.take_off_up_m is not None and elevation < -_LEAST_DOWN_RAD:
        above = float(place[2]) - log.take_off_up_m - _MIDDLE_M
        if above > 0.0:
            away = above / math.tan(-elevation)
            direction = ray[:2] / np.linalg.norm(ray[:2]) if abs(elevation) < math.radians(89.9) else np.zeros(2)
            ground = np.array([*(place[:2] + away * direction), log.take_off_up_m + _MIDDLE_M])
            tilt = math.hypot(log.noise.tilt_bias_sigma_rad, _RAY_TILT_RAD)
            along = math.hypot(above * tilt / math.sin(elevation) ** 2, _RAY_GROUND_M / math.tan(-elevation))
            heading = math.hypot(log.noise.heading_bias_sigma_rad, lens.focal_sigma * 0.3)
            sigma = along, away * heading
    azimuth = math.atan2(float(ray[0]), float(ray[1])) % (2.0 * math.pi)
    return Ray(one, t_s - offset_s, place, azimuth, elevation, ground, sigma, why)
