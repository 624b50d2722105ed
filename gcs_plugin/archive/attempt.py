"""One attempt at one flight: in a process of its own, that is ended when it takes too long or too much memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from gcs_plugin.archive.job import Job, JobSettings
from gcs_plugin.archive.worker import CANNOT_WRITE, to_json

Ending = Literal["done", "refused", "crashed", "hung", "memory", "disk", "stopped"]
"""done: a result; refused: a result that says why the flight cannot be used; the others left no result."""
_POLL_S: Final = 0.1
_MODULE: Final = "gcs_plugin.archive.worker"


@dataclass(frozen=True, slots=True)
class Limits:
    """What one flight may take."""

    timeout_s: float = 7200.0
    memory_mb: int = 3000


@dataclass(frozen=True, slots=True)
class Attempt:
    """How it ended."""

    ending: Ending
    key: str
    why: str
    """For people; empty when done."""
    seconds: float


def attempt(
    job: Job,
    settings: JobSettings,
    results: Path,
    limits: Limits,
    stopped: Callable[[], bool] = lambda: False,
    command: tuple[str, ...] = (sys.executable, "-m", _MODULE),
) -> Attempt:
    """Reprocess a flight in another process.

    Args:
        job: the flight.
        settings: what is asked.
        results: folder of all results.
        limits: of time and memory.
        stopped: answers True when the whole run shall end.
        command: what to run.
    """
    begun = time.monotonic()
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment, text=True
    )
    assert process.stdin is not None
    try:
        process.stdin.write(to_json(job, settings, results))
        process.stdin.close()
    except BrokenPipeError:
        pass  # it ended at once: how is told below
    process.stdin = None
    ended: Ending | None = None
    said = ""
    while True:
        try:
            said, complained = process.communicate(timeout=_POLL_S)
            break
        except subprocess.TimeoutExpired:
            ended = ended or _over(process.pid, begun, limits, stopped)
            if ended is not None:
                process.kill()
    seconds = time.monotonic() - begun
    if ended is not None:
        return Attempt(ended, "", _WORDS[ended].format(limits=limits), seconds)
    told = _last_line(said)
    if process.returncode == 0 and told is not None:
        return Attempt("refused" if told["why"] else "done", told["key"], told["why"], seconds)
    if process.returncode == CANNOT_WRITE and told is not None:
        return Attempt("disk", told["key"], told["why"], seconds)
    last = complained.strip().splitlines()[-1:] or [""]
    how = f"signal {-process.returncode}" if process.returncode < 0 else f"exit status {process.returncode}"
    return Attempt("crashed", "", f"its process ended with {how}{': ' if last[0] else ''}{last[0][:300]}", seconds)


_WORDS: Final[dict[Ending, str]] = {
    "hung": "it took longer than {limits.timeout_s:.0f} s",
    "memory": "it took more than {limits.memory_mb} MB of memory",
    "stopped": "the run was ended",
}


def _over(pid: int, begun: float, limits: Limits, stopped: Callable[[], bool]) -> Ending | None:
    if stopped():
        return "stopped"
    if time.monotonic() - begun > limits.timeout_s:
        return "hung"
    return "memory" if resident_mb(pid) > limits.memory_mb else None


def resident_mb(pid: int) -> float:
    """Memory of a process, where the system tells (Linux); 0 elsewhere."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError, ValueError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _last_line(said: str) -> dict[str, str] | None:
    lines = said.strip().splitlines()
    try:
        told = json.loads(lines[-1]) if lines else None
    except json.JSONDecodeError:
        return None
    return told if isinstance(told, dict) and {"key", "why"} <= set(told) else None
