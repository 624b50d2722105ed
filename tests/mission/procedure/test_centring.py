"""Where in a flight the time offset between video and telemetry is taken from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from unittest.mock import Mock

import numpy as np
import pytest

from mission.errors import DetectionError
from mission.pose.buffer import Pose, heading
from mission.procedure.result import LocateResult, Stage, TargetChoice
from mission.records import Box, Detection, Frame, Image, NoiseModel
from mission.settings import MissionSettings
from mission.timing.flight_offset import UNKNOWN_OFFSET_S, offset_uncertain
from mission.timing.time_offset import TimeOffset
from mission.track import Track
from tests.mission.procedure.test_locate import Scene
from tests.support.fakes import Sight

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


def flown(
    tells: dict[Stage, list[TimeOffset | None]], monkeypatch: pytest.MonkeyPatch
) -> tuple[LocateResult, Meter, Scene]:
    scene = Scene()
    scene.settings = MissionSettings()
    meter = Meter(scene, tells)
    monkeypatch.setattr("mission.procedure.locate.TimeOffsetMeter", Mock(return_value=meter))
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


class Elusive(Sight):
    """Out of the picture for some time of the turn; a tracker has given it up when it comes back."""

    away_s: tuple[float, float] = (math.inf, math.inf)
    refuses = False
    beside = False
    lost = False
    taken_back = 0

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        found = [] if self._gone() else super().detect(image, region)
        if self.beside and found:
            box = found[0].box
            found.append(Detection(Box(box.left_px + 25.0, box.top_px, box.width_px, box.height_px), 0.9))
        return found

    def take_back(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> bool:
        self.lost = self.refuses
        self.taken_back += 1
        return not self.refuses

    def update(self, frame: Frame, *motion: object, **more: object) -> Track:
        self.lost = self.lost or self._gone()
        gone_from_s, self.gone_from_s = self.gone_from_s, -math.inf if self.lost else math.inf
        track = super().update(frame)
        self.gone_from_s = gone_from_s
        return track

    def _gone(self) -> bool:
        return self.away_s[0] <= self.drone.t_s < self.away_s[1]


def leaving(away_s: tuple[float, float], **how: bool) -> tuple[Scene, Elusive]:
    scene = Scene(right=3.0)
    sight = Elusive(scene.drone, scene.walker)
    sight.away_s = away_s
    for name, value in how.items():
        setattr(sight, name, value)
    scene.sight = sight
    return scene, sight


def test_a_target_that_leaves_the_picture_while_the_aircraft_turns_is_taken_back() -> None:
    scene, sight = leaving((100.5, 102.0))
    located = scene.run()
    assert sight.taken_back == 1
    assert "the target is in the picture again" in scene.notes.texts
    truth = scene.walker.at(located.estimate.t_s)
    assert np.linalg.norm(located.estimate.position_enu_m[:2] - truth[:2]) < 0.05


def test_the_aircraft_turns_on_to_where_the_target_should_be_while_it_is_away() -> None:
    scene, _ = leaving((100.5, 103.0))
    scene.run()
    headings = [pose.world_from_body_wxyz for pose in scene.drone._poses if 102.5 < pose.t_s < 102.9]
    bearing = math.atan2(3.0, 6.0)
    assert heading(headings[-1]) == pytest.approx(bearing, abs=math.radians(4.0))


@pytest.mark.parametrize("how", [{"refuses": True}, {"beside": True}], ids=["other looks", "two people"])
def test_somebody_else_is_not_taken_for_the_target(how: dict[str, bool]) -> None:
    scene, sight = leaving((100.5, 101.0), **how)
    scene.choice = TargetChoice()
    with pytest.raises(DetectionError, match="lost while turning"):
        scene.run()
    assert scene.drone.calls[-1] == "hold"
    assert sight.taken_back == 0 or how.get("refuses")


def test_nobody_who_comes_back_ends_the_flight_after_some_seconds() -> None:
    scene, _ = leaving((100.5, math.inf))
    with pytest.raises(DetectionError, match="lost while turning"):
        scene.run()
    assert 104.0 < scene.drone.t_s < 108.0
    assert scene.drone.calls[-1] == "hold"
