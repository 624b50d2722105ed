"""What was done of an archive so far, in an SQLite file: one row a flight, each change on the disk."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from gcs_plugin.archive.attempt import Attempt
from gcs_plugin.archive.job import Job
from mission.errors import AnswerError

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS flights (
  name TEXT PRIMARY KEY NOT NULL, files TEXT NOT NULL, settings TEXT NOT NULL, ending TEXT NOT NULL, key TEXT NOT NULL,
  why TEXT NOT NULL, tries INTEGER NOT NULL, seconds REAL NOT NULL)
"""


@dataclass(frozen=True, slots=True)
class Entry:
    """What is known of one flight."""

    name: str
    files: str
    """Path, size and time of change of each input, as `stamp` tells them."""
    settings: str
    ending: str
    key: str
    why: str
    tries: int
    seconds: float


def stamp(job: Job) -> str:
    """Size and time of change of each input: where they are the same, the content is taken to be.

    Raises:
        OSError: one is not there.
    """
    told = []
    for path in job.files:
        stat = path.stat()
        told.append(f"{path.name}:{stat.st_size}:{stat.st_mtime_ns}")
    return "|".join(told)


class Journal:
    """The file; one program at a time.

    Args:
        path: made when it is not there.

    Raises:
        AnswerError: it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._named():
            self._connection = sqlite3.connect(path, timeout=10.0, isolation_level=None, check_same_thread=False)
            self._connection.execute("PRAGMA synchronous = FULL")
            self._connection.execute(_SCHEMA)

    def entry(self, name: str) -> Entry | None:
        """Of one flight; None where nothing was done yet."""
        with self._named():
            row = self._connection.execute("SELECT * FROM flights WHERE name = ?", (name,)).fetchone()
        return None if row is None else Entry(*row)

    def entries(self) -> Iterator[Entry]:
        """All, in the order of their names."""
        with self._named():
            for row in self._connection.execute("SELECT * FROM flights ORDER BY name"):
                yield Entry(*row)

    def note(self, name: str, files: str, settings: str, ended: Attempt, tries: int) -> None:
        """Keep how a flight ended.

        Raises:
            AnswerError: the disk refuses.
        """
        with self._named():
            self._connection.execute(
                "INSERT OR REPLACE INTO flights VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (name, files, settings, ended.ending, ended.key, ended.why, tries, ended.seconds),
            )

    def counts(self) -> dict[str, int]:
        """Number of flights of each ending."""
        with self._named():
            return dict(
                self._connection.execute("SELECT ending, count(*) FROM flights GROUP BY ending ORDER BY ending")
            )

    def close(self) -> None:
        """No more."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise AnswerError(
                f"the journal {self.path} cannot be used: {error}", "Free some space, or end the other run."
            ) from error
