"""Tracking in the picture: whom, until when, and what the operator is told when it fails."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import pytest

from gcs_plugin.component.tracking import TrackedBox
from gcs_plugin.serve.follow import Following, next_candidate
from mission.detect import Detector
from mission.errors import DetectionError, VideoError
from mission.records import Box, Detection, Frame
from mission.track import Track
from mission.track.track import TrackState
from tests.support.fakes import BLANK, FakeDrone, FakeVideo

LEFT, MIDDLE, RIGHT = (Detection(Box(x, 100.0, 60.0, 200.0), 1.0) for x in (50.0, 280.0, 500.0))


@dataclass
class People:
    """Finds the same people in every picture."""

    found: Sequence[Detection]
    name: str = "people"

    def detect(self, image: object, region: Box | None = None) -> list[Detection]:
        return list(self.found)


@dataclass
class Tape:
    """A tracker that keeps to its box, and what it was started on."""

    boxes: list[Box] = field(default_factory=list)
    lost_after: int = 10_000
    followed: int = 0

    def start(self, frame: Frame, box: Box) -> None:
        self.boxes.append(box)

    def follow(self, frame: Frame) -> Track:
        self.followed += 1
        state: TrackState = "lost" if self.followed > self.lost_after else "tracking"
        box = self.boxes[-1]
        return Track(frame.index, frame.t_s, state, box, box.centre_px, 1.0, box.height_px, 0.03, 1.0)


def following(
    drone: FakeDrone, detector: Detector, tape: Tape, video: FakeVideo, stopped: Callable[[], bool]
) -> Following:
    return Following(video, detector, tape.start, tape, stopped, lambda work: work(), lambda: drone.t_s)


def run(
    people: Sequence[Detection],
    tape: Tape,
    *,
    choose: Callable[[Sequence[Detection]], Detection] = lambda found: found[0],
    stop_after_s: float = 5.0,
    video_stops_after_s: float = 1e9,
) -> list[TrackedBox]:
    drone = FakeDrone()
    video = FakeVideo(drone, stop_at_s=drone.t_s + video_stops_after_s)
    end_s = drone.t_s + stop_after_s
    shown: list[TrackedBox] = []
    following(drone, People(people), tape, video, lambda: drone.t_s >= end_s).run(
        choose, 3.0, lambda seen, _: shown.append(seen)
    )
    return shown


def test_the_chosen_person_is_tracked_until_stopped() -> None:
    tape = Tape()
    shown = run([LEFT, RIGHT], tape, choose=lambda found: found[1])
    assert tape.boxes == [RIGHT.box]
    assert 90 <= len(shown) <= 100
    assert (shown[0].width_px, shown[0].height_px) == (BLANK.shape[1], BLANK.shape[0])


def test_a_lost_target_is_shown_and_told() -> None:
    with pytest.raises(DetectionError, match="the target was lost"):
        run([LEFT], Tape(lost_after=20))


def test_nobody_in_view_is_told_after_a_while() -> None:
    with pytest.raises(DetectionError, match="no person found in 3 s"):
        run([], Tape(), stop_after_s=10.0)


def test_an_abort_while_looking_ends_it_quietly() -> None:
    tape = Tape()
    assert run([], tape, stop_after_s=1.0) == []
    assert tape.boxes == []


def test_video_that_stops_is_told() -> None:
    with pytest.raises(VideoError, match="no picture for 1 s"):
        run([LEFT], Tape(), video_stops_after_s=1.0)


@pytest.mark.parametrize(
    ("after", "expected"),
    [(None, LEFT), (LEFT.box, MIDDLE), (MIDDLE.box, RIGHT), (RIGHT.box, LEFT), (Box(60.0, 90.0, 60.0, 200.0), MIDDLE)],
)
def test_the_next_candidate_is_the_next_to_the_right_and_round_again(after: Box | None, expected: Detection) -> None:
    assert next_candidate([RIGHT, LEFT, MIDDLE], after) == expected


def test_one_person_alone_is_always_the_next() -> None:
    assert next_candidate([MIDDLE], MIDDLE.box) == MIDDLE
