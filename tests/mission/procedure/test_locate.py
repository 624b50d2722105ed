import math
import re
import threading
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import pytest

from mission.errors import Aborted, DetectionError, EstimateRefused, FlightEnded, FlightRefused, LinkError, VideoError
from mission.pose.buffer import Pose, PoseAt
from mission.procedure.locate import Locate
from mission.procedure.result import LocateResult, Stage, TargetChoice
from mission.records import Box, FlightSightings, Frame, NoiseModel
from mission.settings import MissionSettings
from mission.track import Track
from mission.vehicle.drone import DroneEvent, Path, Telemetry
from tests.support.fakes import CAMERA, FakeDrone, FakeOrder, FakeVideo, Sight, Walker


@dataclass
class Notes:
    """Remembers what the procedure reported; calls `at` when a stage begins."""

    stages: list[Stage] = field(default_factory=list)
    flights: list[FlightSightings] = field(default_factory=list)
    answers: list[LocateResult] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    """An entry for each answer that was stored."""
    frames: int = 0
    tracked_in: Counter[Stage] = field(default_factory=Counter)

    def stage(self, stage: Stage, text: str) -> None:
        self.texts.append(text)
        if not self.stages or self.stages[-1] is not stage:
            self.stages.append(stage)

    def frame(self, frame: Frame, track: Track | None) -> None:
        self.frames += 1
        if track is not None:
            self.tracked_in[self.stages[-1]] += 1

    def sightings(self, flight: FlightSightings) -> None:
        self.flights.append(flight)

    def located(self, located: LocateResult) -> None:
        self.answers.append(located)

    def keep(self, located: LocateResult) -> None:
        del located
        self.kept.append("stored")


class Scene:
    """A drone at 1.5 m, a person somewhere ahead, and one order to locate them."""

    def __init__(self, forward: float = 6.0, right: float = 1.0, velocity: tuple[float, float] = (0.0, 0.0)) -> None:
        self.drone = FakeDrone()
        self.walker = Walker(np.array([right, forward, 0.9]), np.array([*velocity, 0.0]))
        self.video = FakeVideo(self.drone)
        self.sight = Sight(self.drone, self.walker)
        self.notes = Notes()
        self.abort_in: Stage | None = None
        self.choice = TargetChoice()
        self.settings = MissionSettings.model_validate({"video": {"check_offset": False}})

    def run(self) -> LocateResult:
        locate = Locate(
            self.drone,
            self.video,
            CAMERA,
            self.sight,
            self.sight,
            self.settings,
            self.notes,
            aborted=lambda: self.abort_in is not None and self.abort_in in self.notes.stages,
            clock=lambda: self.drone.t_s,
        )
        return locate.run(self.choice, "test")


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.6, 0.0), (0.0, 0.6), (0.42, 0.42), (-0.42, 0.42)])
def test_a_person_is_located_in_any_direction_of_walk(velocity: tuple[float, float]) -> None:
    scene = Scene(velocity=velocity)
    located = scene.run()
    truth = scene.walker.at(located.estimate.t_s)
    assert np.linalg.norm(located.estimate.position_enu_m[:2] - truth[:2]) < 0.12
    assert located.estimate.velocity_enu_m_s is not None
    np.testing.assert_allclose(located.estimate.velocity_enu_m_s[:2], velocity, atol=0.03)


def test_the_stages_follow_the_papers_figure_2_and_end_in_hold() -> None:
    scene = Scene()
    scene.run()
    assert scene.notes.stages == [stage for stage in Stage if stage is not Stage.REPOSITION]
    assert scene.drone.calls == ["begin", "hover", "path", "hold"]


def test_a_wanted_accuracy_chooses_the_pattern_within_the_length_that_is_free() -> None:
    scene = Scene()
    pattern = {"accuracy_percent": 20.0, "length_m": 5.0}
    scene.settings = MissionSettings.model_validate({"video": {"check_offset": False}, "pattern": pattern})
    located = scene.run()
    across = located.drone_track[:, 1]
    assert 0.8 < np.ptp(across) < 3.0  # a short pattern is enough for 20 %
    assert any(re.search(r"out-and-back, .* for 1?\d\.\d % at about 6 m$", text) for text in scene.notes.texts)


