"""Where in a flight the time offset between video and telemetry is taken from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from mission.camera.time_offset import TimeOffset
from mission.flight_offset import UNKNOWN_OFFSET_S, offset_uncertain
from mission.located import Located, Stage
from mission.pose import Pose
from mission.records import Frame, NoiseModel
from mission.settings import MissionSettings
from tests.mission.test_locate import Scene

SURE = TimeOffset(0.0, 0.003, 0.4, 1.0)
UNSURE = TimeOffset(0.0, 0.02, 0.1, 1.0)


@dataclass
class Meter:
    """Tells what it is set to tell in each stage, and remembers how many frames it was shown in each."""

    scene: Scene
    tells: dict[Stage, list[TimeOffset | None]]
    shown: dict[Stage, int] = field(default_factory=dict)
    reason: str = "nothing turned"

    def add(self, frame: Frame) -> None:
        stage = self.scene.notes.stages[-1]
        self.shown[stage] = self.shown.get(stage, 0) + 1

    def measure(self, pose_at: Callable[[float], Pose | None]) -> TimeOffset | None:
        told = self.tells.get(self.scene.notes.stages[-1], [])
        return None if not told else told.pop(0) if len(told) > 1 else told[0]


def flown(tells: dict[Stage, list[TimeOffset | None]], monkeypatch: pytest.MonkeyPatch) -> tuple[Located, Meter, Scene]:
    scene = Scene()
    scene.settings = MissionSettings()
    meter = Meter(scene, tells)
    monkeypatch.setattr("mission.locate.TimeOffsetMeter", lambda _: meter)
    return scene.run(), meter, scene


def wiggles(scene: Scene) -> int:
    return sum("wiggle" in text for text in scene.notes.texts)


def test_a_turn_that_tells_the_offset_is_all_that_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    located, meter, scene = flown({Stage.CENTRE: [SURE]}, monkeypatch)
    assert located.offset is SURE
    assert wiggles(scene) == 0
    assert Stage.SIDESTEP not in meter.shown


def test_a_turn_that_tells_too_little_is_followed_by_a_wiggle(monkeypatch: pytest.MonkeyPatch) -> None:
    located, meter, scene = flown({Stage.CENTRE: [UNSURE, SURE]}, monkeypatch)
    assert located.offset is SURE
    assert wiggles(scene) == 1
    assert Stage.SIDESTEP not in meter.shown


def test_an_uncertain_offset_is_better_than_none_and_the_pattern_may_better_it(monkeypatch: pytest.MonkeyPatch) -> None:
    located, meter, _ = flown({Stage.CENTRE: [UNSURE], Stage.ESTIMATE: [SURE]}, monkeypatch)
    assert located.offset is SURE
    assert meter.shown[Stage.SIDESTEP] > 50


def test_the_pattern_tells_the_offset_where_nothing_before_it_did(monkeypatch: pytest.MonkeyPatch) -> None:
    known, _, _ = flown({Stage.CENTRE: [None], Stage.ESTIMATE: [SURE]}, monkeypatch)
    assert known.offset is SURE


def test_what_the_offset_may_be_off_by_is_in_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    sure, _, _ = flown({Stage.CENTRE: [SURE]}, monkeypatch)
    unsure, _, _ = flown({Stage.CENTRE: [UNSURE]}, monkeypatch)
    unknown, _, scene = flown({}, monkeypatch)
    assert unknown.offset is None
    assert wiggles(scene) == 2
    headings = [located.flight.noise.heading_sigma_rad for located in (sure, unsure, unknown)]
    assert headings == sorted(headings)
    assert headings[0] < headings[-1]


def test_a_known_uncertainty_widens_the_noise_by_what_it_turns() -> None:
    noise = NoiseModel(heading_sigma_rad=0.004, tilt_sigma_rad=0.002)
    assert offset_uncertain(noise, 0.0) == noise
    assert offset_uncertain(noise, 0.01).heading_sigma_rad == pytest.approx(math.hypot(0.004, 0.003))
    assert offset_uncertain(noise) == offset_uncertain(noise, UNKNOWN_OFFSET_S)
