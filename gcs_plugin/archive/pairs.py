"""Which log belongs to which video: by name, or a video that brings its own metadata."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gcs_plugin.archive.job import Job
from mission.errors import LogError
from mission.logs import LOG_SUFFIXES
from mission.logs.read import kind_of

VIDEO_SUFFIXES: Final = (".mp4", ".mov", ".mkv", ".avi", ".m4v", ".ts", ".mpg", ".mpeg")
CAMERA: Final = "camera.toml"
_TRANSPORT: Final = (".ts", ".mpg", ".mpeg")
_LETTERS: Final = re.compile(r"[^a-z0-9]+")


def log_beside(video: Path) -> Path:
    """The log of a video: the file of the same name, the only log in its folder, or its own metadata.

    Raises:
        LogError: there is none, or it cannot be told which.
    """
    try:
        others = [path for path in sorted(video.parent.iterdir()) if path.suffix.lower() in LOG_SUFFIXES]
    except OSError as error:
        raise LogError(f"{video.parent} cannot be read: {error.strerror}", "Check the path.") from error
    same = [path for path in others if _plain(path) == _plain(video)]
    if len(same) == 1:
        return same[0]
    if video.suffix.lower() in _TRANSPORT and video.is_file() and _has_metadata(video):
        return video
    if not same and len(others) == 1:
        return others[0]
    if not others:
        raise LogError(f"there is no log beside {video.name}", "Name it (--log).")
    names = ", ".join(path.name for path in (same or others)[:5])
    raise LogError(f"which log belongs to {video.name} cannot be told: {names}", "Name it (--log).")


def find_jobs(folder: Path, camera: Path | None = None) -> Iterator[Job | tuple[Path, LogError]]:
    """The flights in a folder and those below it, in the order of their paths.

    A flight's name is its video's path within the folder. Its camera file is NAME.camera.toml beside the video, else
    the nearest camera.toml upwards, else the one that is given.

    Args:
        folder: looked through.
        camera: for flights that bring none.
    """
    for video in sorted(path for path in folder.rglob("*") if path.suffix.lower() in VIDEO_SUFFIXES):
        inside = video.relative_to(folder)
        if any(part.startswith(".") or part.endswith(".sidestep") for part in inside.parts) or not video.is_file():
            continue
        try:
            log = log_beside(video)
        except LogError as error:
            yield video, error
            continue
        yield Job(inside.with_suffix("").as_posix(), video, log, _camera_of(video, folder) or camera)


def _camera_of(video: Path, folder: Path) -> Path | None:
    own = video.with_name(f"{video.stem}.{CAMERA}")
    if own.is_file():
        return own
    for above in video.parents:
        if (above / CAMERA).is_file():
            return above / CAMERA
        if above == folder:
            break
    return None


def _plain(path: Path) -> str:
    return _LETTERS.sub("", path.stem.lower())


def _has_metadata(video: Path) -> bool:
    try:
        return kind_of(video) == "misb-klv"
    except (LogError, OSError):
        return False