def test_the_target_is_kept_in_the_middle_while_flying_past() -> None:
    scene = Scene(forward=3.0)
    located = scene.run()
    off_axis = [abs(s.pixel[0] - 320.0) for s in located.flight.sightings]
    assert max(off_axis) < 80.0


def test_the_sightings_are_reported_before_the_answer_and_are_its_own() -> None:
    scene = Scene()
    located = scene.run()
    assert scene.notes.flights == [located.flight]
    assert scene.notes.answers == [located]


def test_the_closed_forms_stand_beside_the_answer_for_comparison() -> None:
    assert {estimate.method for estimate in Scene().run().comparisons} >= {"stereo", "four-image"}


def test_an_abort_before_control_is_taken_leaves_the_aircraft_alone() -> None:
    scene = Scene()
    scene.abort_in = Stage.DETECT
    with pytest.raises(FlightEnded, match="abort"):
        scene.run()
    assert scene.drone.calls == ["begin"]


@pytest.mark.parametrize("stage", [Stage.HOVER, Stage.CENTRE, Stage.SIDESTEP])
def test_an_abort_in_any_stage_ends_in_hold_without_an_answer(stage: Stage) -> None:
    scene = Scene()
    scene.abort_in = stage
    with pytest.raises(FlightEnded, match="abort"):
        scene.run()
    assert scene.drone.calls[-1] == "hold"
    assert not scene.notes.answers


def test_an_abort_in_the_pattern_keeps_the_sightings() -> None:
    scene = Scene()
    scene.abort_in = Stage.SIDESTEP
    with pytest.raises(FlightEnded):
        scene.run()
    assert len(scene.notes.flights) == 1


@pytest.mark.parametrize("kind", ["pilot", "failsafe", "deadman", "pilot-process-lost"])
def test_whoever_takes_the_aircraft_keeps_it(kind: str) -> None:
    scene = Scene()
    fly = scene.drone.fly

    def seized(path: Path) -> FakeOrder:
        scene.drone.seize(kind, "somebody took the aircraft")
        return fly(path)

    scene.drone.fly = seized  # type: ignore[method-assign]
    with pytest.raises(FlightEnded, match="somebody took the aircraft"):
        scene.run()
    assert scene.drone.calls[-1] == "path", "nothing may be ordered after the pilot took over"


def test_a_gimbal_that_tells_nothing_any_more_ends_the_flight_in_hold() -> None:
    scene = Scene()
    fly = scene.drone.fly

    def silent(path: Path) -> FakeOrder:
        scene.drone.seize("gimbal-lost", "the gimbal has told no attitude for 1 s")
        return fly(path)

    scene.drone.fly = silent  # type: ignore[method-assign]
    with pytest.raises(FlightEnded, match="told no attitude"):
        scene.run()
    assert scene.drone.calls[-1] == "hold"


@pytest.mark.parametrize("kind", ["pilot", "failsafe", "deadman", "pilot-process-lost"])
def test_what_was_seen_is_answered_though_the_aircraft_is_taken_while_estimating(kind: str) -> None:
    scene = Scene()
    tell = scene.notes.stage

    def taken(stage: Stage, text: str) -> None:
        tell(stage, text)
        if stage is Stage.ESTIMATE:
            scene.drone.seize(kind, "somebody took the aircraft")

    scene.notes.stage = taken  # type: ignore[method-assign]
    located = scene.run()
    assert located.ended == "somebody took the aircraft"
    assert [answer.ended for answer in scene.notes.answers] == ["somebody took the aircraft"]
    assert scene.drone.calls[-1] == "path", "nothing may be ordered after the pilot took over"


def test_an_abort_while_estimating_is_an_end_at_once() -> None:
    scene = Scene()
    scene.abort_in = Stage.ESTIMATE
    with pytest.raises(FlightEnded, match="abort"):
        scene.run()
    assert scene.drone.calls[-1] == "hold"
    assert not scene.notes.answers


