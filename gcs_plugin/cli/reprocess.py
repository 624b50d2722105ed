"""`sidestep reprocess`: a recorded video and its log in, located people out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

SOME_MISSING = 3


def register(app: typer.Typer) -> None:
    """Add the command to `app`."""
    app.command("reprocess")(reprocess)


def reprocess(
    video: Annotated[Path, typer.Argument(help="The video file; a transport stream with KLV needs no --log.")],
    log: Annotated[
        Path | None,
        typer.Option(help="tlog, ArduPilot BIN, PX4 ULog, DJI SRT or CSV; else the one beside the video."),
    ] = None,
    camera: Annotated[Path | None, typer.Option(help="Camera file of `sidestep calibrate`.")] = None,
    hfov_deg: Annotated[
        float | None, typer.Option(min=5.0, max=170.0, help="Horizontal angle of view, where there is no camera file.")
    ] = None,
    tilt_down_deg: Annotated[
        float, typer.Option(min=-30.0, max=90.0, help="Of a fixed camera without a camera file.")
    ] = 0.0,
    offset: Annotated[
        float | None, typer.Option(help="Video time less log time, seconds, where the turns do not tell it.")
    ] = None,
    wanted: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="Largest sigma of a distance, over the distance.")
    ] = 0.25,
    gps_order: Annotated[
        Literal["auto", "lat-lon", "lon-lat"], typer.Option(help="SRT: what comes first in GPS(...).")
    ] = "auto",
    utc_offset: Annotated[float | None, typer.Option(help="SRT: hours from UTC of its local times.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder of the result; VIDEO.sidestep if not given.")] = None,
) -> None:
    """Locate the people in a recorded flight.

    Whoever cannot be located is listed with the reason. Exit status 0 when somebody was located, 3 when nobody was, 2
    when the files cannot be used.
    """
    from gcs_plugin.archive.job import Job, JobSettings, checked, run_job
    from gcs_plugin.archive.pairs import log_beside

    found = log if log is not None else log_beside(video)
    job = Job(video.stem, video, found, camera)
    checked(job)
    settings = JobSettings(
        wanted=wanted,
        hfov_deg=hfov_deg,
        tilt_down_deg=tilt_down_deg,
        offset_s=offset,
        gps_order=gps_order,
        utc_offset_h=utc_offset,
    )
    folder = output if output is not None else video.with_name(f"{video.name}.sidestep")
    why = run_job(job, settings, folder, progress=lambda text: typer.echo(text, err=True))
    if why:
        typer.echo(f"sidestep: {why}", err=True)
        raise typer.Exit(2)
    raise typer.Exit(_tell(folder))


def _tell(folder: Path) -> int:
    """Print a result in short; the exit status."""
    from gcs_plugin.archive.result import RESULT

    told = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    for one in told["targets"]:
        speed = one["velocity_enu_m_s"]
        moving = "" if speed is None else f", {(speed[0] ** 2 + speed[1] ** 2) ** 0.5:.1f} m/s"
        typer.echo(
            f"person {one['number']}: {one['lat_deg']:.7f}, {one['lon_deg']:.7f} (CE90 {one['ce90_m']:.1f} m{moving}), "
            f"at {one['video_s']:.1f} s"
        )
    for one in told["not_located"]:
        begin, end = one["seen_video_s"]
        typer.echo(f"person {one['number']}, {begin:.1f} to {end:.1f} s: not located: {one['why']}")
    if not told["targets"] and not told["not_located"]:
        typer.echo("nobody was seen")
    typer.echo(f"in {folder}")
    return 0 if told["targets"] else SOME_MISSING
