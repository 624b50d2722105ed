"""What was seen during one sidestep, kept until every frame's pose is known, then turned into the estimator's input."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from mission.bundle import BundleAdjuster, BundleSolution, rows_at
from mission.camera.camera import Camera
from mission.detect import Detector, NanoDetDetector
from mission.pose.buffer import Pose
from mission.records import (
    FlightSightings,
    Frame,
    GeodeticOrigin,
    Image,
    Matrix,
    NoiseModel,
    Sighting,
    TargetPrior,
)
from mission.sighting import cameras_at, sighting, sighting_from
from mission.track import Track
from mission.track.noise import PIXEL_CORRELATION_S, SIZE_CORRELATION_S

PICTURES = 15.0
"""Key frames that a sidestep is planned to have."""
KEY_FRAMES = 20
"""Key frames kept at most; people see them, and people are looked for in them."""
PICTURE_MARGIN = 0.4
"""Room around the target in its picture, as a fraction of its box."""
DEFAULT_SIZE_SIGMA = 0.04
_CROWDED = 0.75
"""Share of the background that stands still, below which people are looked for; 191 of 194 streets had more."""
_PEOPLE_SCORE = 0.3
"""NanoDet's, from which on somebody is left out of the background: who is nobody costs but a few points."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A frame's track, at the frame's time on the program's clock as the video tells it."""

    t_s: float
    track: Track


@dataclass(frozen=True, slots=True, eq=False)
class KeyFrame:
    """A picture that people will see, with what the tracker made of it."""

    image: Image
    t_s: float
    track: Track


@dataclass(slots=True)
class FlightRecord:
    """Collects the tracks of a sidestep and the pictures for people.

    Args:
        id: the flight's name.
        camera: what turns pixels into bearings.
        interval_s: time between key frames.
    """

    id: str
    camera: Camera
    interval_s: float
    seen: list[Seen] = field(default_factory=list)
    key_frames: list[KeyFrame] = field(default_factory=list)
    steadier: BundleAdjuster = field(init=False)
    """Follows the background."""

    def __post_init__(self) -> None:
        """Start without any points."""
        self.steadier = BundleAdjuster(self.camera)

    def add(self, frame: Frame, track: Track, roll_rad: float = 0.0) -> None:
        """Keep a frame's track, follow its background, and keep the frame itself now and then.

        Args:
            frame: the picture.
            track: the target in it.
            roll_rad: of the camera about its optical axis, positive with the right side of the picture down.
        """
        self.seen.append(Seen(frame.t_s, track))
        self.steadier.add(frame, (track.box,), roll_rad)
        due = not self.key_frames or frame.t_s - self.key_frames[-1].t_s >= self.interval_s
        if due and len(self.key_frames) < KEY_FRAMES:
            self.key_frames.append(KeyFrame(frame.image.copy(), frame.t_s, track))

    def target_picture(self) -> bytes | None:
        """JPEG of the target from the sharpest view of it (the largest box), or None when there is none."""
        best = max(
            (key for key in self.key_frames if key.track.state == "tracking"),
            key=lambda key: key.track.box.height_px,
            default=None,
        )
        if best is None:
            return None
        box = best.track.box
        height, width = best.image.shape[:2]
        left = int(np.clip(box.left_px - PICTURE_MARGIN * box.width_px, 0, width - 2))
        right = int(np.clip(box.right_px + PICTURE_MARGIN * box.width_px, left + 1, width))
        top = int(np.clip(box.top_px - PICTURE_MARGIN * box.width_px, 0, height - 2))
        bottom = int(np.clip(box.bottom_px + PICTURE_MARGIN * box.width_px, top + 1, height))
        done, encoded = cv2.imencode(".jpg", best.image[top:bottom, left:right])
        return encoded.tobytes() if done else None

    def steadied(
        self,
        pose_at: Callable[[float], Pose | None],
        offset_s: float,
        noise: NoiseModel,
        finder: Callable[[], Detector] = lambda: NanoDetDetector(_PEOPLE_SCORE),
    ) -> BundleSolution:
        """The poses by the background (`mission.bundle.BundleAdjuster.solve`).

        Somebody who walks the camera's own way for a moment looks like a still thing at another distance, so where much
        of the picture moves, people are looked for in the key frames and left out: a second or two more, in crowds.

        Args:
            pose_at: the aircraft's pose at a telemetry time.
            offset_s: how much later than telemetry the video's clock runs.
            noise: what the aircraft states of its pose's errors.
            finder: of people.
        """
        found = self.steadier.solve(pose_at, offset_s, noise)
        refused = found.reason is not None and not math.isnan(found.still_share)
        if not refused and not found.still_share < _CROWDED:
            return found
        detector = finder()
        for key in self.key_frames:
            self.steadier.leave_out(key.t_s, [one.box for one in detector.detect(key.image)])
        return self.steadier.solve(pose_at, offset_s, noise)

    def sightings(
        self,
        origin: GeodeticOrigin,
        pose_at: Callable[[float], Pose | None],
        offset_s: float,
        pose_noise: NoiseModel,
        prior: TargetPrior,
        steadied: BundleSolution | None = None,
    ) -> FlightSightings:
        """All frames in which the target was tracked and the pose is known.

        Args:
            origin: of the local frame.
            pose_at: the aircraft's pose at a program time, None where it is not known.
            offset_s: how much later than telemetry the video's clock runs.
            pose_noise: how good the reported pose is; the tracker's and the lens's noise are added here.
            prior: what is known of the target.
            steadied: the poses by the background; used, with their own noise, where they were had.
        """
        used = steadied if steadied is not None and steadied.reason is None else None
        noise = pose_noise if used is None else used.noise
        lens_px = self._noise(replace(noise, pixel_sigma_px=0.0)).pixel_sigma_px
        # Reported and steadied poses are of two worlds and are not mixed.
        taken = self._as_reported(pose_at, offset_s) if used is None else self._as_steadied(used, offset_s)
        found: list[Sighting] = []
        for one in taken:
            if not found or one.t_s >= found[-1].t_s:
                found.append(replace(one, pixel_sigma_px=float(np.hypot(one.pixel_sigma_px or 0.0, lens_px))))
        return FlightSightings(self.id, origin, self.camera.intrinsics, tuple(found), self._noise(noise), prior)

    def _as_reported(self, pose_at: Callable[[float], Pose | None], offset_s: float) -> Iterator[Sighting]:
        for seen in self._tracking():
            t_s = self.camera.row_time_s(seen.t_s - offset_s, seen.track.pixel[1])
            pose = pose_at(t_s)
            if pose is not None:
                yield sighting(seen.track, t_s, pose, self.camera)

    def _as_steadied(self, steadied: BundleSolution, offset_s: float) -> Iterator[Sighting]:
        by_frame = {pose.t_s: pose for pose in steadied.poses}
        both = [(seen, by_frame[seen.t_s]) for seen in self._tracking() if seen.t_s in by_frame]
        times = [self.camera.row_time_s(seen.t_s - offset_s, seen.track.pixel[1]) for seen, _ in both]
        delays = np.array([t_s - (seen.t_s - offset_s) for t_s, (seen, _) in zip(times, both, strict=True)])
        place, turned = rows_at([pose for _, pose in both], delays)
        for t_s, (seen, _), where, wxyz in zip(times, both, place, turned, strict=True):
            yield sighting_from(seen.track, t_s, where, wxyz)

    def _tracking(self) -> list[Seen]:
        return [seen for seen in self.seen if seen.track.state == "tracking"]

    def _noise(self, pose_noise: NoiseModel) -> NoiseModel:
        """The tracker's correlation times, and what the lens adds at the distance from the axis that was flown."""
        lens = self.camera.intrinsics
        pixels = np.array([seen.track.pixel for seen in self._tracking()]).reshape(-1, 2)
        across, down = np.sqrt(np.mean((pixels - [lens.cx, lens.cy]) ** 2, axis=0)) if len(pixels) else (0.0, 0.0)
        noise = replace(
            pose_noise,
            pixel_correlation_s=PIXEL_CORRELATION_S,
            size_sigma=DEFAULT_SIZE_SIGMA,
            size_correlation_s=SIZE_CORRELATION_S,
        )
        return self.camera.widen(noise, (float(across), float(down)))

    def drone_track(self, pose_at: Callable[[float], Pose | None], offset_s: float) -> Matrix:
        """Camera path over the sidestep: rows of time, east, north, up; shape (n, 4)."""
        poses = [pose for pose in (pose_at(seen.t_s - offset_s) for seen in self.seen) if pose is not None]
        if not poses:
            return np.zeros((0, 4))
        return np.column_stack((np.array([pose.t_s for pose in poses]), cameras_at(poses, self.camera)[1]))
