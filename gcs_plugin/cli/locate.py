"""`sidestep locate`: locate the person in view: hover, turn, fly the pattern, estimate, report."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from gcs_plugin.cli.address import HELP, given_address
from gcs_plugin.cot.publisher import tak_publisher
from gcs_plugin.flight_report.flight_folder import FlightFolder
from gcs_plugin.geotags.log import GeotagLog
from gcs_plugin.locate_session import FlightDevices, LocateSession, known_camera, open_camera
from gcs_plugin.publish.publisher import AnswerPublisher, Times
from gcs_plugin.terminal.abort import Abort
from gcs_plugin.terminal.output import lasting_console
from gcs_plugin.terminal.progress import Progress
from mission.addresses import shown_address
from mission.detect import make_detector
from mission.errors import FlightEnded, FlightRefused, SettingsError
from mission.geodesy import ce90_m
from mission.procedure.result import LocateResult, TargetChoice
from mission.records import Box
from mission.settings import MissionSettings, read_settings
from mission.track import Tracker
from mission.vehicle.ardrone.url import is_ardrone
from mission.vehicle.drone import Drone, Order, OrderState
from mission.vehicle.make import make_drone, mavlink_of
from mission.video.square import SquareVideo

TAKE_OFF_TIMEOUT_S = 60.0


def register(app: typer.Typer) -> None:
    """Add the command to the application."""

    @app.command()
    def locate(
        settings: Annotated[Path | None, typer.Option(help="Settings, TOML (`sidestep settings` prints one).")] = None,
        link: Annotated[
            str | None, typer.Option("--drone", "--link", help="udpin://0.0.0.0:14540 or ardrone://192.168.1.1, e.g.")
        ] = None,
        video: Annotated[str | None, typer.Option(help=f"{HELP} An AR.Drone brings its own.")] = None,
        camera: Annotated[Path | None, typer.Option(help="Camera file of `sidestep calibrate`.")] = None,
        box: Annotated[str | None, typer.Option(help="The target: LEFT,TOP,WIDTH,HEIGHT in pixels.")] = None,
        point: Annotated[str | None, typer.Option(help="The target: X,Y in pixels.")] = None,
        take_off: Annotated[float | None, typer.Option(help="Arm and take off to this height (m) first.")] = None,
        land: Annotated[bool, typer.Option("--land", help="Land afterwards.")] = False,
    ) -> None:
        """Locate the person in view: hover, turn, fly the pattern, estimate, report.

        Ctrl-C at any moment: the aircraft holds its place and the log is whole.
        """
        chosen = _with_options(read_settings(settings), link, video and given_address(video), camera)
        choice = TargetChoice(_box(box), _point(point))
        check_before_connecting(chosen, choice, take_off)
        _run(chosen, choice, take_off, land, lasting_console())


def check_before_connecting(settings: MissionSettings, choice: TargetChoice, take_off_m: float | None) -> None:
    """What is wrong with the order whatever the aircraft says.

    Raises:
        SettingsError: the target or the take-off height is not one that can be flown.
        CalibrationError: the camera file cannot be read.
    """
    known_camera(settings)
    if choice.box is not None:
        box = choice.box
        sides = (box.left_px, box.top_px, box.width_px, box.height_px)
        if not all(map(math.isfinite, sides)) or box.width_px <= 0.0 or box.height_px <= 0.0:
            raise SettingsError("the box is empty", "Give LEFT,TOP,WIDTH,HEIGHT in pixels.")
        if box.right_px <= 0.0 or box.bottom_px <= 0.0:
            raise SettingsError("the box lies outside the picture", "Pixels count from the top left corner.")
    if choice.point is not None and not all(math.isfinite(c) and c >= 0.0 for c in choice.point):
        raise SettingsError("the point lies outside the picture", "Pixels count from the top left corner.")
    limits = settings.limits
    if take_off_m is not None and not limits.min_height_m <= take_off_m <= limits.max_height_m:
        raise SettingsError(
            f"the take-off height of {take_off_m:g} m is outside {limits.min_height_m:g} to {limits.max_height_m:g} m",
            "Choose another height, or other limits.min_height_m and limits.max_height_m.",
        )


def _run(settings: MissionSettings, choice: TargetChoice, take_off: float | None, land: bool, console: Console) -> None:
    abort = Abort()
    abort.install()
    times = Times(time.monotonic, lambda: datetime.now(UTC))
    with ExitStack() as stack:
        progress = stack.enter_context(Progress(console))
        log = GeotagLog(settings.answer.folder / "geotags.gpkg")
        log.prepare()
        folder = stack.enter_context(FlightFolder(settings.answer.folder, times.utc()))
        detector = make_detector(settings.detect.detector)
        drone = make_drone(
            settings.link.url,
            target_system=settings.link.system,
            flight=settings.link.flight(),
            pilot_log=folder.path / "pilot.log",
            camera=known_camera(settings),
        )
        stack.callback(drone.close)
        progress.say(f"connecting to {shown_address(settings.link.url)}")
        drone.connect(settings.link.connect_timeout_s)
        progress.say(f"connected to {drone.name}, poses at {drone.telemetry().pose_rate_hz:.0f} Hz")
        source, lens = open_camera(settings, lambda text: progress.say(text, style="bold yellow"))
        stack.callback(source.close)
        if take_off is not None:
            _take_off(drone, settings, take_off, abort, progress)
        link = mavlink_of(drone)
        if link is None:
            progress.say(
                "this aircraft takes no answers (no MAVLink): the answer stays in the flight's folder and here"
            )
        if drone.origin is None:
            progress.say("no place on earth is known (no GPS fix): the answer is local, and no geotag is logged")
        tak = tak_publisher(settings, lens)
        if tak is not None:
            stack.callback(tak.close)
        equipment = FlightDevices(drone, link, source, lens, detector, Tracker(), log, tak)
        if isinstance(source, SquareVideo):
            choice = on_square_pixels(choice, source)
        flight = LocateSession(equipment, settings, choice, folder, progress, times)
        stack.callback(flight.answer.close)
        abort.in_flight = True
        try:
            located = flight.run(abort.asked)
        finally:
            abort.in_flight = False
        flight.answer.finish(located)
        if land:
            _wait(drone, drone.land(), TAKE_OFF_TIMEOUT_S, abort.asked)
        _print(console, located, flight.answer, folder)


def _take_off(drone: Drone, settings: MissionSettings, height_m: float, abort: Abort, progress: Progress) -> None:
    progress.say(f"taking off to {height_m:.1f} m")
    drone.begin(settings.limits.bounds())
    abort.in_flight = True
    try:
        _wait(drone, drone.take_off(height_m), TAKE_OFF_TIMEOUT_S, abort.asked)
    finally:
        abort.in_flight = False


def _wait(drone: Drone, order: Order, timeout_s: float, aborted: Callable[[], bool]) -> None:
    """Wait for an order to be done, keeping the pilot process alive.

    Raises:
        FlightRefused: it is not taken.
        FlightEnded: it ended before it was done, or takes too long.
    """
    deadline = time.monotonic() + timeout_s
    while order.state in (OrderState.PENDING, OrderState.FLYING):
        drone.telemetry()
        if aborted():
            raise FlightEnded("aborted by the operator")
        if time.monotonic() > deadline:
            raise FlightEnded(f"{order.kind} was not done within {timeout_s:.0f} s", "Look at the aircraft.")
        time.sleep(0.02)  # paces the keep-alive; the order's own state ends the loop
    if order.state is OrderState.REFUSED:
        raise FlightRefused(f"{order.kind} refused: {order.reason}")
    if order.state is OrderState.ENDED:
        raise FlightEnded(f"{order.kind} ended: {order.reason}")


def _print(console: Console, located: LocateResult, answer: AnswerPublisher, folder: FlightFolder) -> None:
    estimate = located.estimate
    table = Table(show_header=False, title="target")
    if answer.geotag is not None:
        tag = answer.geotag
        table.add_row("place", f"{tag.place.lat_deg:.7f}, {tag.place.lon_deg:.7f}")
        table.add_row("altitude", f"{tag.place.alt_m:.1f} m above {tag.place.datum}")
        table.add_row("CE90 / LE90", f"{tag.ce90_m:.2f} m / {tag.le90_m:.2f} m")
        outcome = answer.outcome
        waits = f"; it waits in {outcome.log}" if outcome.log else ""
        where = f"in {outcome.log}" if outcome.logged else f"NOT LOGGED: {outcome.not_logged.rstrip('.')}{waits}"
        table.add_row("geotag", f"number {tag.number} {where}")
    else:
        east, north, up = estimate.position_enu_m
        table.add_row(
            "place", f"{east:+.2f} m east, {north:+.2f} m north, {up:+.2f} m up of where the aircraft started"
        )
        if estimate.covariance is not None:
            table.add_row("CE90", f"{ce90_m(estimate.covariance[:2, :2]):.2f} m, relative to the aircraft's own path")
    table.add_row("depth", f"{estimate.depth_m:.2f} m at the first of {estimate.sightings} sightings")
    if estimate.velocity_enu_m_s is not None:
        east, north = estimate.velocity_enu_m_s[:2]
        table.add_row("velocity", f"{east:+.2f} m/s east, {north:+.2f} m/s north ({estimate.model})")
    for other in located.comparisons:
        table.add_row(f"({other.method})", f"{other.depth_m:.2f} m")
    console.print(table)
    for note in estimate.notes:
        console.print(f"note: {note}", markup=False)
    console.print(f"flight: {folder.path}")


def _with_options(
    settings: MissionSettings, link: str | None, video: str | None, camera: Path | None
) -> MissionSettings:
    if link is not None:
        settings = settings.model_copy(update={"link": settings.link.model_copy(update={"url": link})})
    if video is not None:
        settings = settings.model_copy(update={"video": settings.video.model_copy(update={"url": video})})
    elif is_ardrone(settings.link.url) and "url" not in settings.video.model_fields_set:
        settings = settings.model_copy(update={"video": settings.video.model_copy(update={"url": settings.link.url})})
    if camera is not None:
        settings = settings.model_copy(update={"camera": settings.camera.model_copy(update={"file": camera})})
    return settings


def _numbers(text: str, count: int, what: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise SettingsError(f"{what} is {text!r}", f"Give {count} numbers with commas between them.")
    return numbers


def on_square_pixels(choice: TargetChoice, video: SquareVideo) -> TargetChoice:
    """The operator speaks of the pictures as they come."""
    return TargetChoice(
        None if choice.box is None else video.box(choice.box),
        None if choice.point is None else video.point(*choice.point),
    )


def _box(text: str | None) -> Box | None:
    return None if text is None else Box(*_numbers(text, 4, "the box"))


def _point(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    x, y = _numbers(text, 2, "the point")
    return x, y
