"""`sidestep archive`: many recorded flights, on as many processes as there are cores."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

SOME_FAILED = 3
_OUT = "sidestep-archive"


def register(app: typer.Typer) -> None:
    """Add the group of commands to `app`."""
    group = typer.Typer(name="archive", no_args_is_help=True, help="Many recorded flights.")
    group.command("run")(run)
    group.command("status")(status)
    group.command("merge")(merge)
    app.add_typer(group)


def run(
    folder: Annotated[Path, typer.Argument(help="Of videos, each with its log beside it.")],
    output: Annotated[Path | None, typer.Option(help=f"Of journal and results; FOLDER/{_OUT} if not given.")] = None,
    workers: Annotated[int, typer.Option(min=1, max=256, help="Flights at a time.")] = 1,
    camera: Annotated[Path | None, typer.Option(help="Camera file for flights that bring none.")] = None,
    hfov_deg: Annotated[float | None, typer.Option(min=5.0, max=170.0, help="Where there is no camera file.")] = None,
    tilt_down_deg: Annotated[float, typer.Option(min=-30.0, max=90.0, help="Where there is no camera file.")] = 0.0,
    wanted: Annotated[float, typer.Option(min=0.01, max=1.0, help="Largest sigma of a distance over it.")] = 0.25,
    timeout_min: Annotated[float, typer.Option(min=0.01, help="For one flight.")] = 120.0,
    memory_mb: Annotated[int, typer.Option(min=200, help="For one flight.")] = 3000,
    shard: Annotated[str, typer.Option(help="K/N: only this part, for a Slurm array of N jobs.")] = "1/1",
) -> None:
    """Reprocess every flight in a folder that has no result yet.

    Run it again to go on: what is done is left out, what failed is tried again. Exit status 3 when flights failed.
    """
    from gcs_plugin.archive.attempt import Limits
    from gcs_plugin.archive.job import JobSettings
    from gcs_plugin.archive.run import LocalPool, Progress, Shard, run_archive

    if not folder.is_dir():
        raise typer.BadParameter(f"{folder} is no folder", param_hint="FOLDER")
    settings = JobSettings(wanted=wanted, hfov_deg=hfov_deg, tilt_down_deg=tilt_down_deg)
    limits = Limits(60.0 * timeout_min, memory_mb)
    began_s, begun = time.monotonic(), 0

    def told(progress: Progress) -> None:
        nonlocal begun
        begun += 1
        left_s = (time.monotonic() - began_s) / begun * (progress.total - progress.finished)
        ended = progress.ended
        how = ended.ending + (f": {ended.why}" if ended.why else "")
        typer.echo(
            f"{progress.finished} of {progress.total} found, {_span(left_s)} left for these: {progress.flight}: {how}"
        )

    counts = run_archive(
        folder,
        output or folder / _OUT,
        settings,
        lambda results: LocalPool(workers, settings, results, limits),
        camera,
        Shard.parse(shard),
        told,
    )
    typer.echo(_summary(counts))
    failed = sum(number for ending, number in counts.items() if ending not in ("done", "refused"))
    raise typer.Exit(SOME_FAILED if failed else 0)


def status(
    output: Annotated[Path, typer.Argument(help="Folder of a run's journal and results.")],
    failed: Annotated[bool, typer.Option("--failed", help="List what failed or was refused, with the reason.")] = False,
) -> None:
    """How far an archive's run is."""
    from gcs_plugin.archive.journal import Journal

    journals = sorted(output.glob("journal*.sqlite"))
    if not journals:
        raise typer.BadParameter(f"there is no journal in {output}", param_hint="OUTPUT")
    counts: dict[str, int] = {}
    for path in journals:
        with Journal(path) as journal:
            for ending, number in journal.counts().items():
                counts[ending] = counts.get(ending, 0) + number
            if failed:
                for entry in journal.entries():
                    if entry.why:
                        typer.echo(f"{entry.name}: {entry.ending}: {entry.why}")
    typer.echo(_summary(counts))


def merge(
    output: Annotated[Path, typer.Argument(help="Folder of a run's journal and results.")],
    target: Annotated[Path | None, typer.Option(help="The file; OUTPUT/archive.gpkg if not given.")] = None,
) -> None:
    """One GeoPackage of everybody in all results; GeoJSON for a file that is named so."""
    from gcs_plugin.archive.merge import merge as merged
    from gcs_plugin.archive.merge import merge_geojson

    path = target or output / "archive.gpkg"
    number = merge_geojson(output, path) if path.suffix.lower() in (".geojson", ".json") else merged(output, path)
    typer.echo(f"{number} people in {path}")


def _summary(counts: dict[str, int]) -> str:
    told = ", ".join(f"{number} {ending}" for ending, number in counts.items())
    return f"{sum(counts.values())} flights: {told or 'none'}"


def _span(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"
