"""One vehicle's service: finds the aircraft, serves it, finds it again when the connection was lost."""

from __future__ import annotations

import math
import secrets
import time
from importlib.metadata import version
from typing import Final

from rich.console import Console

from gcs_plugin.authority import Authority, SignatureMemory, read_key
from gcs_plugin.component import CameraComponent, Identity, LocateOrder, Order, Picture, StationLink
from gcs_plugin.component.kept_parameters import KeptParameters
from gcs_plugin.console.desk import ConsoleDesk
from gcs_plugin.cot.publisher import tak_publisher
from gcs_plugin.geotags.log import GeotagLog
from gcs_plugin.locate_session import known_camera
from gcs_plugin.publish.publisher import Times
from gcs_plugin.serve.session import ServeContext, ServeSession
from gcs_plugin.terminal.abort import Abort
from mission.addresses import shown_address
from mission.camera import Camera
from mission.detect import make_detector
from mission.errors import LinkError, SettingsError
from mission.settings import MissionSettings
from mission.vehicle.drone import Drone, Telemetry
from mission.vehicle.make import make_drone, mavlink_of
from mission.vehicle.pilot.preconditions import gimbal_refusal, unfit

AGAIN_S: Final = 2.0
"""Between attempts to reach the aircraft."""


class VehicleService:
    """Serves one vehicle until the end of the program.

    Args:
        settings: of the mission; what stations change in them is kept beside the answers.
        abort: tells when the program is to end.
        console: for the person at the terminal.
        times: program time and UTC.
        page: the operator's page in a browser, or None.

    Raises:
        SettingsError: the key file cannot be read, or the camera file, or an address of [tak] is none.
        AnswerError: the log of geotags cannot be written.
    """

    def __init__(
        self, settings: MissionSettings, abort: Abort, console: Console, times: Times, page: ConsoleDesk | None = None
    ) -> None:
        self._abort = abort
        self._console = console
        self._times = times
        self._camera = known_camera(settings)
        self._key = None if settings.authority.key_file is None else read_key(settings.authority.key_file)
        folder = settings.answer.folder
        log = GeotagLog(folder / "geotags.gpkg")
        log.prepare()
        memory = None if self._key is None else SignatureMemory(folder / "signatures.json")
        self._authority = Authority(settings.authority, self._key, times.utc, memory, times.clock)
        self._kept = KeptParameters(folder / "parameters.json", settings)
        self._file = settings
        self._instance = secrets.randbits(32)
        self._settings = self._kept.settings
        for text in (*([memory.lost] if memory is not None and memory.lost else ()), *self._kept.passed_over):
            self._say(f"passed over: {text}")
        for parameter in self._kept.restored:
            self._say(f"as a ground station set it: {parameter}")
        self._tak = tak_publisher(self._settings, self._camera)
        self._crew = ServeContext(
            make_detector(settings.detect.detector), log, console, times, abort, tak=self._tak, console_desk=page
        )

    def run(self) -> None:
        """Connect and serve, again and again; returns when the program is to end."""
        try:
            self._keep_serving()
        finally:
            if self._tak is not None:
                self._tak.close()

    def _keep_serving(self) -> None:
        while not self._abort.asked():
            settings = self._settings
            drone = make_drone(
                settings.link.url,
                target_system=settings.link.system,
                flight=settings.link.flight(),
                pilot_log=settings.answer.folder / "pilot.log",
                sparing=True,
                camera=known_camera(settings),
            )
            try:
                self._say(f"connecting to {shown_address(settings.link.url)}")
                drone.connect(settings.link.connect_timeout_s)
                self._serve(drone)
            except LinkError as error:
                self._say(str(error))
                time.sleep(AGAIN_S)  # a signal ends it at once
            finally:
                drone.close()

    def _serve(self, drone: Drone) -> None:
        """Be the camera component on the vehicle's link.

        Raises:
            LinkError: the connection's process is gone.
            SettingsError: the aircraft has no MAVLink link.
        """
        link, number = mavlink_of(drone), self._settings.orders.component
        if link is None:
            raise SettingsError("this aircraft takes no orders over MAVLink", "Use `sidestep locate` with it.")
        if self._key is not None:
            link.sign_as(number, self._key, lambda: self._authority.signing_timestamp() or 0)
        identity = Identity(
            link.source_system,
            number,
            "c-cast" if drone.name.startswith("ardupilot") else "bytewise",
            version("sidestep"),
            self._instance,
        )
        station = StationLink(link, number)
        component = CameraComponent(
            station,
            identity,
            told_picture(self._camera, self._settings),
            self._settings,
            self._authority,
            lambda order: refusal(order, drone.telemetry(), self._settings),
            self._times.clock,
            self._kept.keep,
            self._file,
        )
        with component:
            self._say(f"serving {drone.name} as component {number}")
            if component.picture.stream is None:
                self._say("stations are not told of the video: they could not open its address, or it has a password")
            try:
                ServeSession(self._crew, drone, station, component).run()
            finally:
                self._settings = component.settings

    def _say(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False)


def refusal(order: Order, telemetry: Telemetry, settings: MissionSettings) -> str:
    """Why the aircraft cannot carry out an order now, as far as telemetry tells; empty when it can.

    Said before the order is accepted. The pilot process looks again, at more, before it takes control.
    """
    if not isinstance(order, LocateOrder):
        return ""
    fit = unfit(telemetry, settings.link.min_battery)
    return fit or gimbal_refusal(telemetry, ignored=settings.camera.ignore_gimbal) or ""


def told_picture(camera: Camera, settings: MissionSettings) -> Picture:
    """The camera's video as stations are told of it."""
    lens = camera.intrinsics
    hfov_rad = 2.0 * math.atan(lens.width_px / (2.0 * lens.fx))
    return Picture(lens.width_px, lens.height_px, hfov_rad, settings.orders.video_url or settings.video.url)
