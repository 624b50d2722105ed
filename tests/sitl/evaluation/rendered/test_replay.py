"""The mission's eyes on a rendered flight."""

from __future__ import annotations

import pytest

from mission.errors import DetectionError
from mission.records import Box, Detection, Frame, Image
from mission.settings import PatternSettings
from mission.track import Track, TrackState
from sitl.evaluation.rendered import Case, Moment, RenderedFlight
from sitl.evaluation.rendered.replay import replay

SHORT = PatternSettings(length_m=1.0, leg_duration_s=0.8)


class OneBox:
    """A detector that always sees somebody in the same place."""

    name = "one box"

    def __init__(self, box: Box | None) -> None:
        self._found = [] if box is None else [Detection(box, 1.0)]

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        return self._found


class Still:
    """A tracker that never moves, and loses the target after so many frames."""

    def __init__(self, frames: int) -> None:
        self._left = frames
        self.box = Box(0.0, 0.0, 1.0, 1.0)

    def start(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> None:
        self.box = box

    def take_back(self, frame: Frame, box: Box, roll_rad: float = 0.0) -> bool:
        return False

    def update(
        self,
        frame: Frame,
        shift_px: tuple[float, float] = (0.0, 0.0),
        roll_rad: float = 0.0,
        passed: tuple[float, float] = (0.0, 0.0),
    ) -> Track:
        self._left -= 1
        state: TrackState = "tracking" if self._left > 0 else "lost"
        pixel = self.box.centre_px
        return Track(frame.index, frame.t_s, state, self.box, pixel, 1.0, self.box.height_px, 0.03, 1.0)


@pytest.fixture(scope="module")
def flight() -> RenderedFlight:
    return RenderedFlight(Case(seed=12, size_px=(320, 240), pattern=SHORT, offset_s=0.17))


def _around(moment: Moment) -> Box:
    assert moment.target is not None
    x, y = moment.target.pixel
    return Box(x - 60.0, y - 80.0, 120.0, 160.0)


def test_the_turn_tells_the_time_offset_and_the_pattern_is_recorded(flight: RenderedFlight) -> None:
    first = next(iter(flight.moments()))
    looked: list[Moment] = []
    followed = replay(flight, OneBox(_around(first)), Still(1000), looked.append)
    assert followed.offset_s == pytest.approx(0.17, abs=0.01)
    assert len(followed.tracked) == len(followed.record.seen) == len(looked) == 20 * 1.6 + 1
    assert followed.share == 1.0
    assert followed.tracked[0].capture_s == pytest.approx(0.0)
    assert followed.track_ms > 0.0
    assert followed.render_ms > 0.0


def test_a_lost_target_ends_the_record_and_nobody_found_is_an_error(flight: RenderedFlight) -> None:
    first = next(iter(flight.moments()))
    followed = replay(flight, OneBox(_around(first)), Still(60))
    assert followed.tracked[-1].track.state == "lost"
    assert len(followed.tracked) < 20
    with pytest.raises(DetectionError, match="nobody"):
        replay(flight, OneBox(None), Still(1000))
