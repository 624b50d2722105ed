"""The first look through a video: how the picture turned all along, and who was in it twice a second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mission.camera.camera import Camera
from mission.detect import Detector
from mission.observation.candidates import Look
from mission.observation.file_video import FileVideo
from mission.observation.rotation_curve import RotationCurve


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What a video shows, before it is known where it was taken."""

    curve: RotationCurve
    looks: tuple[Look, ...]
    last_s: float
    """Video time of the last picture."""
    pictures: int
    damaged: int
    """Packets that no picture came of."""


def survey(
    video: FileVideo,
    camera: Camera,
    detector: Detector,
    detect_hz: float = 2.0,
    progress: Callable[[float], None] = lambda _: None,
) -> Survey:
    """Look through a video once.

    Args:
        video: the file.
        camera: a first guess of the lens; the rotation is kept as points, so that a better one can be put in later.
        detector: of people.
        detect_hz: how often people are looked for.
        progress: is told the video time that was reached, now and then.

    Raises:
        VideoError: no picture can be read.
    """
    curve, looks = RotationCurve(camera), []
    next_look_s, last_s, number = 0.0, 0.0, 0
    for picture in video.pictures():
        number, last_s = number + 1, picture.t_s
        curve.add(picture)
        if picture.t_s >= next_look_s - 1e-6:
            next_look_s = max(next_look_s + 1.0 / detect_hz, picture.t_s + 0.5 / detect_hz)
            looks.append(Look(picture.t_s, tuple(detector.detect(picture.frame().image))))
            progress(picture.t_s)
    return Survey(curve, tuple(looks), last_s, number, video.damaged)
