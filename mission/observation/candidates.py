"""Who might be located: detections of a whole video joined into tracks, by where each should be next.

A person who was seen at a pixel, as tall as people are, is somewhere in the world; from there the next pixel follows
with what they may have walked meanwhile. Good enough to tell when somebody was in view, and where to begin following:
what is measured comes from the tracker.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mission.camera.camera import Camera
from mission.camera.model import CameraModel
from mission.planning.aim import PRESUMED_HEIGHT_M
from mission.pose.buffer import PoseAt
from mission.records import Detection, Vector
from mission.sighting import camera_position, world_from_camera

LOST_S = 2.6
"""Without a detection for longer, a track has ended."""
_WALK_M_S = 2.0
_SIZE_RATIO = 1.5
_OWN_SIZES = 0.5
"""How far off in body heights a detection may be for what its box's own errors move the person."""
_RANGE_ERROR = 0.3
"""Of the presumed range, relative: children, and boxes that are too large."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Who was detected in one picture."""

    t_s: float
    found: tuple[Detection, ...]


@dataclass(slots=True, eq=False)
class Candidate:
    """Detections of what seems to be one person."""

    number: int
    """From 1, in the order in which they were first seen."""
    looks: list[tuple[float, Detection]] = field(default_factory=list)

    @property
    def first_s(self) -> float:
        """Video time of the first detection."""
        return self.looks[0][0]

    @property
    def last_s(self) -> float:
        """Of the last one."""
        return self.looks[-1][0]


def candidates(
    looks: Sequence[Look], pose_at: PoseAt, camera: Camera, offset_s: float, least: int = 2
) -> list[Candidate]:
    """Tracks from detections.

    Args:
        looks: in order of time.
        pose_at: the camera carrier's pose at a time of the log.
        camera: lens and mounting.
        offset_s: between video and log.
        least: detections that a track must have.
    """
    open_tracks: list[Candidate] = []
    closed: list[Candidate] = []
    number = 0
    for look in looks:
        going = [one for one in open_tracks if look.t_s - one.last_s <= LOST_S]
        closed += [one for one in open_tracks if look.t_s - one.last_s > LOST_S]
        distances = [
            (_distance(track, one, look.t_s, pose_at, camera, offset_s), track, one)
            for track in going
            for one in look.found
        ]
        taken: set[int] = set()
        for distance, track, one in sorted(distances, key=lambda pair: pair[0]):
            if distance <= 1.0 and id(one) not in taken and track.last_s < look.t_s:
                track.looks.append((look.t_s, one))
                taken.add(id(one))
        for one in look.found:
            if id(one) not in taken:
                number += 1
                going.append(Candidate(number, [(look.t_s, one)]))
        open_tracks = going
    every = [one for one in (*closed, *open_tracks) if len(one.looks) >= least]
    every.sort(key=lambda one: (one.first_s, one.number))
    return [Candidate(place + 1, one.looks) for place, one in enumerate(every)]


def _distance(track: Candidate, one: Detection, t_s: float, pose_at: PoseAt, camera: Camera, offset_s: float) -> float:
    """How far a detection is from where the track's person should be, in units of what is still believed."""
    last_s, last = track.looks[-1]
    larger = one.box.height_px / max(last.box.height_px, 1.0)
    if not 1.0 / _SIZE_RATIO < larger < _SIZE_RATIO:
        return math.inf
    focal = camera.intrinsics.fy
    away_m = focal * PRESUMED_HEIGHT_M / max(last.box.height_px, 1.0)
    before, now = pose_at(last_s - offset_s), pose_at(t_s - offset_s)
    expected: Vector = np.array(last.box.centre_px)
    travelled_m = 0.0
    if before is not None and now is not None:
        lens = CameraModel(camera.intrinsics)
        ray = world_from_camera(before, camera).apply(lens.ray(expected))
        place = camera_position(before, camera) + away_m * ray
        seen = world_from_camera(now, camera).inv().apply(place - camera_position(now, camera))
        if seen[2] <= 0.1 * away_m:
            return math.inf
        expected = np.asarray(lens.project(seen))
        travelled_m = float(np.linalg.norm(camera_position(now, camera) - camera_position(before, camera)))
    moved_m = _WALK_M_S * (t_s - last_s) + _RANGE_ERROR * travelled_m
    allowed = focal * moved_m / away_m + _OWN_SIZES * last.box.height_px
    return float(np.linalg.norm(np.array(one.box.centre_px) - expected)) / allowed
