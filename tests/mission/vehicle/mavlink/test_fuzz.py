"""Broken MAVLink on the drone's link; the long form is in tests/soak."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from mission.vehicle.mavlink.decode_throttle import DecodeThrottle
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.mavlink_drone import MavlinkDrone
from mission.vehicle.mavlink.safeguards import SAFEGUARD_MESSAGES, Safeguards
from mission.vehicle.pilot.loopback import loopback_socket
from mission.vehicle.state.packet_loss import PacketLoss
from mission.vehicle.state.vehicle_state import VEHICLE_MESSAGES
from sitl.faults import FrameMutator, dialect_frames
from tests.support.fuzz_bench import FuzzBench
from tests.support.tlog import ARDUCOPTER
from tests.support.tlog import frames as recorded


@contextmanager
def drone_under_fuzz() -> Iterator[tuple[FuzzBench, MavlinkDrone]]:
    """A drone, its safeguards and its loss meter behind a real link."""
    drone, loss = MavlinkDrone("udpin://127.0.0.1:1"), PacketLoss()
    drone._state.system = 1
    safeguards, thinning = Safeguards(drone._state), DecodeThrottle(1, 0.0, sparing=True)

    def take(message: Any, arrived_s: float) -> None:
        if message.get_type() in SAFEGUARD_MESSAGES:
            safeguards.take(message)
        else:
            drone._take(message, arrived_s)

    def look_at(message_id: int, frame: bytes, arrived_s: float) -> bool:
        loss.observe(frame, 1, arrived_s)
        return thinning.wants(message_id, frame, arrived_s)

    link = MavlinkLink(
        loopback_socket(),
        source_system=1,
        source_component=193,
        handler=take,
        handled=(*VEHICLE_MESSAGES, *SAFEGUARD_MESSAGES),
        wants=look_at,
    )

    def look() -> None:
        drone.telemetry()
        drone.pose_at(0.0)
        drone.noise()
        drone.events()
        safeguards.fence()
        safeguards.cautions()
        loss.fraction(0.0)

    bench = FuzzBench(link, look)
    try:
        yield bench, drone
    finally:
        bench.close()
        link.close()


def vehicle_frames(rng: np.random.Generator) -> list[bytes]:
    """Frames of all messages, and many of those that the drone reads, some from a real flight."""
    flight = [frame for _, frame in recorded(ARDUCOPTER)][:2000:2]
    return dialect_frames(rng) + flight


@pytest.mark.parametrize("kind", ["mutated frames", "random bytes"])
def test_5_000_broken_datagrams_leave_the_drone_alive(kind: str) -> None:
    rng = np.random.default_rng(13)
    mutator = FrameMutator(vehicle_frames(rng), rng)
    with drone_under_fuzz() as (bench, _):
        found = bench.flood(mutator.mutated if kind == "mutated frames" else mutator.noise, 5_000)
    assert found.datagrams == 5_000
    assert found.slowest_answer_s < 1.0
    assert found.growth_bytes < 500_000
