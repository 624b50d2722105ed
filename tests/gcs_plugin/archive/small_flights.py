"""Recorded flights of a few seconds in which nobody is seen: quick to make, and to look through."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from mission.camera import Camera, Mounting, write_camera
from sitl.recorded.log_files import write_csv
from sitl.recorded.reports import Reports
from sitl.recorded.video_file import write_video
from tests.support.panorama import Flight

BEFORE_S = 7.0
"""The log begins so much before the video."""


def heading(t_s: float) -> float:
    s = min(max((t_s - 1.0) / 2.0, 0.0), 1.0)
    return 0.9 * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def small_flight(folder: Path, name: str, seed: int = 0, seconds: float = 5.0) -> Path:
    """The video's path; a CSV log and a camera file lie beside it."""
    lens = Camera.from_field_of_view(160, 120, math.radians(64.0), Mounting.tilted(0.2))
    flight = Flight(lens, heading, duration_s=seconds, fps=10.0, person=False, seed=seed)
    video = folder / f"{name}.mp4"
    write_video(video, (frame.image for frame in flight.frames()), 10.0)
    t_s = np.arange(-BEFORE_S, seconds + 2.0, 0.05)
    angles = []
    for at in t_s.tolist():
        wobble = 0.03 * math.sin(2.0 * at + seed)
        angles.append((wobble, 0.02 + 0.5 * wobble, heading(at)))
    place = np.tile([47.4, 8.55, 500.0], (len(t_s), 1))
    still = np.zeros((len(t_s), 3))
    write_csv(folder / f"{name}.csv", Reports(t_s + BEFORE_S, place, still, np.array(angles), np.full(len(t_s), 3.0)))
    write_camera(folder / f"{name}.camera.toml", lens)
    return video
