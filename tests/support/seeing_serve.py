"""`sidestep serve` of one vehicle that sees a person without video: ``python -m tests.support.seeing_serve``.

Link, pilot process, component, orders, flight and estimate are the program's own. Only pictures, detector and tracker
are stand-ins: a person stands north of the place where the vehicle was met. The video ends while the file ``no-video``
is in the vehicle's folder.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from gcs_plugin.publish.publisher import Times
from gcs_plugin.serve.fleet import VehicleOptions
from gcs_plugin.serve.vehicle import VehicleService
from gcs_plugin.terminal.abort import Abort
from mission.camera import Camera
from mission.errors import VideoError
from mission.pose.buffer import Pose
from mission.records import Box, Detection, Frame, Image, Vector
from mission.settings import MissionSettings, VideoSettings
from mission.vehicle.drone import Drone
from mission.video import VideoSource
from mission.video.stats import VideoState, VideoStats
from tests.support.fakes import BLANK, CAMERA, FakeDrone, Sight, Walker

PERSON_ENU_M = np.array([0.5, 6.0, 0.9])
LATE_S = 0.25
"""A frame's age: its pose has come by then."""


class Eyes(FakeDrone):
    """The poses of the real vehicle, for the stand-ins."""

    real: Drone | None = None

    def pose_at(self, t_s: float) -> Pose | None:
        return None if self.real is None else self.real.pose_at(t_s)


class Seeing(Sight):
    """Sees the person where the newest frame was taken."""

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        self.drone.t_s = time.monotonic() - LATE_S
        return super().detect(image, region)

    def _seen(self, t_s: float) -> tuple[Box, tuple[float, float]] | None:
        if self.drone.pose_at(t_s) is not None:
            self._last = super()._seen(t_s)
        return self._last  # on a machine that is very busy the pose has not come yet

    _last: tuple[Box, tuple[float, float]] | None = None


class BlankVideo:
    """Twenty blank pictures a second, in real time, while they are allowed to come."""

    def __init__(self, forbidden: Path) -> None:
        self._forbidden = forbidden
        self._index = 0
        self._next_s = time.monotonic()

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        wait_s = self._next_s - time.monotonic()
        time.sleep(max(0.0, min(wait_s, timeout_s)))  # paces the video
        if wait_s > timeout_s or self._forbidden.exists():
            return None
        self._next_s = max(self._next_s + 0.05, time.monotonic())
        self._index += 1
        return Frame(BLANK, time.monotonic() - LATE_S, self._index)

    def stats(self) -> VideoStats:
        return VideoStats(VideoState.PLAYING, 20.0, self._index, 0, 0, 0, 0.0, 0.0, "")

    def close(self) -> None: ...


class SeeingService(VehicleService):
    """The vehicle's service with the stand-ins in it."""

    def __init__(self, settings: MissionSettings, abort: Abort) -> None:
        times = Times(time.monotonic, lambda: datetime.now(UTC))
        super().__init__(settings, abort, Console(width=200), times)
        place: Vector = PERSON_ENU_M
        self._eyes = Eyes()
        sight = Seeing(self._eyes, Walker(place, np.zeros(3)))
        forbidden = settings.answer.folder / "no-video"

        def open_camera(settings: MissionSettings, warn: Callable[[str], None]) -> tuple[VideoSource, Camera]:
            if forbidden.exists():
                raise VideoError("Nothing arrives", "Start the camera.")
            return BlankVideo(forbidden), CAMERA

        self._crew = replace(self._crew, detector=sight, tracker=lambda: sight, open_camera=open_camera)

    def _serve(self, drone: Drone) -> None:
        self._eyes.real = drone
        super()._serve(drone)


def main(
    link: Annotated[str, typer.Option()],
    system: Annotated[int, typer.Option()],
    folder: Annotated[Path, typer.Option()],
    settings: Annotated[Path | None, typer.Option()] = None,
) -> None:
    """Serve until the end of the program."""
    read = VehicleOptions(settings, link, system, None, None, folder).read()
    abort = Abort()
    abort.install()
    try:
        SeeingService(read.model_copy(update={"video": VideoSettings(check_offset=False)}), abort).run()
    except KeyboardInterrupt:
        return


if __name__ == "__main__":
    typer.run(main)
