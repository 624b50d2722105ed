"""A run of many flights: each once, resumed without doing anything twice, ended by a full disk only."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

import pytest

from gcs_plugin.archive.attempt import Attempt, Ending, Limits
from gcs_plugin.archive.job import Job, JobSettings, job_key
from gcs_plugin.archive.merge import merge, results_of
from gcs_plugin.archive.run import LocalPool, Progress, Shard, run_archive
from gcs_plugin.archive.worker import result_folder
from mission.errors import AnswerError, InputError, SettingsError
from tests.gcs_plugin.archive.small_flights import small_flight


def card(folder: Path, number: int) -> Path:
    folder.mkdir()
    for k in range(number):
        (folder / f"f{k:02d}.mp4").write_bytes(b"video %d" % k)
        (folder / f"f{k:02d}.csv").write_bytes(b"log %d" % k)
    return folder


class Faked:
    """Answers at once, and remembers what it was asked."""

    workers = 2

    def __init__(self, results: Path, ending: Callable[[Job, int], Ending]) -> None:
        self.asked: list[str] = []
        self._results, self._ending = results, ending

    def submit(self, job: Job) -> Future[Attempt]:
        ending = self._ending(job, self.asked.count(job.name))
        self.asked.append(job.name)
        key = job_key(job, JobSettings())
        if ending in ("done", "refused"):
            folder = result_folder(self._results, key)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "result.json").write_text('{"flight": "x"}')
        future: Future[Attempt] = Future()
        future.set_result(Attempt(ending, key, "" if ending == "done" else f"it {ending}", 1.0))
        return future

    def close(self) -> None:
        self.closed = True


def always_done(_job: Job, _tries: int) -> Ending:
    return "done"


def faked(
    folder: Path, out: Path, ending: Callable[[Job, int], Ending] = always_done, shard: Shard | None = None
) -> tuple[list[str], dict[str, int], list[Progress]]:
    pools: list[Faked] = []
    told: list[Progress] = []

    def pool(results: Path) -> Faked:
        pools.append(Faked(results, ending))
        return pools[0]

    counts = run_archive(folder, out, JobSettings(), pool, shard=shard or Shard(), told=told.append)
    assert pools[0].closed
    return pools[0].asked, counts, told


def test_each_once_and_never_again(tmp_path: Path) -> None:
    folder = card(tmp_path / "card", 20)
    asked, counts, told = faked(folder, tmp_path / "out")
    assert sorted(asked) == [f"f{k:02d}" for k in range(20)]
    assert counts == {"done": 20}
    assert [one.finished for one in told] == list(range(1, 21))
    asked, counts, _ = faked(folder, tmp_path / "out")
    assert asked == []
    assert counts == {"done": 20}


def test_changed_new_and_lost_ones_are_done(tmp_path: Path) -> None:
    folder = card(tmp_path / "card", 4)
    faked(folder, tmp_path / "out")
    (folder / "f01.csv").write_bytes(b"another log")
    (folder / "f09.mp4").write_bytes(b"new")
    (folder / "f09.csv").write_bytes(b"new")
    lost = result_folder(
        tmp_path / "out" / "results", job_key(Job("f02", folder / "f02.mp4", folder / "f02.csv"), JobSettings())
    )
    (lost / "result.json").unlink()
    lost.rmdir()
    asked, _, _ = faked(folder, tmp_path / "out")
    assert sorted(asked) == ["f01", "f02", "f09"]


def test_killed_workers_are_tried_again_and_failures_with_the_next_run(tmp_path: Path) -> None:
    folder = card(tmp_path / "card", 5)

    def ending(job: Job, tries: int) -> Ending:
        if job.name == "f01":
            return "crashed" if tries < 2 else "done"
        return {"f02": "crashed", "f03": "hung", "f04": "refused"}.get(job.name, "done")  # type: ignore[return-value]

    asked, counts, _ = faked(folder, tmp_path / "out", ending)
    assert asked.count("f01") == 3
    assert asked.count("f02") == 3
    assert counts == {"crashed": 1, "done": 2, "hung": 1, "refused": 1}
    asked, counts, _ = faked(folder, tmp_path / "out")
    assert sorted(asked) == ["f02", "f03"]
    assert counts == {"done": 4, "refused": 1}


def test_a_full_disk_ends_the_run_and_the_next_goes_on(tmp_path: Path) -> None:
    folder = card(tmp_path / "card", 30)
    with pytest.raises(AnswerError, match="disk"):
        faked(folder, tmp_path / "out", lambda job, _: "disk" if job.name == "f20" else "done")
    asked, counts, _ = faked(folder, tmp_path / "out")
    assert "f20" in asked
    assert "f00" not in asked
    assert counts == {"done": 30}


def test_a_video_without_log_is_told(tmp_path: Path) -> None:
    folder = card(tmp_path / "card", 3)
    (folder / "f01.csv").unlink()
    asked, counts, _ = faked(folder, tmp_path / "out")
    assert sorted(asked) == ["f00", "f02"]
    assert counts == {"done": 2, "refused": 1}


def test_shards_are_the_whole(tmp_path: Path) -> None:
    folder = card(tmp_path / "card", 20)
    parts = [faked(folder, tmp_path / "out", shard=Shard.parse(f"{k}/3"))[0] for k in (1, 2, 3)]
    assert sorted(name for part in parts for name in part) == [f"f{k:02d}" for k in range(20)]
    assert all(parts)
    for text in ("0/3", "4/3", "a", "1/0"):
        with pytest.raises(SettingsError):
            Shard.parse(text)


def test_real_processes_give_the_same_bytes_as_one_after_the_other(tmp_path: Path) -> None:
    folder = tmp_path / "card"
    folder.mkdir()
    for k in range(3):
        small_flight(folder, f"f{k}", seed=k, seconds=4.0)
    (folder / "f3.mp4").write_bytes(b"corrupt")
    (folder / "f3.csv").write_bytes((folder / "f0.csv").read_bytes())

    def contents(name: str, workers: int) -> dict[str, bytes]:
        out = tmp_path / name
        counts = run_archive(
            folder, out, JobSettings(), lambda results: LocalPool(workers, JobSettings(), results, Limits(200.0, 3000))
        )
        assert counts == {"done": 3, "refused": 1}
        results = out / "results"
        return {path.relative_to(results).as_posix(): path.read_bytes() for path in results.rglob("*.*")}

    both = contents("both", 2)
    assert both == contents("serial", 1)
    assert merge(tmp_path / "both", tmp_path / "all.gpkg") == 0
    assert len(list(results_of(tmp_path / "both"))) == 4


def test_nothing_to_merge(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no results"):
        merge(tmp_path, tmp_path / "all.gpkg")
