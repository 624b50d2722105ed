"""Many flights: what is done is left out, the rest goes to workers, and each ending is kept before the next begins."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Protocol

from gcs_plugin.archive.attempt import Attempt, Limits, attempt
from gcs_plugin.archive.job import Job, JobSettings, is_done
from gcs_plugin.archive.journal import Journal, stamp
from gcs_plugin.archive.pairs import find_jobs
from gcs_plugin.archive.worker import result_folder
from gcs_plugin.durable import make_folder, unwritable
from mission.errors import AnswerError, LogError, SettingsError

RESULTS: Final = "results"
FINAL: Final = ("done", "refused")
"""Endings that the same inputs would lead to again."""
MOST_TRIES: Final = 3
_RETRIED: Final = ("crashed",)
_AHEAD: Final = 4
"""Jobs handed out for each worker: few are in memory, and none waits."""


@dataclass(frozen=True, slots=True)
class Shard:
    """Part k of n of an archive, for a batch system that starts n programs."""

    k: int = 1
    n: int = 1

    @classmethod
    def parse(cls, text: str) -> Shard:
        """From K/N.

        Raises:
            SettingsError: it is none.
        """
        found = re.fullmatch(r"(\d+)/(\d+)", text.strip())
        if found is None or not 1 <= int(found[1]) <= int(found[2]):
            raise SettingsError(f"{text!r} is no part of an archive", "Give K/N, 1/10 to 10/10.")
        return cls(int(found[1]), int(found[2]))

    def has(self, name: str) -> bool:
        """Whether a flight is in this part, whatever other flights there are."""
        return int(hashlib.sha256(name.encode()).hexdigest()[:12], 16) % self.n == self.k - 1

    @property
    def journal(self) -> str:
        """File name of its journal."""
        return "journal.sqlite" if self.n == 1 else f"journal-{self.k}-of-{self.n}.sqlite"


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is."""

    flight: str
    ended: Attempt
    finished: int
    """Flights that have ended in this run, or had before."""
    total: int
    """Flights that were found so far."""


class Pool(Protocol):
    """Where attempts are made."""

    @property
    def workers(self) -> int:
        """How many at a time."""
        ...

    def submit(self, job: Job) -> Future[Attempt]:
        """Begin one."""
        ...

    def close(self) -> None:
        """End all."""
        ...


class LocalPool:
    """Processes on this machine, one a flight.

    Args:
        workers: how many at a time.
        settings: of the work.
        results: folder of all results.
        limits: of each flight.
    """

    def __init__(self, workers: int, settings: JobSettings, results: Path, limits: Limits) -> None:
        self._workers = workers
        self._settings, self._results, self._limits = settings, results, limits
        self._stop = threading.Event()
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="archive")

    @property
    def workers(self) -> int:
        """How many at a time."""
        return self._workers

    def submit(self, job: Job) -> Future[Attempt]:
        """Begin a flight when a worker is free."""
        return self._threads.submit(self._attempt, job)

    def _attempt(self, job: Job) -> Attempt:
        if self._stop.is_set():
            return Attempt("stopped", "", "the run was ended", 0.0)
        return attempt(job, self._settings, self._results, self._limits, self._stop.is_set)

    def close(self) -> None:
        """End what runs, and begin nothing more."""
        self._stop.set()
        self._threads.shutdown(cancel_futures=True)


def run_archive(
    folder: Path,
    out: Path,
    settings: JobSettings,
    pool: Callable[[Path], Pool],
    camera: Path | None = None,
    shard: Shard = Shard(),
    told: Callable[[Progress], None] = lambda _: None,
) -> dict[str, int]:
    """Reprocess all flights of a folder that have no result yet.

    Args:
        folder: of videos and logs.
        out: of journal and results; made when it is not there.
        settings: of every flight.
        pool: made for the folder of results.
        camera: for flights that bring no camera file.
        shard: only this part of them.
        told: of each ending.

    Returns:
        Number of flights of each ending.

    Raises:
        AnswerError: the disk is full: what is done is kept, and the rest goes on with the next run.
    """
    results = out / RESULTS
    try:
        make_folder(results)
    except OSError as error:
        raise unwritable(results, error) from error
    asked = json.dumps(asdict(settings), sort_keys=True)
    with Journal(out / shard.journal) as journal:
        workers = pool(results)
        try:
            _run(_Wanted(folder, camera, shard, journal, results, asked), workers, told)
        finally:
            workers.close()
        return journal.counts()


@dataclass(slots=True)
class _Wanted:
    """The flights that are to be done, found one by one."""

    folder: Path
    camera: Path | None
    shard: Shard
    journal: Journal
    results: Path
    asked: str
    found: int = 0
    finished: int = 0

    def jobs(self) -> Iterator[Job]:
        for one in find_jobs(self.folder, self.camera):
            if isinstance(one, tuple):
                self._without_log(*one)
                continue
            if not self.shard.has(one.name):
                continue
            self.found += 1
            if self._done(one):
                self.finished += 1
                continue
            yield one

    def _done(self, job: Job) -> bool:
        entry = self.journal.entry(job.name)
        if entry is None or entry.settings != self.asked or entry.ending not in FINAL:
            return False
        return entry.files == _stamp(job) and (not entry.key or is_done(result_folder(self.results, entry.key)))

    def _without_log(self, video: Path, error: LogError) -> None:
        name = video.relative_to(self.folder).with_suffix("").as_posix()
        if self.shard.has(name):
            self.found += 1
            self.finished += 1
            self.journal.note(name, "", self.asked, Attempt("refused", "", error.cause, 0.0), 1)


def _run(wanted: _Wanted, pool: Pool, told: Callable[[Progress], None]) -> None:
    going: dict[Future[Attempt], tuple[Job, int]] = {}
    jobs: Iterable[Job] = wanted.jobs()
    source = iter(jobs)
    again: list[tuple[Job, int]] = []
    exhausted = False
    while True:
        while len(going) < pool.workers * _AHEAD and (again or not exhausted):
            job, tries = again.pop() if again else (next(source, None), 0)
            if job is None:
                exhausted = True
                break
            going[pool.submit(job)] = job, tries + 1
        if not going:
            return
        ready, _ = wait(going, return_when=FIRST_COMPLETED)
        for future in ready:
            job, tries = going.pop(future)
            ended = future.result()
            if ended.ending == "disk":
                raise AnswerError(ended.why, "Make room; the next run goes on from here.")
            if ended.ending in _RETRIED and tries < MOST_TRIES:
                again.append((job, tries))
                continue
            wanted.journal.note(job.name, _stamp(job), wanted.asked, ended, tries)
            wanted.finished += 1
            told(Progress(job.name, ended, wanted.finished, wanted.found))


def _stamp(job: Job) -> str:
    try:
        return stamp(job)
    except OSError:
        return ""
