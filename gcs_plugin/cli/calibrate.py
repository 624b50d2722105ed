"""`sidestep calibrate`: calibrate the camera, the video's latency, and the paper's pattern."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from gcs_plugin.cli.address import HELP, given_address
from gcs_plugin.cli.calibrate_baseline import baseline
from mission.calibration.board import Board, CharucoBoard, Chessboard
from mission.calibration.intrinsics import BoardCalibration, calibrate_board, read_pictures
from mission.calibration.latency import Wiggle, measure_latency
from mission.calibration.theta import calibrate_theta
from mission.camera.camera import Camera
from mission.camera.file import read_camera, write_camera
from mission.camera.mounting import Mounting
from mission.errors import SettingsError
from mission.vehicle.make import make_drone
from mission.video import open_video

calibrate = typer.Typer(help="Calibrate the camera, and the paper's pattern.", no_args_is_help=True)
calibrate.command()(baseline)

_Output = Annotated[Path, typer.Option("--output", "-o", help="The camera file to write.", dir_okay=False)]
_Tilt = Annotated[float, typer.Option("--tilt-down-deg", help="How far the camera looks down on the airframe.")]


def register(app: typer.Typer) -> None:
    """Add the command to the `sidestep` command line."""
    app.add_typer(calibrate, name="calibrate")


@calibrate.command()
def board(
    folder: Annotated[Path, typer.Argument(help="Folder with the pictures of the board.")],
    columns: Annotated[int, typer.Option(help="Squares in a row.")],
    rows: Annotated[int, typer.Option(help="Squares in a column.")],
    square_mm: Annotated[float, typer.Option(help="Side of a square.")],
    output: _Output,
    charuco: Annotated[str | None, typer.Option(help="Marker dictionary of a ChArUco board: DICT_5X5_100.")] = None,
    marker_mm: Annotated[float | None, typer.Option(help="Side of a ChArUco marker.")] = None,
    tilt_down_deg: _Tilt = 0.0,
) -> None:
    """From a folder of chessboard or ChArUco pictures."""
    pattern: Board
    if charuco is None:
        pattern = Chessboard(columns, rows, square_mm / 1000.0)
    elif marker_mm is None:
        raise SettingsError("A ChArUco board needs the size of its markers", "Give --marker-mm.")
    else:
        pattern = CharucoBoard(columns, rows, square_mm / 1000.0, marker_mm / 1000.0, charuco)
    result = calibrate_board(read_pictures(folder), pattern, Mounting.tilted(math.radians(tilt_down_deg)))
    write_camera(output, result.camera)
    _report(Console(), result, output)


@calibrate.command()
def theta(
    depth_m: Annotated[float, typer.Option(help="From the lens to the object, along the lens axis.")],
    side_m: Annotated[float, typer.Option(help="From the lens axis to the object, horizontally.")],
    pixels: Annotated[float, typer.Option(help="From the picture's middle to the object, horizontally.")],
    width: Annotated[int, typer.Option(help="Width of the picture, pixels.")],
    height: Annotated[int, typer.Option(help="Height of the picture, pixels.")],
    output: _Output,
    tilt_down_deg: _Tilt = 0.0,
) -> None:
    """From one object at a known place (the paper's theta/p)."""
    camera = calibrate_theta(depth_m, side_m, pixels, width, height, Mounting.tilted(math.radians(tilt_down_deg)))
    write_camera(output, camera)
    angle_deg = math.degrees(math.atan2(side_m, depth_m))
    console = Console()
    console.print(
        f"theta {angle_deg:.2f} deg, theta/p {angle_deg / pixels:.4f} deg/px, "
        f"f {camera.intrinsics.fx:.1f} px +- {100.0 * camera.focal_sigma:.1f} %; written to {output}",
        highlight=False,
    )


@calibrate.command()
def latency(
    drone_url: Annotated[str, typer.Option("--drone", help="udp://..., tcp://..., serial://..., ardrone://...")],
    video_url: Annotated[str, typer.Option("--video", help=HELP)],
    camera_file: Annotated[Path, typer.Option("--camera", help="Camera file; the latency is stored in it.")],
    wiggle: Annotated[bool, typer.Option("--wiggle", help="Yaw by ourselves; the aircraft must hover.")] = False,
    duration_s: Annotated[float, typer.Option(min=5.0, max=120.0, help="Longest time to watch.")] = 20.0,
) -> None:
    """The offset between video and telemetry, from a yaw movement."""
    console = Console()
    camera = read_camera(camera_file)
    drone = make_drone(drone_url, camera=camera)
    try:
        drone.connect(timeout_s=30.0)
        video = open_video(given_address(video_url), latency_s=camera.latency_s)
        try:
            first = video.latest(-1, 5.0)
            if first is not None:
                camera = camera.for_picture(first.image.shape[1], first.image.shape[0])
            found = measure_latency(
                drone,
                video,
                camera,
                duration_s=duration_s,
                wiggle=Wiggle() if wiggle else None,
                progress=lambda text: console.print(text, highlight=False),
            )
        finally:
            video.close()
    finally:
        drone.close()
    stored = _with_latency(read_camera(camera_file), found.offset_s)
    write_camera(camera_file, stored)
    console.print(
        f"latency {1e3 * stored.latency_s:.0f} ms +- {1e3 * found.sigma_s:.0f} ms "
        f"(from a turn of {math.degrees(found.turned_rad):.0f} deg); stored in {camera_file}",
        highlight=False,
    )
    if abs(found.gain - 1.0) > 0.1:
        console.print(
            f"[yellow]The picture turned {found.gain:.2f} times as far as the aircraft: the focal length is wrong by "
            "about as much; calibrate the camera.[/yellow]",
            highlight=False,
        )


def _with_latency(camera: Camera, offset_s: float) -> Camera:
    return replace(camera, latency_s=round(camera.latency_s + offset_s, 4))


def _report(console: Console, result: BoardCalibration, output: Path) -> None:
    table = Table("picture", "verdict", "corners", "rms px")
    for one in result.pictures:
        table.add_row(one.name, one.verdict, str(one.corners), "" if one.rms_px is None else f"{one.rms_px:.2f}")
    console.print(table)
    lens = result.camera.intrinsics
    console.print(
        f"fx {lens.fx:.1f} fy {lens.fy:.1f} cx {lens.cx:.1f} cy {lens.cy:.1f} px, "
        f"rms {result.rms_px:.2f} px, focal length +- {100.0 * result.focal_sigma:.2f} %, "
        f"{100.0 * result.coverage:.0f} % of the picture covered; written to {output}",
        highlight=False,
    )
