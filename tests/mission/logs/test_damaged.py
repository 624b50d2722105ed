"""Damaged logs: read as far as they go, or refused with a reason; never another error, never for ever."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mission.errors import LogError
from mission.logs import PoseLog, read_log
from tests.mission.logs.test_kinds import WRITERS, flight


def read_or_refused(path: Path) -> PoseLog | None:
    """None when it was refused."""
    try:
        return read_log(path)
    except LogError:
        return None


@pytest.mark.parametrize("kind", list(WRITERS))
@pytest.mark.parametrize("seed", range(12))
def test_flipped_and_missing_bytes(kind: str, seed: int, tmp_path: Path) -> None:
    name, write = WRITERS[kind]
    path = tmp_path / name
    write(path, flight(4.0))
    rng = np.random.default_rng(seed)
    data = bytearray(path.read_bytes())
    for _ in range(1 + seed % 4):
        at = int(rng.integers(len(data)))
        if rng.uniform() < 0.5:
            data[at : at + int(rng.integers(1, 200))] = b""
        else:
            data[at : at + 20] = rng.bytes(20)
    path.write_bytes(bytes(data))
    log = read_or_refused(path)
    if log is None:
        return
    t_s = log.positions.t_s
    assert len(t_s) >= 2
    assert (np.diff(t_s) > 0.0).all()
    assert np.isfinite(log.positions.enu_m).all()


@pytest.mark.parametrize("kind", list(WRITERS))
def test_cut_in_the_middle(kind: str, tmp_path: Path) -> None:
    name, write = WRITERS[kind]
    path = tmp_path / name
    write(path, flight(8.0))
    whole = read_log(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    part = read_log(path)
    assert 0.4 < len(part.positions.t_s) / len(whole.positions.t_s) < 0.75


@pytest.mark.parametrize("name", ["a.tlog", "a.bin", "a.ulg", "a.srt", "a.csv", "a.ts"])
def test_other_files(name: str, tmp_path: Path) -> None:
    for content in (b"", b"nothing of the kind\n" * 50, bytes(5000), np.random.default_rng(1).bytes(20000)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(LogError) as caught:
            read_log(tmp_path / name)
        assert caught.value.remedy


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "none.tlog")


def test_log_without_gps(tmp_path: Path) -> None:
    name, write = WRITERS["tlog"]
    lost = flight()
    lost.lat_lon_amsl[:, :2] = 0.0
    write(tmp_path / name, lost)
    with pytest.raises(LogError, match="GPS fix"):
        read_log(tmp_path / name)


def test_clock_that_is_restarted(tmp_path: Path) -> None:
    name, write = WRITERS["tlog"]
    short, long = flight(3.0), flight(8.0)
    write(tmp_path / "1.tlog", short)
    write(tmp_path / "2.tlog", long)
    (tmp_path / name).write_bytes((tmp_path / "1.tlog").read_bytes() + (tmp_path / "2.tlog").read_bytes())
    log = read_log(tmp_path / name)
    assert len(log.positions.t_s) == len(long.t_s)
