"""`sidestep plan`: find the shortest pattern that measures the distance as exactly as wanted."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from mission.camera import Camera, read_camera
from mission.errors import SettingsError
from mission.planning.bound import Outlook, Plan
from mission.planning.planner import Shortfall, SideRoom, plan
from mission.records import NoiseModel
from mission.settings import CameraSettings, PatternSettings, read_settings

CANNOT_BE_HAD = 3
"""Exit status."""
UNKNOWN_PICTURE = (640, 480)
"""Size that is presumed of the pictures of a camera without a calibration file."""
OFF_CENTRE = 1.0 / 16.0
"""How far from the middle of the picture the heading keeps the target, about, of the picture's size."""


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command("plan")(plan_pattern)


def plan_pattern(
    distance_m: Annotated[float, typer.Option(help="About how far away the person is, horizontally.")],
    sigma_m: Annotated[float | None, typer.Option(help="Wanted 1-sigma of the distance, metres.")] = None,
    sigma_percent: Annotated[float | None, typer.Option(help="Or in percent of the distance.")] = None,
    room_m: Annotated[float | None, typer.Option(help="Room on each side; the limits' radius without it.")] = None,
    room_left_m: Annotated[float | None, typer.Option(help="Room on the left, where it differs.")] = None,
    room_right_m: Annotated[float | None, typer.Option(help="Room on the right, where it differs.")] = None,
    height_m: Annotated[float, typer.Option(help="Height of the camera above the person's ground.")] = 3.0,
    max_speed_m_s: Annotated[float | None, typer.Option(help="Fastest; the limits' without it.")] = None,
    max_time_s: Annotated[float | None, typer.Option(help="For the pattern; what the limits leave without it.")] = None,
    walk_m_s: Annotated[float | None, typer.Option(help="Walking speed; the prior's sigma without it.")] = None,
    rate_hz: Annotated[float, typer.Option(help="Pictures per second in which the person is found.")] = 20.0,
    settings: Annotated[Path | None, typer.Option(help="Settings, TOML.")] = None,
    camera: Annotated[Path | None, typer.Option(help="Camera file of `sidestep calibrate`.")] = None,
) -> None:
    """Find the shortest pattern that measures the distance as exactly as wanted, however the person walks.

    Exit status 3 when it cannot be had: then the best pattern that fits is printed, and what would help.
    """
    wanted_m = _wanted_m(distance_m, sigma_m, sigma_percent)
    mission = read_settings(settings)
    lens = _camera(camera, mission.camera)
    limits = mission.limits.bounds()
    aside_m = math.inf if room_m is None else room_m
    room = SideRoom.within(
        limits,
        height_m,
        left_m=aside_m if room_left_m is None else room_left_m,
        right_m=aside_m if room_right_m is None else room_right_m,
        max_speed_m_s=max_speed_m_s,
        max_time_s=max_time_s,
    )
    outlook = Outlook(
        distance_m,
        lens.intrinsics,
        lens.widen(NoiseModel(), _off_centre_px(lens)),
        mission.prior.prior(),
        mission.prior.speed_sigma_m_s if walk_m_s is None else walk_m_s,
        rate_hz,
    )
    answer = plan(wanted_m, outlook, room)
    console = Console(highlight=False)
    if not lens.calibrated:
        console.print("The camera is not calibrated: the figures allow for that, and would be better if it were.")
    if isinstance(answer, Shortfall):
        console.print(_table(f"{wanted_m:.2f} m cannot be had; the best that can", answer.best, outlook))
        console.print("What would be enough, each by itself:" if answer.helps else str(answer.refusal()), markup=False)
        for help_ in answer.helps:
            console.print(f"  {help_}", markup=False)
    else:
        console.print(_table(f"{wanted_m:.2f} m at {distance_m:.1f} m", answer, outlook))
    console.print(_toml(answer.best.pattern if isinstance(answer, Shortfall) else answer.pattern), markup=False)
    if isinstance(answer, Shortfall):
        raise typer.Exit(CANNOT_BE_HAD)


def _wanted_m(distance_m: float, sigma_m: float | None, sigma_percent: float | None) -> float:
    if sigma_m is not None and sigma_percent is None:
        return sigma_m
    if sigma_percent is not None and sigma_m is None:
        return 0.01 * sigma_percent * distance_m
    raise SettingsError("the wanted accuracy is not clear", "Give either --sigma-m or --sigma-percent.")


def _camera(file: Path | None, settings: CameraSettings) -> Camera:
    file = file or settings.file
    if file is not None:
        return read_camera(file)
    return Camera.from_field_of_view(*UNKNOWN_PICTURE, math.radians(settings.hfov_deg))


def _off_centre_px(lens: Camera) -> tuple[float, float]:
    return OFF_CENTRE * lens.intrinsics.width_px, OFF_CENTRE * lens.intrinsics.height_px


def _table(title: str, found: Plan, outlook: Outlook) -> Table:
    pattern = found.pattern
    right, away = found.worst_walk_m_s
    table = Table(show_header=False, title=title)
    times = "once" if pattern.passes == 1 else f"{pattern.passes} times"
    table.add_row("pattern", f"{pattern.kind}, {pattern.length_m:.1f} m, first to the {pattern.side}, {times}")
    table.add_row("time", f"{found.time_s:.1f} s, at up to {found.peak_speed_m_s:.1f} m/s")
    table.add_row("1-sigma, standing", _sigma(found.standing_sigma_m, outlook))
    table.add_row("1-sigma, worst walk", _sigma(found.worst_sigma_m, outlook))
    table.add_row("worst walk", _walk(right, away))
    return table


def _sigma(sigma_m: float, outlook: Outlook) -> str:
    return f"{sigma_m:.2f} m, {100.0 * sigma_m / outlook.distance_m:.1f} %"


def _walk(right_m_s: float, away_m_s: float) -> str:
    parts = [
        f"{abs(value):.1f} m/s {positive if value > 0.0 else negative}"
        for value, positive, negative in (
            (right_m_s, "to the right", "to the left"),
            (away_m_s, "away", "towards the drone"),
        )
        if abs(value) >= 0.05
    ]
    return " and ".join(parts) or "none: standing"


def _toml(pattern: PatternSettings) -> str:
    return "\n".join(
        (
            "[pattern]",
            f'kind = "{pattern.kind}"',
            f"length_m = {pattern.length_m:g}",
            f"leg_duration_s = {pattern.leg_duration_s:g}",
            f'side = "{pattern.side}"',
            f"passes = {pattern.passes}",
        )
    )
