"""The calibration flights along a wall: what is flown, and what is made of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.calibration.baseline import baseline_table, reckoning_scale
from mission.calibration.baseline_flight import AGAIN, WallFlights
from mission.calibration.wall import WallSight
from mission.errors import CalibrationError, FlightEnded, VideoError
from mission.planning.pattern import PAPER_BASELINE_M
from mission.pose.buffer import Pose
from mission.records import CameraIntrinsics, Frame, Image
from mission.vehicle.drone import Bounds
from tests.support.fakes import CAMERA, FakeDrone, FakeOrder, FakeVideo


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


class StoppingDrone(FakeDrone):
    """Stays where it is when it is told to hover."""

    def hover(self) -> FakeOrder:
        self._path = None
        return super().hover()


class HaltingVideo(FakeVideo):
    """Stands still from time to time: (from, to) on the clock."""

    halts: tuple[tuple[float, float], ...] = ()

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        frame = super().latest(after_index, timeout_s)
        return None if any(begin <= self.drone.t_s < end for begin, end in self.halts) else frame


def halting(drone: FakeDrone, wall: TruthfulWall, *halts: tuple[float, float]) -> WallFlights:
    video = HaltingVideo(drone)
    video.halts = halts
    return WallFlights(drone, video, CAMERA, wall, lambda: False, lambda: drone.t_s)


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


def test_a_run_in_which_the_video_stands_still_is_flown_again_from_where_it_began() -> None:
    drone = StoppingDrone()
    told: list[int] = []
    runs = halting(drone, TruthfulWall(drone), (105.0, 107.5)).run(3, Bounds(), True, told.append)
    assert told == [1, 1, 2, 3]
    assert drone.calls == ["begin", "hover", "path", "hover", "path", *["path"] * 6, "hold"]
    table = baseline_table([run.true_m for run in runs])
    assert table.step_m == pytest.approx(np.array(PAPER_BASELINE_M), abs=0.03)
    assert np.linalg.norm(drone.position[:2]) < 0.2, "back where it began"


def test_pictures_are_not_needed_on_the_way_back() -> None:
    drone = StoppingDrone()
    told: list[int] = []
    halting(drone, TruthfulWall(drone), (110.0, 113.0)).run(3, Bounds(), True, told.append)
    assert told == [1, 2, 3]


def test_a_video_that_stands_still_in_run_after_run_ends_it_and_the_aircraft_holds() -> None:
    drone = StoppingDrone()
    told: list[int] = []
    often = tuple((105.0 + 6.0 * k, 106.5 + 6.0 * k) for k in range(40))
    with pytest.raises(VideoError, match="no picture for 1 s"):
        halting(drone, TruthfulWall(drone), *often).run(3, Bounds(), True, told.append)
    assert told == [1] * (AGAIN + 1)
    assert drone.calls[-1] == "hold"


def test_a_video_that_does_not_come_back_is_said_and_the_aircraft_holds() -> None:
    drone = StoppingDrone()
    with pytest.raises(VideoError, match="no picture for 1 s"):
        halting(drone, TruthfulWall(drone), (105.0, math.inf)).run(3, Bounds(), True, lambda _: None)
    assert drone.calls[-2:] == ["hover", "hold"]
    assert drone.t_s < 140.0


class ForgetfulDrone(StoppingDrone):
    """Told nothing of where it was for a second after the start."""

    def pose_at(self, t_s: float) -> Pose | None:
        return None if t_s < 101.0 else super().pose_at(t_s)


def test_a_gap_in_the_poses_is_waited_out() -> None:
    drone = ForgetfulDrone()
    assert len(flights(drone, TruthfulWall(drone)).run(3, Bounds(), True, lambda _: None)) == 3


class SilentDrone(StoppingDrone):
    """Tells nothing of where it is."""

    def pose_at(self, t_s: float) -> Pose | None:
        return None


def test_an_aircraft_that_does_not_tell_where_it_is_is_not_flown() -> None:
    drone = SilentDrone()
    with pytest.raises(FlightEnded, match="does not tell where it is"):
        flights(drone, TruthfulWall(drone)).run(3, Bounds(), True, lambda _: None)
    assert drone.calls == ["begin", "hover", "hold"]