def test_an_abort_while_reporting_holds_at_once_and_the_end_waits_for_what_is_being_stored() -> None:
    scene = Scene()
    holds_before: list[bool] = []

    def keep(located: LocateResult) -> None:
        scene.abort_in = Stage.REPORT  # ordered while the answer is being stored
        deadline = time.monotonic() + 20.0
        while "hold" not in scene.drone.calls and time.monotonic() < deadline:
            threading.Event().wait(0.001)
        holds_before.append("hold" in scene.drone.calls)
        scene.notes.kept.append("stored")

    scene.notes.keep = keep  # type: ignore[method-assign]
    with pytest.raises(Aborted):
        scene.run()
    assert len(scene.notes.answers) == 1
    assert holds_before == [True]
    assert scene.notes.kept == ["stored"], "the end was told before the work had ended"


def test_an_answer_is_told_in_the_flights_own_loop_and_stored_in_another() -> None:
    scene = Scene()
    told: list[threading.Thread] = []
    scene.notes.located = lambda *_: told.append(threading.current_thread())  # type: ignore[method-assign]
    scene.notes.keep = lambda *_: told.append(threading.current_thread())  # type: ignore[method-assign]
    scene.run()
    loop, other = told
    assert loop is threading.current_thread()
    assert other is not loop


def test_a_refused_order_flies_nothing_and_gives_the_reason() -> None:
    scene = Scene()
    scene.drone.refuse = "battery at 12 %"
    with pytest.raises(FlightRefused, match="battery at 12 %"):
        scene.run()
    assert "path" not in scene.drone.calls


def test_nobody_in_view_is_said_and_control_is_not_taken() -> None:
    scene = Scene()
    scene.sight.absent = True
    with pytest.raises(DetectionError, match="no person"):
        scene.run()
    assert scene.drone.calls == ["begin"]


def test_a_box_with_nobody_in_it_leaves_the_aircraft_to_whoever_flies_it() -> None:
    scene = Scene()
    scene.choice = TargetChoice(box=Box(10.0, 10.0, 40.0, 40.0))
    with pytest.raises(DetectionError, match="inside the box"):
        scene.run()
    assert scene.drone.calls == ["begin"]


def test_a_pilot_who_acts_while_people_are_looked_for_keeps_the_aircraft() -> None:
    scene = Scene()
    scene.drone.seize()
    with pytest.raises(FlightEnded, match="LOITER"):
        scene.run()
    assert scene.drone.calls == ["begin"]


def test_an_aircraft_that_cannot_be_flown_is_said_before_people_are_looked_for() -> None:
    scene = Scene()
    scene.drone.connected = False
    with pytest.raises(FlightRefused, match="not heard"):
        scene.run()
    assert scene.drone.calls == []
    assert scene.notes.stages == []


def test_the_target_is_followed_while_control_is_taken() -> None:
    scene = Scene()
    scene.run()
    assert scene.notes.tracked_in[Stage.HOVER] > 0


def test_a_target_that_is_lost_while_control_is_taken_ends_in_hold() -> None:
    scene = Scene()
    scene.sight.gone_from_s = scene.drone.t_s
    with pytest.raises(DetectionError, match="while control was taken"):
        scene.run()
    assert scene.drone.calls == ["begin", "hover", "hold"]


def test_video_that_stops_in_the_pattern_holds_and_keeps_the_sightings() -> None:
    scene = Scene()
    scene.video.stop_at_s = scene.drone.t_s + 4.0
    with pytest.raises(VideoError, match="no picture"):
        scene.run()
    assert scene.drone.calls[-1] == "hold"
    assert len(scene.notes.flights) == 1


def test_a_link_that_goes_silent_is_an_error_of_the_link() -> None:
    scene = Scene()
    scene.drone.seize("link-lost", "no heartbeat for 5 s")
    with pytest.raises(LinkError, match="no heartbeat"):
        scene.run()


def test_a_person_who_leaves_at_once_gives_a_reason_instead_of_a_position() -> None:
    scene = Scene()
    fly = scene.drone.fly

    def and_leave(path: Path) -> FakeOrder:
        scene.sight.gone_from_s = scene.drone.t_s + 0.12
        return fly(path)

    scene.drone.fly = and_leave  # type: ignore[method-assign]
    with pytest.raises(EstimateRefused):
        scene.run()
    assert not scene.notes.answers
    assert scene.drone.calls[-1] == "hold"


