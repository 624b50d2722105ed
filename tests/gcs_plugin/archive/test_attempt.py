"""A flight's process that hangs, crashes, eats memory or cannot write costs that flight, and is told apart."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

from gcs_plugin.archive.attempt import Attempt, Limits, attempt
from gcs_plugin.archive.job import Job, JobSettings

JOB = Job("one", Path("a.mp4"), Path("a.csv"))
READ = "import sys, json, os, time; job = json.loads(sys.stdin.read()); "


def made(code: str, limits: Limits = Limits(20.0, 300)) -> Attempt:  # noqa: B008 (frozen)
    return attempt(JOB, JobSettings(), Path("results"), limits, command=(sys.executable, "-c", READ + code))


def test_done_and_refused() -> None:
    assert made('print("chatter"); print(json.dumps({"key": "k", "why": ""}))').ending == "done"
    refused = made('print(json.dumps({"key": "k", "why": "no GPS"}))')
    assert (refused.ending, refused.key, refused.why) == ("refused", "k", "no GPS")


def test_hang() -> None:
    begun = time.monotonic()
    ended = made("time.sleep(60)", Limits(1.0, 300))
    assert (ended.ending, ended.why) == ("hung", "it took longer than 1 s")
    assert time.monotonic() - begun < 15.0


@pytest.mark.skipif(sys.platform != "linux", reason="memory of a process is told by /proc")
def test_memory() -> None:
    ended = made("held = bytearray(os.urandom(1000)) * 400_000; time.sleep(60)", Limits(50.0, 200))
    assert (ended.ending, ended.why) == ("memory", "it took more than 200 MB of memory")


def test_crash_and_kill() -> None:
    crashed = made('raise RuntimeError("a bug")')
    assert (crashed.ending, crashed.why) == ("crashed", "its process ended with exit status 1: RuntimeError: a bug")
    killed = made("os.kill(os.getpid(), 9)")
    assert (killed.ending, killed.why) == ("crashed", "its process ended with signal 9")


def test_disk_full() -> None:
    assert made('print(json.dumps({"key": "k", "why": "full"})); sys.exit(5)').ending == "disk"


def test_one_that_does_not_even_read_its_job() -> None:
    ended = attempt(
        JOB, JobSettings(), Path("results"), Limits(), command=(sys.executable, "-c", "raise SystemExit(7)")
    )
    assert ended.ending == "crashed"


def test_end_of_the_run() -> None:
    command = (sys.executable, "-c", READ + "time.sleep(60)")
    assert attempt(JOB, JobSettings(), Path("r"), Limits(), lambda: True, command).ending == "stopped"
