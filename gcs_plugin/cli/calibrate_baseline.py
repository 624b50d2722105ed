"""`sidestep calibrate baseline`: the paper's Section III-D, flown along a wall with ArUco markers."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from gcs_plugin.cli.address import HELP, given_address
from gcs_plugin.durable import write_whole
from gcs_plugin.terminal.abort import Abort
from mission.calibration.baseline import BaselineTable, baseline_table, reckoning_scale
from mission.calibration.baseline_flight import WallFlight, WallFlights
from mission.calibration.wall import MarkerWall
from mission.camera.file import read_camera
from mission.errors import SettingsError, VideoError
from mission.planning.pattern import PAPER_BASELINE_M
from mission.vehicle.ardrone.url import is_ardrone
from mission.vehicle.drone import Bounds
from mission.vehicle.make import make_drone
from mission.video import open_video

CONNECT_TIMEOUT_S = 30.0
FASTEST_M_S = 4.0
"""The paper's pattern ends at 3.8 m/s."""


def baseline(
    drone_url: Annotated[str, typer.Option("--drone", help="ardrone://192.168.1.1, or a MAVLink address.")],
    camera_file: Annotated[Path, typer.Option("--camera", help="Camera file of the video's own size.")],
    marker_mm: Annotated[float, typer.Option(help="Side of a marker.")],
    spacing_mm: Annotated[float, typer.Option(help="From the middle of one marker to that of the next.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The settings to write, TOML.", dir_okay=False)],
    video_url: Annotated[str | None, typer.Option("--video", help=f"{HELP} An AR.Drone brings its own.")] = None,
    dictionary: Annotated[str, typer.Option(help="Of the markers, which are 0, 1, 2, ... from the left.")] = "4X4_50",
    runs: Annotated[int, typer.Option(min=3, max=20, help="How often to fly.")] = 4,
    side: Annotated[str, typer.Option(help="left or right: along the wall, seen from the aircraft.")] = "left",
    room_m: Annotated[float, typer.Option(min=5.0, max=100.0, help="Room to that side.")] = 15.0,
) -> None:
    """Fly along a wall with a row of markers; the table of travel per image, for the settings' pattern section.

    The aircraft must hover, looking straight at the wall, with room to the side. Ctrl-C at any moment: it holds.
    """
    if side not in ("left", "right"):
        raise SettingsError(f"the side is {side!r}", "Give left or right.")
    if video_url is None and not is_ardrone(drone_url):
        raise SettingsError("it is not known where the video comes from", "Give --video.")
    console = Console(highlight=False)
    wall = MarkerWall(dictionary, marker_mm / 1000.0, spacing_mm / 1000.0)
    camera = read_camera(camera_file)
    abort = Abort()
    abort.install()
    drone = make_drone(drone_url)
    try:
        drone.connect(CONNECT_TIMEOUT_S)
        video = open_video(given_address(video_url or drone_url), latency_s=camera.latency_s)
        try:
            first = video.latest(-1, 5.0)
            if first is None:
                raise VideoError("there is no picture", "Check the camera.")
            camera = camera.for_picture(first.image.shape[1], first.image.shape[0])
            bounds = Bounds(radius_m=room_m, min_height_m=0.5, max_speed_m_s=FASTEST_M_S, max_duration_s=60.0 * runs)
            abort.in_flight = True
            flights = WallFlights(drone, video, camera, wall, abort.asked, time.monotonic).run(
                runs, bounds, side == "left", lambda number: console.print(f"run {number} of {runs}")
            )
        finally:
            abort.in_flight = False
            video.close()
    finally:
        drone.close()
    table = baseline_table([flight.true_m for flight in flights])
    write_whole(output, settings_text(table).encode())
    _report(console, table, flights, output)


def settings_text(table: BaselineTable) -> str:
    """The settings that hold the table."""
    steps = ", ".join(f"{step:.4f}" for step in table.step_m)
    spread = ", ".join(f"{sigma:.3f}" for sigma in table.step_sigma_m)
    return f'[pattern]\nkind = "paper"\nbaseline_m = [{steps}]\n# spread from run to run: [{spread}]\n'


def _report(console: Console, table: BaselineTable, flights: list[WallFlight], output: Path) -> None:
    shown = Table("image", "step (cm)", "spread", "travel (cm)", "spread", "Table II (cm)")
    for k in range(len(table)):
        paper = f"{100 * PAPER_BASELINE_M[k]:.2f}" if k < len(PAPER_BASELINE_M) else ""
        numbers = (table.step_m[k], table.step_sigma_m[k], table.travel_m[k], table.travel_sigma_m[k])
        shown.add_row(str(k), *(f"{100 * number:.1f}" for number in numbers), paper)
    console.print(shown)
    scale, spread = reckoning_scale([f.true_m for f in flights], [f.reckoned_m for f in flights])
    console.print(f"the aircraft's own poses travel by 1 / {scale:.3f} too far (spread {spread:.3f})")
    if abs(scale - 1.0) > 2.0 * spread / np.sqrt(len(flights)):
        console.print(f"an AR.Drone takes that as scale={scale:.3f} in its address")
    console.print(f"written to {output}")
