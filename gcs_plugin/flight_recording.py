"""The recording of one flight in its folder: video and telemetry as received, and the procedure's tape."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol, cast, runtime_checkable

from mission.camera import Camera, write_camera
from mission.errors import SidestepError
from mission.logs.tlog_writer import TlogWriter
from mission.observation.recording import RecordedDrone, RecordedVideo
from mission.observation.tape import FOLDER, TELEMETRY, VIDEO, Tape, write_tape
from mission.procedure.result import TargetChoice
from mission.settings import MissionSettings
from mission.vehicle.drone import Drone
from mission.video import VideoSource
from mission.video.recorder import Recordable

_log = logging.getLogger(__name__)
_CAMERA = "camera.toml"


@runtime_checkable
class Tapped(Protocol):
    """An aircraft whose telemetry can be kept as it comes."""

    def tap(self, taker: Callable[[bytes, float], None] | None) -> None:
        """Hand every frame and its arrival to `taker` from now on; to nobody with None."""
        ...


class FlightRecording:
    """Keeps one flight; nothing that fails here ends a flight.

    Args:
        folder: of the flight.
        flight_id: its name in the sightings.
        drone: the aircraft.
        video: its camera's pictures.
        camera: that makes them.
        settings: of the mission.
        choice: which person is meant.
        clock: the program's clock, seconds.
        utc_of: UNIX seconds of a program time.
    """

    def __init__(
        self,
        folder: Path,
        flight_id: str,
        drone: Drone,
        video: VideoSource,
        camera: Camera,
        settings: MissionSettings,
        choice: TargetChoice,
        clock: Callable[[], float],
        utc_of: Callable[[float], float],
    ) -> None:
        self._folder = folder / FOLDER
        self._video, self._raw_drone = video, drone
        told: dict[str, Any] = settings.model_dump(mode="json", exclude={"link", "video", "authority", "answer", "tak"})
        told["video"] = {"check_offset": settings.video.check_offset, "latency_s": settings.video.latency_s}
        box = choice.box
        self.tape = Tape(
            flight_id,
            told,
            "",
            {
                "box": None if box is None else [box.left_px, box.top_px, box.width_px, box.height_px],
                "point": None if choice.point is None else list(choice.point),
            },
            f"sidestep {version('sidestep')}",
            begun_clock_s=clock(),
        )
        self._taped = drone.gimbal is None
        """What a gimbal told is not on the tape: such a flight is kept, but not for a replay."""
        self.drone: Drone = RecordedDrone(drone, self.tape) if self._taped else drone
        taped = RecordedVideo(video, self.tape, clock)
        self.source: VideoSource = taped if self._taped else video
        self.clock = taped.clock if self._taped else clock
        self._telemetry: TlogWriter | None = None
        most = round(settings.record.max_mb * 1e6)
        try:
            self._folder.mkdir()
            write_camera(self._folder / _CAMERA, camera)
            self.tape.camera = (self._folder / _CAMERA).read_text(encoding="utf-8")
        except (OSError, SidestepError) as error:
            _log.warning("the flight is not recorded: %s", error)
            return
        if hasattr(video, "start_recording"):
            cast(Recordable, video).start_recording(self._folder / VIDEO, most)
        if isinstance(drone, Tapped):
            self._telemetry = TlogWriter(self._folder / TELEMETRY, most, utc_of)
            drone.tap(self._telemetry.take)

    def finish(self) -> threading.Thread:
        """End the recording and write the tape, in a thread of its own that is returned."""
        thread = threading.Thread(target=self._finish, name="recording")
        thread.start()
        return thread

    def _finish(self) -> None:
        kept = None
        if isinstance(self._raw_drone, Tapped):
            self._raw_drone.tap(None)
        if self._telemetry is not None:
            self._telemetry.close()
        if hasattr(self._video, "stop_recording"):
            kept = cast(Recordable, self._video).stop_recording()
        if kept is not None:
            self.tape.video_first_index = kept.first_index
            self.tape.video_note = kept.why
        if not self._taped:
            return
        try:
            write_tape(self._folder, self.tape)
        except OSError as error:
            _log.warning("the flight cannot be replayed: %s", error)
