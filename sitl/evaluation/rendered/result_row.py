"""One line of figures for each flight and each way to its poses, in a CSV file with which a broken run goes on."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

from mission.errors import AnswerError

Poses = Literal["reported", "steadied"]


@dataclass(frozen=True, slots=True)
class ResultRow:
    """A flight, answered. NaN where there is no figure; metres, errors as in `sitl.evaluation.rendered.score`."""

    number: int
    """Of the flight in its run."""
    seed: int
    noise: str
    scene: str
    distance_m: float
    walk_deg: float
    speed_m_s: float
    poses: Poses
    """Where the sightings' poses come from."""
    tracked_share: float
    depth_error: float = math.nan
    """Relative, signed."""
    position_error_m: float = math.nan
    across_error_m: float = math.nan
    along_error_m: float = math.nan
    sigma_m: float = math.nan
    nees: float = math.nan
    heading_error_deg: float = math.nan
    """Rms over the pattern, relative to its first frame."""
    tilt_error_deg: float = math.nan
    offset_error_ms: float = math.nan
    render_ms: float = math.nan
    """Per frame, processor time, as all of these."""
    track_ms: float = math.nan
    steady_ms: float = math.nan
    solve_ms: float = math.nan
    """For the whole answer."""
    said: str = ""
    """Why there is no answer, or how the poses were obtained."""

    @property
    def answered(self) -> bool:
        """Whether there was an answer."""
        return math.isfinite(self.depth_error)


_NAMES = tuple(field.name for field in fields(ResultRow))
_TEXTS = ("noise", "scene", "poses", "said")
_WHOLE = ("number", "seed")


def rewrite(path: Path, outcomes: Sequence[ResultRow]) -> None:
    """Replace the file.

    Raises:
        AnswerError: the file cannot be written.
    """
    path.unlink(missing_ok=True)
    append(path, outcomes)


def append(path: Path, outcomes: Sequence[ResultRow]) -> None:
    """Add lines to the file, made with its header when it is not there.

    Raises:
        AnswerError: the file cannot be written.
    """
    try:
        fresh = not path.exists() or path.stat().st_size == 0
        with path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            if fresh:
                writer.writerow(_NAMES)
            for outcome in outcomes:
                writer.writerow([_text(getattr(outcome, name)) for name in _NAMES])
    except OSError as error:
        raise AnswerError(f"cannot write {path}: {error.strerror}", "Name a folder that can be written.") from error


def read(path: Path) -> list[ResultRow]:
    """The lines of a file; none when there is no file. A last line that was cut off by a crash is left out.

    Raises:
        AnswerError: it is not such a file.
    """
    return list(_read(path)) if path.exists() else []


def _read(path: Path) -> Iterator[ResultRow]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise AnswerError(f"cannot read {path}: {error}", "Name another folder.") from error
    if rows and tuple(rows[0]) != _NAMES:
        raise AnswerError(f"{path} is not a table of rendered flights", "Name another folder.")
    for line, row in enumerate(rows[1:], 2):
        if len(row) != len(_NAMES):
            if line == len(rows):
                return
            raise AnswerError(
                f"{path}, line {line}: {len(row)} fields instead of {len(_NAMES)}", "Name another folder."
            )
        try:
            yield _outcome(dict(zip(_NAMES, row, strict=True)))
        except ValueError as error:
            raise AnswerError(f"{path}, line {line}: {error}", "Name another folder.") from error


def _outcome(row: dict[str, str]) -> ResultRow:
    poses: Poses = "steadied" if row["poses"] == "steadied" else "reported"
    numbers = {name: float(row[name]) for name in _NAMES if name not in (*_TEXTS, *_WHOLE)}
    return ResultRow(
        number=int(row["number"]),
        seed=int(row["seed"]),
        noise=row["noise"],
        scene=row["scene"],
        poses=poses,
        said=row["said"],
        **numbers,
    )


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
