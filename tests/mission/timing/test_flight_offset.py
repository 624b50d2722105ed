"""The turn tells how late the video is; where it does not tell enough the pattern is asked, and the better stands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mission.camera import Camera, Mounting
from mission.pose.buffer import Pose
from mission.records import CameraIntrinsics, Frame
from mission.timing.flight_offset import FlightOffset
from mission.timing.time_offset import TimeOffset, TimeOffsetMeter

CAMERA = Camera(
    CameraIntrinsics(64, 48, 50.0, 50.0, 32.0, 24.0), Mounting.tilted(0.0, (0.0, 0.0, 0.0)), calibrated=True
)
FRAME = Frame(image=np.zeros((48, 64, 3), np.uint8), t_s=0.0, index=1)


class Told(TimeOffsetMeter):
    """Measures what it is told to."""

    def __init__(self, sigma_s: float | None) -> None:
        super().__init__(CAMERA)
        self.sigma_s = sigma_s
        self.added = 0

    def add(self, frame: Frame) -> None:
        self.added += 1

    def measure(self, pose_at: Callable[[float], Pose | None]) -> TimeOffset | None:
        return None if self.sigma_s is None else told(self.sigma_s)


def told(sigma_s: float) -> TimeOffset:
    return TimeOffset(0.2, sigma_s, 0.3, 1.0)


def nowhere(_: float) -> Pose | None:
    return None


@pytest.mark.parametrize(
    ("turn", "pattern", "stands"),
    [
        (None, 0.02, 0.02),
        (None, None, None),
        (0.03, 0.02, 0.02),
        (0.02, 0.03, 0.02),
        (0.02, None, 0.02),
        (0.005, 0.001, 0.005),  # settled: the pattern is not asked
    ],
)
def test_the_better_one_stands(turn: float | None, pattern: float | None, stands: float | None) -> None:
    offset = FlightOffset(Told(pattern))
    offset.found = None if turn is None else told(turn)
    assert offset.measure_again(nowhere) is (stands != turn)
    assert (None if offset.found is None else offset.found.sigma_s) == stands


@pytest.mark.parametrize(("turn", "added"), [(None, 1), (0.02, 1), (0.005, 0)])
def test_the_pattern_costs_nothing_where_the_turn_told_enough(turn: float | None, added: int) -> None:
    meter = Told(None)
    offset = FlightOffset(meter)
    offset.found = None if turn is None else told(turn)
    offset.add(FRAME)
    assert meter.added == added


def test_where_it_shall_not_be_measured_it_is_not() -> None:
    offset = FlightOffset(None)
    offset.add(FRAME)
    assert not offset.measure_again(nowhere)
    assert offset.found is None
