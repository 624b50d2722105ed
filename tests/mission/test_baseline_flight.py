"""The calibration flights along a wall: what is flown, and what is made of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.baseline_flight import WallFlights
from mission.camera.baseline import baseline_table, reckoning_scale
from mission.camera.wall import WallSight
from mission.drones.drone import Bounds
from mission.errors import CalibrationError, FlightEnded
from mission.pattern import PAPER_BASELINE_M
from mission.records import CameraIntrinsics, Image
from tests.mission.fakes import CAMERA, FakeDrone, FakeVideo


class TruthfulWall:
    """Knows where the aircraft really is: by `scale` less far than it thinks."""

    def __init__(self, drone: FakeDrone, scale: float = 1.0) -> None:
        self.drone, self.scale, self.hidden = drone, scale, False

    def look(self, image: Image, lens: CameraIntrinsics) -> WallSight | None:
        if self.hidden:
            return None
        east, north, up = self.drone.position
        # The aircraft looks north at a wall along the east: x is east, y is down, z is north.
        return WallSight(np.array([self.scale * east, -up, north - 4.0]), 0.3, 5)


class EasternWall(TruthfulWall):
    """Runs along the south, seen when looking east."""

    def __init__(self, drone: FakeDrone) -> None:
        super().__init__(drone)
        self.norths: list[float] = []

    def look(self, image: Image, lens: CameraIntrinsics) -> WallSight | None:
        self.norths.append(float(self.drone.position[1]))
        return WallSight(np.array([-self.norths[-1], 0.0, -4.0]), 0.3, 5)


def flights(drone: FakeDrone, wall: TruthfulWall, aborted: bool = False) -> WallFlights:
    return WallFlights(drone, FakeVideo(drone), CAMERA, wall, lambda: aborted, lambda: drone.t_s)


def test_three_runs_out_and_back_give_the_table() -> None:
    drone = FakeDrone()
    wall = TruthfulWall(drone, scale=0.94)
    told: list[int] = []
    runs = flights(drone, wall).run(3, Bounds(), True, told.append)
    assert told == [1, 2, 3]
    assert drone.calls == ["begin", "hover", *["path"] * 6, "hold"]
    table = baseline_table([run.true_m for run in runs])
    assert table.step_m == pytest.approx(0.94 * np.array(PAPER_BASELINE_M), abs=0.03)
    scale, spread = reckoning_scale([run.true_m for run in runs], [run.reckoned_m for run in runs])
    assert scale == pytest.approx(0.94, abs=0.005)
    assert spread < 0.01
    assert np.linalg.norm(drone.position[:2]) < 0.2, "back where it began"


def test_to_the_right_it_flies_to_the_right() -> None:
    drone = FakeDrone(heading=math.pi / 2)
    wall = EasternWall(drone)
    flights(drone, wall).run(3, Bounds(), False, lambda _: None)
    assert min(wall.norths) < -8.0, "heading east, right is south"


def test_a_wall_out_of_view_is_said_and_the_aircraft_holds() -> None:
    drone = FakeDrone()
    wall = TruthfulWall(drone)
    wall.hidden = True
    with pytest.raises(CalibrationError, match="recognised"):
        flights(drone, wall).run(3, Bounds(), True, lambda _: None)
    assert drone.calls[-1] == "hold"


def test_an_abort_holds() -> None:
    drone = FakeDrone()
    with pytest.raises(FlightEnded, match="aborted"):
        flights(drone, TruthfulWall(drone), aborted=True).run(3, Bounds(), True, lambda _: None)
    assert drone.calls[-1] == "hold"
