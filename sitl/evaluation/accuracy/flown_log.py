"""The closed-loop programme's log: one CSV line for each flight and method, appended as soon as a flight is judged.

The log is all the memory that the programme has: stopped at any moment and started again it flies what is not in there
yet. A flight's lines are written at once and end with the bound's; what a crash cut off is flown again.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mission.errors import AnswerError
from sitl.evaluation.accuracy.closed_loop import ClosedLoop, FlownRow
from sitl.evaluation.accuracy.programme import BOUND, Figures, MethodOutcome, figures_of
from sitl.evaluation.accuracy.rows import ROWS, Row

COLUMNS = (
    *("pattern", "noise", "seed", "motion", "row_depth_m", "flight", "depth_m"),
    *("method", "error_percent", "inside", "refused_because"),
)


@dataclass(frozen=True, slots=True)
class FlownLog:
    """The log in a file.

    Args:
        path: the CSV file; made when the first flight is added.
        setting: what is flown; lines of other settings are passed over.
    """

    path: Path
    setting: ClosedLoop

    def add(self, flown: FlownRow) -> None:
        """Append a flight.

        Raises:
            AnswerError: the file cannot be written.
        """
        try:
            self._mend()
            fresh = not self.path.exists() or self.path.stat().st_size == 0
            with self.path.open("a", encoding="utf-8", newline="") as stream:
                writer = csv.writer(stream)
                writer.writerows(((COLUMNS,) if fresh else ()) + tuple(_lines(flown)))
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise AnswerError(f"{self.path} cannot be written: {error.strerror}", "Make room for it.") from error

    def flown(self, rows: Sequence[Row] = ROWS) -> dict[tuple[Row, int], tuple[MethodOutcome, ...]]:
        """What each method made of each whole flight of this setting, by row and the flight's number.

        Raises:
            AnswerError: the file is there and cannot be read, or is another table.
        """
        if not self.path.exists():
            return {}
        try:
            with self.path.open(encoding="utf-8", newline="") as stream:
                lines = list(csv.reader(stream))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise AnswerError(f"{self.path} cannot be read: {error}", "Choose another folder.") from error
        if lines and tuple(lines[0]) != COLUMNS:
            raise AnswerError(f"{self.path} is not this programme's log", "Choose another folder.")
        known = {(row.motion, f"{row.depth_m:g}"): row for row in rows}
        found: dict[tuple[Row, int], list[MethodOutcome]] = {}
        for line in lines[1:]:
            entry = _entry(line, self.setting, known)
            if entry is not None:
                found.setdefault(entry[0], []).append(entry[1])
        return {key: tuple(each) for key, each in found.items() if each[-1].method == BOUND}

    def figures(self, rows: Sequence[Row] = ROWS) -> Iterator[Figures]:
        """The figures of all flights that are in the log, row by row."""
        flown = self.flown(rows)
        for row in rows:
            flights = [outcomes for (other, _), outcomes in flown.items() if other == row]
            everything = [found for outcomes in flights for found in outcomes]
            for name in dict.fromkeys(found.method for found in everything):
                yield figures_of(row, name, [found for found in everything if found.method == name])

    def _mend(self) -> None:
        """Cut off a line that a crash left without its end."""
        if not self.path.exists():
            return
        content = self.path.read_bytes()
        if content and not content.endswith(b"\n"):
            os.truncate(self.path, content.rfind(b"\n") + 1)


def _lines(flown: FlownRow) -> Iterator[tuple[str, ...]]:
    setting, row = flown.setting, flown.row
    case = (setting.pattern, setting.noise, str(setting.seed), row.motion, f"{row.depth_m:g}", str(flown.number))
    depth = "" if flown.depth_m is None else f"{flown.depth_m:.3f}"
    for found in flown.outcomes:
        error = "" if found.error_percent is None else f"{found.error_percent:.4f}"
        inside = "" if found.inside is None else str(int(found.inside))
        yield (*case, depth, found.method, error, inside, flown.error)


def _entry(
    line: list[str], setting: ClosedLoop, known: dict[tuple[str, str], Row]
) -> tuple[tuple[Row, int], MethodOutcome] | None:
    """A line as row, flight and outcome; None for another setting's, or one that makes no sense."""
    if len(line) != len(COLUMNS) or tuple(line[:3]) != (setting.pattern, setting.noise, str(setting.seed)):
        return None
    row = known.get((line[3], line[4]))
    try:
        number, error = int(line[5]), float(line[8]) if line[8] else None
    except ValueError:
        return None
    if row is None:
        return None
    return (row, number), MethodOutcome(line[7], error, bool(int(line[9])) if line[9] in ("0", "1") else None)
