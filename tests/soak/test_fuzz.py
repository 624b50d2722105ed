"""A million broken frames, and ten minutes of random bytes, at the drone's link and at the camera component."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from sitl.faults import FrameMutator
from tests.gcs_plugin.component.test_fuzz import answer_s, component_under_fuzz, mutator
from tests.mission.vehicle.mavlink.test_fuzz import drone_under_fuzz, vehicle_frames
from tests.soak.conftest import Note
from tests.support.fuzz_bench import Flood

pytestmark = [pytest.mark.soak, pytest.mark.timeout(3600)]

FRAMES = 1_000_000
NOISE_S = 600.0
FLAT_BYTES = 2_000_000


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> None:
    """Pytest keeps every line of the log: the memory would not be flat because of that."""
    caplog.set_level(logging.ERROR)


def _judge(name: str, found: Flood, note: Note) -> None:
    note(f"{name}: slowest answer (s) of {found.datagrams} datagrams", [found.slowest_answer_s])
    note(f"{name}: the same with the time in which the machine ran others (s)", [found.slowest_wall_s])
    note(f"{name}: datagrams that overflowed the socket's buffer", [float(found.overflowed)])
    note(f"{name}: growth of the memory over the second half (kB)", [found.growth_bytes / 1000.0])
    assert found.slowest_answer_s < 1.0
    assert found.growth_bytes < FLAT_BYTES


def test_a_million_mutated_frames_leave_the_drone_alive(note: Note) -> None:
    rng = np.random.default_rng(21)
    with drone_under_fuzz() as (bench, _):
        _judge("drone, mutated frames", bench.flood(FrameMutator(vehicle_frames(rng), rng).mutated, FRAMES), note)


def test_ten_minutes_of_random_bytes_leave_the_drone_alive(note: Note) -> None:
    rng = np.random.default_rng(22)
    with drone_under_fuzz() as (bench, _):
        draw = FrameMutator(vehicle_frames(rng), rng).noise
        _judge("drone, random bytes", bench.flood(draw, 1 << 60, NOISE_S), note)


def test_a_million_mutated_frames_leave_the_component_answering(note: Note) -> None:
    with component_under_fuzz() as (bench, _):
        _judge("component, mutated frames", bench.flood(mutator(23).mutated, FRAMES), note)
        assert answer_s(bench) < 1.0


def test_ten_minutes_of_random_bytes_leave_the_component_answering(note: Note) -> None:
    with component_under_fuzz() as (bench, _):
        _judge("component, random bytes", bench.flood(mutator(24).noise, 1 << 60, NOISE_S), note)
        assert answer_s(bench) < 1.0
