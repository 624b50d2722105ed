"""One order to locate, from its parts to its answer: what `sidestep locate` and `sidestep serve` have in common."""

from __future__ import annotations

import math
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version

from gcs_plugin.cot.publisher import TakPublisher
from gcs_plugin.flight_recording import FlightRecording
from gcs_plugin.flight_report.flight_folder import FlightFolder
from gcs_plugin.geotags.log import GeotagLog, Provenance
from gcs_plugin.publish.messages import Link
from gcs_plugin.publish.publisher import AnswerPublisher, Times
from gcs_plugin.terminal.progress import Progress
from mission.camera import Camera, Mounting, read_camera
from mission.detect import Detector
from mission.errors import SidestepError
from mission.procedure.locate import Locate
from mission.procedure.pointing import TargetTracker
from mission.procedure.result import LocateResult, TargetChoice, Watcher
from mission.settings import CameraSettings, MissionSettings
from mission.vehicle.drone import Drone
from mission.video import VideoSource, open_video
from mission.video.square import with_square_pixels


@dataclass(frozen=True, slots=True)
class FlightDevices:
    """What a flight is made with."""

    drone: Drone
    link: Link | None
    """Where answers are sent; None for an aircraft without MAVLink."""
    video: VideoSource
    camera: Camera
    detector: Detector
    tracker: TargetTracker
    log: GeotagLog
    tak: TakPublisher | None = None
    """Shows target and drone on TAK maps."""


def open_camera(settings: MissionSettings, warn: Callable[[str], None]) -> tuple[VideoSource, Camera]:
    """The video and the camera that makes it, both with square pixels; loud when the camera is not calibrated.

    Raises:
        VideoError: there is no picture.
        CalibrationError: the camera file cannot be read, or is of another camera.
    """
    known = None if settings.camera.file is None else read_camera(settings.camera.file)
    latency_s = settings.video.latency_s if settings.video.latency_s is not None else known.latency_s if known else 0.0
    source = open_video(settings.video.url, latency_s=latency_s, open_timeout_s=settings.video.open_timeout_s)
    try:
        frame = source.latest(-1, settings.video.open_timeout_s)
        height, width = (480, 640) if frame is None else frame.image.shape[:2]
        camera = known.for_picture(width, height) if known else uncalibrated(settings.camera, width, height)
    except SidestepError:
        source.close()
        raise
    if not camera.calibrated:
        warn(
            f"WARNING: the camera is not calibrated; using {settings.camera.hfov_deg:.1f} deg of view. "
            "Errors grow, and the ellipse with them: run `sidestep calibrate`."
        )
    return with_square_pixels(source, camera)


def known_camera(settings: MissionSettings) -> Camera:
    """The camera as far as it is known before the first picture.

    Raises:
        CalibrationError: the camera file cannot be read.
    """
    return (
        uncalibrated(settings.camera, 640, 480) if settings.camera.file is None else read_camera(settings.camera.file)
    )


def uncalibrated(settings: CameraSettings, width_px: int, height_px: int) -> Camera:
    """A camera of which only the field of view is known."""
    mounting = Mounting.tilted(math.radians(settings.tilt_down_deg))
    return Camera.from_field_of_view(width_px, height_px, math.radians(settings.hfov_deg), mounting)


class LocateSession:
    """One flight and its answer.

    Args:
        equipment: what it is made with.
        settings: of the mission.
        choice: which person is meant.
        folder: of this flight.
        progress: what the person at the terminal sees.
        times: program time and UTC.
    """

    def __init__(
        self,
        equipment: FlightDevices,
        settings: MissionSettings,
        choice: TargetChoice,
        folder: FlightFolder,
        progress: Progress,
        times: Times,
    ) -> None:
        provenance = Provenance(
            software=f"sidestep {version('sidestep')}",
            flight_id=folder.path.name,
            video=settings.video.url,
            link=settings.link.url,
            choice=str(choice),
        )
        self._equipment = equipment
        self._settings = settings
        self._choice = choice
        self._flight_id = f"{folder.path.name}-{uuid.uuid4().hex[:8]}"
        self._times = times
        self._folder = folder.path
        self.answer = AnswerPublisher(
            equipment.drone,
            equipment.link,
            settings.answer,
            folder,
            equipment.log,
            progress,
            provenance,
            times,
            equipment.tak,
        )

    def run(
        self,
        aborted: Callable[[], bool],
        watcher: Watcher | None = None,
        serve: Callable[[], None] = lambda: None,
    ) -> LocateResult:
        """Fly and answer; `answer.finish` is left to do when the aircraft holds.

        Args:
            aborted: answers True as soon as the operator wants an end.
            watcher: is told instead of the answer, which it has to tell in turn.
            serve: called in every turn of the flight's loop: what else this thread has to do meanwhile.

        Raises:
            SidestepError: there is no answer, see `mission.procedure.locate.Locate.run`; why is kept.
        """
        parts = self._equipment
        recording = self._recording()
        procedure = Locate(
            parts.drone if recording is None else recording.drone,
            parts.video if recording is None else recording.source,
            parts.camera,
            parts.detector,
            parts.tracker,
            self._settings,
            watcher or self.answer,
            aborted,
            self._times.clock if recording is None else recording.clock,
            serve,
        )
        try:
            return procedure.run(self._choice, self._flight_id)
        except SidestepError as error:
            self.answer.failed(error)
            raise
        finally:
            if recording is not None:
                recording.finish()

    def _recording(self) -> FlightRecording | None:
        if not self._settings.record.video:
            return None
        parts, times = self._equipment, self._times
        return FlightRecording(
            self._folder,
            self._flight_id,
            parts.drone,
            parts.video,
            parts.camera,
            self._settings,
            self._choice,
            times.clock,
            lambda t_s: times.utc_of(t_s).timestamp(),
        )
