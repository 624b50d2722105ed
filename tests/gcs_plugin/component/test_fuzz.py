"""Broken MAVLink at the camera component, over a real link; the long form is in tests/soak."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority
from gcs_plugin.component import CameraComponent, Identity, Order, Picture, StationLink
from mission.settings import AuthoritySettings, MissionSettings
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.pilot.loopback import loopback_socket
from sitl.faults import FrameMutator, dialect_frames
from tests.support.fuzz_bench import FuzzBench
from tests.support.processor_wait import Stopwatch

STATION, CAMERA = (255, 190), (1, 100)


@contextmanager
def component_under_fuzz() -> Iterator[tuple[FuzzBench, list[Order]]]:
    """A component that carries out every order at once, with a clock fast enough for its limits on the rate.

    Yields:
        The far side of its link, and the last of the orders that it took.
    """
    orders: list[Order] = []
    ticks = iter(range(1 << 60))
    authority = Authority(AuthoritySettings(commands_per_s=1000.0, flights_per_minute=60.0))
    link = MavlinkLink(loopback_socket(), source_system=1, source_component=193)
    component = CameraComponent(
        StationLink(link, CAMERA[1]),
        Identity(*CAMERA),
        Picture(640, 480, 1.1, "udp://127.0.0.1:5600"),
        MissionSettings(),
        authority,
        refusal=lambda _: "",
        clock=lambda: next(ticks) * 0.01,
    )

    def attend() -> None:
        for _ in range(10):
            order = component.attend(0.0)
            if order is not None:
                orders[:] = [*orders[-9:], order]
                component.progress(50)
                component.ended(mavlink.MAV_RESULT_ACCEPTED)

    bench = FuzzBench(link, attend)
    try:
        with component:
            yield bench, orders
    finally:
        bench.close()
        link.close()


def mutator(seed: int) -> FrameMutator:
    """Mostly what a ground station would send to the camera."""
    rng = np.random.default_rng(seed)
    to_camera = dialect_frames(rng, *STATION, CAMERA)
    orders = []
    for command in (*range(31010, 31013), 2004, 2005, 2010, 510, 511, 512, 521, 522, 525, 527, 2504, 2505, 520):
        for params in ((0.0,) * 7, (0.4, 0.3, 0.6, 0.8, 0.0, 0.0, 0.0), (275.0, 1e5, 0.0, 0.0, 0.0, 0.0, 0.0)):
            message = mavlink.MAVLink_command_long_message(*CAMERA, command, 0, *params)
            orders.append(bytes(message.pack(mavlink.MAVLink(None, *STATION))))
    return FrameMutator(to_camera + 4 * orders, rng)


def answer_s(bench: FuzzBench) -> float:
    """Seconds until the component sends the CAMERA_INFORMATION that was asked for, without those of other programs."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    ask = mavlink.MAVLink_command_long_message(*CAMERA, 512, 0, 259, 0, 0, 0, 0, 0, 0)
    bench.sock.setblocking(False)
    watch = Stopwatch()
    while watch.own_s < 1.0 and watch.wall_s < 60.0:
        bench.sock.send(ask.pack(mavlink.MAVLink(None, *STATION)))
        again = time.monotonic() + 0.2
        while time.monotonic() < again:
            bench.attend()
            try:
                data = bench.sock.recv(65536)
            except BlockingIOError:
                time.sleep(0.002)
                continue
            if any(m.get_type() == "CAMERA_INFORMATION" for m in parser.parse_buffer(data) or []):
                return watch.own_s
    raise AssertionError(f"no answer in {watch.wall_s:.1f} s, of which this process could run for {watch.own_s:.1f} s")


@pytest.mark.parametrize("kind", ["mutated frames", "random bytes"])
def test_5_000_broken_datagrams_leave_the_component_answering(kind: str) -> None:
    broken = mutator(5)
    with component_under_fuzz() as (bench, orders):
        found = bench.flood(broken.mutated if kind == "mutated frames" else broken.noise, 5_000)
        assert answer_s(bench) < 1.0
    assert bool(orders) is (kind == "mutated frames"), "some of the mutated frames are orders still"
    assert found.slowest_answer_s < 1.0
    assert found.growth_bytes < 500_000
