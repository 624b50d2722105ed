from __future__ import annotations

import multiprocessing
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing.shared_memory import SharedMemory

import numpy as np
import pytest

from sitl.aircraft.truth import TruthRing, VehicleTruth


def record(t: float) -> VehicleTruth:
    """Flying east at t m/s and turning: every number follows from the time, so a torn record shows."""
    angle = 0.3 * t
    attitude = np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
    return VehicleTruth(t, np.array([0.5 * t * t, t, -t]), np.array([t, 1.0, -1.0]), attitude)


@pytest.fixture
def ring() -> Iterator[TruthRing]:
    made = TruthRing.create(seconds=2.0, rate_hz=100.0)
    yield made
    made.close()
    made.unlink()


def test_an_empty_ring_has_nothing(ring: TruthRing) -> None:
    assert ring.newest() is None
    assert ring.at(1.0) is None
    assert ring.history() == []


def test_the_newest_is_what_was_written_last(ring: TruthRing) -> None:
    for k in range(5):
        ring.write(record(k * 0.01))
    newest = ring.newest()
    assert newest is not None
    assert newest.t_s == pytest.approx(0.04)
    np.testing.assert_allclose(newest.position_enu_m, [0.5 * 0.04**2, 0.04, -0.04])


def test_between_two_records_position_velocity_and_attitude_are_interpolated(ring: TruthRing) -> None:
    for k in range(11):
        ring.write(record(k * 0.1))
    found = ring.at(0.537)
    assert found is not None
    expected = record(0.537)
    np.testing.assert_allclose(found.position_enu_m, expected.position_enu_m, atol=1e-12)
    np.testing.assert_allclose(found.velocity_enu_m_s, expected.velocity_enu_m_s, atol=1e-12)
    np.testing.assert_allclose(found.world_from_body_wxyz, expected.world_from_body_wxyz, atol=1e-12)


def test_attitudes_of_opposite_sign_are_the_same_attitude(ring: TruthRing) -> None:
    first, second = record(0.0), record(0.1)
    ring.write(first)
    ring.write(VehicleTruth(0.1, second.position_enu_m, second.velocity_enu_m_s, -second.world_from_body_wxyz))
    found = ring.at(0.05)
    assert found is not None
    assert abs(found.world_from_body_wxyz @ record(0.05).world_from_body_wxyz) == pytest.approx(1.0, abs=1e-12)


def test_outside_of_what_it_holds_there_is_no_truth(ring: TruthRing) -> None:
    for k in range(500):  # holds 200
        ring.write(record(k * 0.01))
    assert ring.at(2.5) is None
    assert ring.at(5.0) is None
    assert ring.at(4.0) is not None
    history = ring.history()
    assert len(history) == 200
    assert [h.t_s for h in history] == pytest.approx([3.0 + 0.01 * k for k in range(200)])


def test_marks_are_shared_by_name(ring: TruthRing) -> None:
    other = TruthRing.attach(ring.name)
    assert other.mark(0) is None
    ring.set_mark(0, 12.5)
    other.set_mark(7, 3.0)
    assert other.mark(0) == 12.5
    assert ring.mark(7) == 3.0
    with pytest.raises(IndexError, match="marks 0 to 7"):
        ring.set_mark(8, 0.0)
    other.close()
    other.close()


def test_what_is_not_a_ring_is_refused() -> None:
    stranger = SharedMemory(create=True, size=4096)
    with pytest.raises(ValueError, match="not a truth ring"):
        TruthRing.attach(stranger.name)
    stranger.close()
    stranger.unlink()
    with pytest.raises(FileNotFoundError):
        TruthRing.attach(stranger.name)
    with pytest.raises(ValueError, match="cannot interpolate"):
        TruthRing.create(seconds=0.0)


def _write_fast(name: str, seconds: float) -> None:
    ring, k, until = TruthRing.attach(name), 0, time.monotonic() + seconds
    while time.monotonic() < until:
        ring.write(record(k * 1e-3))
        k += 1
    ring.close()


def test_a_reader_never_sees_half_a_record_of_a_fast_writer() -> None:
    ring = TruthRing.create(seconds=0.02, rate_hz=200.0)  # 4 records: they are overwritten all the time
    writer = multiprocessing.get_context("spawn").Process(target=_write_fast, args=(ring.name, 1.0))
    writer.start()
    seen = 0
    while writer.is_alive():
        newest = ring.newest()
        if newest is None:
            continue
        for found in (newest, ring.at(newest.t_s), *ring.history()):
            if found is not None:
                seen += 1
                np.testing.assert_allclose(found.position_enu_m, record(found.t_s).position_enu_m, atol=1e-9)
                np.testing.assert_allclose(found.world_from_body_wxyz, record(found.t_s).world_from_body_wxyz)
    writer.join()
    ring.close()
    ring.unlink()
    assert seen > 100


def test_the_ring_outlives_a_reader_that_ends() -> None:
    """Before Python 3.13 the resource tracker of a reading process would free the memory at its end."""
    ring = TruthRing.create(seconds=1.0, rate_hz=100.0)
    ring.write(record(1.0))
    script = (
        f"from sitl.aircraft.truth import TruthRing; r = TruthRing.attach({ring.name!r}); assert r.newest(); r.close()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    again = TruthRing.attach(ring.name)
    assert again.newest() is not None
    again.close()
    ring.close()
    ring.unlink()
