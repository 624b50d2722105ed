import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

from mission.calibration.latency import Wiggle, measure_latency
from mission.camera import Camera
from mission.errors import CalibrationError, FlightEnded, FlightRefused, VideoError
from mission.pose.buffer import Pose
from mission.records import Frame
from mission.vehicle.drone import OrderState
from mission.video import VideoState, VideoStats
from tests.support.fakes import FakeDrone, FakeOrder
from tests.support.panorama import Flight

CAMERA = Camera.from_field_of_view(256, 192, math.radians(64.0))


class PlayedVideo:
    """The frames of a synthetic flight; its clock moves as they are taken."""

    def __init__(self, flight: Flight) -> None:
        self._frames: Iterator[Frame] = flight.frames()
        self.now_s = 0.0

    def clock(self) -> float:
        return self.now_s

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        frame = next(self._frames, None)
        self.now_s += 0.05
        return frame

    def stats(self) -> VideoStats:
        return VideoStats(VideoState.RECONNECTING, 0.0, 0, 0, 0, 0, None, 0.0, "cable pulled")

    def close(self) -> None: ...


class PlayedDrone(FakeDrone):
    """Reports the synthetic flight's attitude."""

    def fly_like(self, flight: Flight) -> "PlayedDrone":
        self._reported: Callable[[float], Pose | None] = flight.pose_at()
        return self

    def pose_at(self, t_s: float) -> Pose | None:
        return self._reported(t_s)

    def keep_alive(self) -> None: ...


def wiggling(duration_s: float, offset_s: float = 0.12) -> Flight:
    return Flight(CAMERA, lambda t: 0.25 * math.sin(math.pi * t), duration_s, offset_s=offset_s, seed=2)


def test_the_operators_yaw_gives_the_latency() -> None:
    flight = wiggling(5.0)
    video = PlayedVideo(flight)
    said: list[str] = []
    found = measure_latency(
        PlayedDrone().fly_like(flight), video, CAMERA, duration_s=6.0, clock=video.clock, progress=said.append
    )
    assert found.offset_s == pytest.approx(0.12, abs=0.010)
    assert "Yaw the aircraft" in said[0]


def test_hovering_instead_of_yawing_is_explained() -> None:
    flight = Flight(CAMERA, lambda _: 0.0, 1.5, seed=2)
    video = PlayedVideo(flight)
    with pytest.raises(CalibrationError, match="turned by only"):
        measure_latency(PlayedDrone().fly_like(flight), video, CAMERA, duration_s=1.4, clock=video.clock)


def test_a_video_that_stops_is_an_error() -> None:
    flight = wiggling(0.5)
    video = PlayedVideo(flight)
    with pytest.raises(VideoError, match="cable pulled"):
        measure_latency(PlayedDrone().fly_like(flight), video, CAMERA, duration_s=20.0, clock=video.clock)


class Orders(PlayedDrone):
    """Answers each order with a final state and notes what was asked."""

    final = OrderState.DONE

    def turn_to(self, heading_rad: float) -> FakeOrder:
        self.calls.append(f"turn {math.degrees(heading_rad):.0f}")
        return FakeOrder("turn", self.final, "the pilot took over" if self.final is OrderState.ENDED else "")

    def hover(self) -> FakeOrder:
        return FakeOrder("hover", OrderState.DONE)

    def hold(self) -> FakeOrder:
        self.calls.append("hold")
        return FakeOrder("hold", OrderState.DONE)


def test_a_pilot_who_takes_over_ends_the_wiggle_and_the_aircraft_is_given_back() -> None:
    drone = Orders(heading=math.radians(10.0)).fly_like(wiggling(1.0))
    Orders.final = OrderState.ENDED
    video = PlayedVideo(wiggling(1.0))
    with pytest.raises(FlightEnded, match="the pilot took over"):
        measure_latency(drone, video, CAMERA, wiggle=Wiggle(), clock=video.clock)
    assert [call for call in drone.calls if call.startswith(("turn", "hold"))] == ["turn 30", "hold"]


def test_a_wiggle_turns_to_both_sides_and_ends_where_it_began() -> None:
    flight = wiggling(1.0)
    drone = Orders(heading=math.radians(10.0)).fly_like(flight)
    Orders.final = OrderState.DONE
    video = PlayedVideo(flight)
    found = measure_latency(drone, video, CAMERA, wiggle=Wiggle(turns=2), clock=video.clock)
    assert found.offset_s == pytest.approx(0.12, abs=0.03)
    assert [call for call in drone.calls if call.startswith(("turn", "hold"))] == [
        "turn 30",
        "turn 350",
        "turn 10",
        "hold",
    ]


def test_no_wiggle_on_the_ground() -> None:
    class Grounded(PlayedDrone):
        def telemetry(self):  # type: ignore[no-untyped-def]
            return replace(super().telemetry(), in_air=False)

    with pytest.raises(FlightRefused, match="not in the air"):
        measure_latency(Grounded(), PlayedVideo(wiggling(0.1)), CAMERA, wiggle=Wiggle())
