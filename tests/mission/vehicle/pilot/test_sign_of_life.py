"""Only the flight's own loop keeps the aircraft flying; work in other threads reads a snapshot of the poses."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

import numpy as np
import pytest

from mission.clock import ClockMap
from mission.pose.buffer import PoseBuffer
from mission.pose.history import PoseHistory
from mission.vehicle.ardrone.ardrone import ARDrone
from mission.vehicle.drone import Bounds
from mission.vehicle.mavlink.mavlink_drone import MavlinkDrone
from mission.vehicle.pilot.process import PilotProcess

OwnDrone = MavlinkDrone | ARDrone


class CountingPilot(PilotProcess):
    """Counts the signs of life; runs nothing."""

    def __init__(self) -> None:
        self.signs = 0

    def keep_alive(self) -> None:
        self.signs += 1

    def send(self, line: object) -> bool:
        return True

    def take_events(self) -> list[object]:  # type: ignore[override]  # there are none
        return []

    @property
    def alive(self) -> bool:
        return True


DRONES = [lambda: MavlinkDrone("udpin://127.0.0.1:1"), lambda: ARDrone("ardrone://127.0.0.1")]
CALLS: list[Callable[[OwnDrone], object]] = [
    lambda drone: drone.pose_at(1.0),
    lambda drone: drone.poses()(1.0),
    lambda drone: drone.telemetry(),
    lambda drone: drone.events(),
    lambda drone: drone.noise(),
    lambda drone: drone.keep_alive(),
]


@pytest.mark.parametrize("make", DRONES)
def test_no_call_from_a_worker_is_a_sign_of_life(make: Callable[[], OwnDrone]) -> None:
    drone, pilot = make(), CountingPilot()
    drone._pilot = pilot
    drone.begin(Bounds())
    for call in CALLS:
        worker = threading.Thread(target=call, args=(drone,))
        worker.start()
        worker.join()
    assert pilot.signs == 0
    drone.keep_alive()
    drone.telemetry()
    drone.events()
    assert pilot.signs == 3


@pytest.mark.parametrize("make", DRONES)
def test_reading_a_pose_is_no_sign_of_life_of_the_loop_either(make: Callable[[], OwnDrone]) -> None:
    drone, pilot = make(), CountingPilot()
    drone._pilot = pilot
    drone.begin(Bounds())
    drone.pose_at(1.0)
    assert pilot.signs == 0


def history(until_s: float) -> tuple[PoseBuffer, ClockMap]:
    buffer, clock = PoseBuffer(), ClockMap()
    for k in range(round(until_s / 0.05) + 1):
        t_s = 0.05 * k
        buffer.add_position(t_s, np.array([t_s, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
        buffer.add_attitude(t_s, np.array([1.0, 0.0, 0.0, 0.0]))
        clock.observe(t_s, 100.0 + t_s)
    return buffer, clock


def test_a_snapshot_stays_as_it_was() -> None:
    buffer, clock = history(1.0)
    known = PoseHistory(buffer.snapshot(), clock, np.eye(3), np.eye(3))
    buffer.clear()
    pose = known.at(100.5)
    assert pose is not None
    assert pose.t_s == 100.5
    assert math.isclose(float(pose.position_enu_m[0]), 0.5, abs_tol=1e-9)
    assert known.at(101.5) is None


def test_a_snapshot_of_nothing_knows_no_pose() -> None:
    assert PoseHistory(PoseBuffer(), ClockMap(), np.eye(3), np.eye(3)).at(1.0) is None