@pytest.mark.parametrize(("loss", "named"), [(0.42, True), (0.02, False), (None, False)])
def test_a_link_that_loses_much_is_named_beside_the_lost_target(loss: float | None, named: bool) -> None:
    scene = Scene()
    scene.drone.packet_loss = loss
    scene.sight.gone_from_s = scene.drone.t_s
    with pytest.raises(DetectionError) as raised:
        scene.run()
    assert ("the link loses 42 % of the packets" in raised.value.cause) is named
    assert ("A better link may help" in raised.value.remedy) is named


def test_without_a_global_position_the_answer_is_local() -> None:
    scene = Scene()
    scene.drone.origin = None
    assert not scene.run().geodetic


def test_a_target_behind_the_shoulder_is_turned_to() -> None:
    scene = Scene(forward=5.0, right=2.7)
    scene.run()
    assert abs(math.degrees(scene.drone.heading) - 28.4) < 3.0


def test_a_repeated_sidestep_follows_the_target_and_answers_each_time() -> None:
    scene = Scene(velocity=(0.0, 0.6))
    scene.settings = scene.settings.model_copy(update={"repeat": 2})
    located = scene.run()
    assert [answer.flight.id for answer in scene.notes.answers] == ["test-1", "test-2"]
    assert scene.drone.calls == ["begin", "hover", "path", "path", "path", "hold"]
    truth = scene.walker.at(located.estimate.t_s)
    assert np.linalg.norm(located.estimate.position_enu_m[:2] - truth[:2]) < 0.15
    assert located.estimate.depth_m == pytest.approx(scene.notes.answers[0].estimate.depth_m, abs=1.5)


def test_a_second_sidestep_says_which_one_it_continues() -> None:
    scene = Scene(velocity=(0.0, 0.6))
    scene.settings = scene.settings.model_copy(update={"repeat": 2})
    scene.run()
    assert [flight.continues for flight in scene.notes.flights] == [None, "test-1"]


def test_what_the_autopilot_would_do_is_said_before_the_flight() -> None:
    scene = Scene()
    scene.drone.seize("caution", "should the pilot process die, PX4 lands")
    scene.run()
    assert "should the pilot process die, PX4 lands" in scene.notes.texts


@dataclass
class Owned(FakeDrone):
    """Remembers which threads spoke to it."""

    spoken_in: set[int] = field(default_factory=set)

    def telemetry(self) -> Telemetry:
        self.spoken_in.add(threading.get_ident())
        return super().telemetry()

    def pose_at(self, t_s: float) -> Pose | None:
        self.spoken_in.add(threading.get_ident())
        return super().pose_at(t_s)

    def noise(self) -> NoiseModel:
        self.spoken_in.add(threading.get_ident())
        return super().noise()

    def events(self) -> list[DroneEvent]:
        self.spoken_in.add(threading.get_ident())
        return super().events()

    def poses(self) -> PoseAt:
        self.spoken_in.add(threading.get_ident())
        known = {pose.t_s: pose for pose in self._poses}
        return lambda t_s: next((pose for at_s, pose in known.items() if abs(at_s - t_s) < 1e-6), None)


class OutsideTheProgram(Sight):
    """Stands for detector and tracker, and knows the truth of the aircraft without speaking to it."""

    def _seen(self, t_s: float) -> tuple[Box, tuple[float, float]] | None:
        before = self.drone
        self.drone = FakeDrone(t_s=self.drone.t_s)
        self.drone._poses = before._poses
        try:
            return super()._seen(t_s)
        finally:
            self.drone = before


@pytest.mark.parametrize("check_offset", [False, True])
def test_only_the_flights_own_loop_speaks_to_the_aircraft(check_offset: bool) -> None:
    scene = Scene()
    scene.drone = Owned()
    scene.video.drone = scene.drone
    scene.settings = MissionSettings.model_validate({"video": {"check_offset": check_offset}})
    scene.sight = OutsideTheProgram(scene.drone, scene.walker)
    scene.run()
    assert scene.drone.spoken_in == {threading.get_ident()}
