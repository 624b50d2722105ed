"""A flight's procedure run again from its tape: the same code, the same answers of aircraft and camera, no flight."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import cv2
import numpy as np

from mission.errors import FlightEnded, VideoError
from mission.observation.file_video import FileVideo
from mission.observation.tape import OrderTape, Tape, picture_check
from mission.pose.buffer import Pose, PoseAt
from mission.records import Frame, GeodeticOrigin, NoiseModel
from mission.vehicle.drone import Bounds, CameraPointer, Capabilities, DroneEvent, OrderState, Path, Telemetry
from mission.video import VideoState, VideoStats

_SHIFTS = 8
"""Pictures that a decoder may have held back when the recording began."""
_NEAR_S = 0.25


class ReplayedVideo:
    """A `VideoSource` that gives the pictures of a tape, in their order and with their times, at any speed.

    Args:
        path: the recorded video.
        tape: of the flight.
        size_px: width and height of the pictures that the procedure was given.

    Raises:
        VideoError: the recording does not hold the flight's pictures.
    """

    def __init__(self, path: FilePath, tape: Tape, size_px: tuple[int, int]) -> None:
        if tape.video_first_index is None:
            raise VideoError(f"no video was kept of this flight: {tape.video_note or 'it is missing'}")
        self._tape, self._size = tape, size_px
        self._pictures = self._numbered(FileVideo(path), tape)
        self._held: tuple[int, Frame] | None = None
        self.number = 0
        """Pictures given so far."""
        self.clock_s = tape.begun_clock_s
        self._reads: list[float] = []
        self.over = False
        """Whether more pictures were asked for than there are."""

    def _numbered(self, video: FileVideo, tape: Tape) -> Iterator[tuple[int, Frame]]:
        """The recording's pictures with the numbers that they had in flight."""
        assert tape.video_first_index is not None
        wanted = tape.given[0].index if tape.given else 0
        shift: int | None = None
        for place, picture in enumerate(video.pictures()):
            number = tape.video_first_index + place
            if shift is not None:
                yield number + shift, self._sized(picture.frame())
            elif number >= wanted - _SHIFTS:
                frame = self._sized(picture.frame())
                if picture_check(frame) == tape.check:
                    shift = wanted - number
                    yield wanted, frame
                elif number > wanted + _SHIFTS:
                    break
        if shift is None and tape.given:
            raise VideoError(
                "the recorded pictures are not those of the flight",
                "They were decoded by another version of FFmpeg, or the recording is damaged.",
            )

    def _sized(self, frame: Frame) -> Frame:
        """As the flight's own pictures were: `mission.video.square` scales those with pixels that are not square."""
        height, width = frame.image.shape[:2]
        if (width, height) == self._size:
            return frame
        image = cv2.resize(frame.image, self._size, interpolation=cv2.INTER_LINEAR)
        return replace(frame, image=np.asarray(image, np.uint8))

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        """The next picture of the tape; None after the last one.

        Raises:
            VideoError: the recording ends before the tape.
        """
        if self.number >= len(self._tape.given):
            self.over = True
            return None
        given = self._tape.given[self.number]
        while self._held is None or self._held[0] < given.index:
            self._held = next(self._pictures, None)
            if self._held is None:
                raise VideoError(f"the recording ends after {self.number} of {len(self._tape.given)} pictures")
        self.number += 1
        self.clock_s = given.clock_s
        self._reads = given.read_s[::-1]
        return Frame(self._held[1].image, given.t_s, given.index)

    def clock(self) -> float:
        """What the flight's clock said when it was asked as often as now since this picture."""
        if self._reads:
            self.clock_s = self._reads.pop()
        return self.clock_s

    def stats(self) -> VideoStats:
        """As at the end of the flight."""
        return VideoStats(VideoState.PLAYING, 0.0, self.number, 0, 0, 0, 0.0, 0.0, "", self._tape.video_note, "")

    def close(self) -> None:
        """Nothing."""


@dataclass(slots=True)
class ReplayedOrder:
    """An order that ends when it did."""

    tape: OrderTape
    video: ReplayedVideo

    @property
    def kind(self) -> str:
        """See `Order`."""
        return self.tape.kind

    @property
    def state(self) -> OrderState:
        """See `Order`."""
        ended = 0 <= self.tape.ended_at <= self.video.number
        return OrderState(self.tape.state) if ended else OrderState.FLYING

    @property
    def reason(self) -> str:
        """See `Order`."""
        return self.tape.reason

    @property
    def started_s(self) -> float | None:
        """See `Order`."""
        return self.tape.started_s if 0 <= self.tape.started_at <= self.video.number else None

    @property
    def ended_s(self) -> float | None:
        """See `Order`."""
        return self.tape.ended_s


class ReplayedDrone:
    """A `Drone` that answers what a tape says; it takes every order, and flies what was flown.

    Args:
        tape: of the flight.
        video: of the same tape, which is the time.
    """

    name = "replay"
    capabilities = Capabilities(True, True, 10.0)

    def __init__(self, tape: Tape, video: ReplayedVideo) -> None:
        self._tape, self._video = tape, video
        self._poses = dict(tape.poses)
        self._orders = iter(tape.orders)
        self._known = iter(tape.all_poses)
        self._now = tape.all_poses[-1] if tape.all_poses else None

    @property
    def gimbal(self) -> CameraPointer | None:
        """None: flights with a gimbal have no tape."""
        return None

    @property
    def origin(self) -> GeodeticOrigin | None:
        """See `Drone`."""
        return self._tape.origin

    def connect(self, timeout_s: float) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""

    def keep_alive(self) -> None:
        """Nothing."""

    def telemetry(self) -> Telemetry:
        """As when the order was given."""
        told = self._tape.telemetry
        if told is None:
            return Telemetry(self._video.clock_s, True, True, True, "", None, None, None, True, True, 50.0)
        return replace(told, t_s=self._video.clock_s, connected=True)

    def pose_at(self, t_s: float) -> Pose | None:
        """What was answered when this was asked for in flight; else what was known of it in the end."""
        if t_s in self._poses:
            return self._poses[t_s]
        near = min(self._poses, key=lambda asked: abs(asked - t_s), default=None)
        if near is not None and abs(near - t_s) < _NEAR_S and self._tape.poses[0][0] == near:
            return self._poses[near]  # the first one is asked for by the clock, which a replay does not share
        return None if self._now is None else self._now.history.at(t_s)

    def poses(self) -> PoseAt:
        """As they were known then; where it is asked for more often than in flight, as in the end."""
        self._now = next(self._known, self._tape.all_poses[-1] if self._tape.all_poses else None)
        if self._now is None:
            return lambda _: None
        return self._now.history.at

    def noise(self) -> NoiseModel:
        """See `Drone`."""
        known = self._now.noise if self._now is not None else None
        last = next((one.noise for one in reversed(self._tape.all_poses) if one.noise is not None), None)
        return known or last or NoiseModel()

    def pose_note(self) -> str:
        """See `Drone`."""
        return "" if self._now is None else self._now.note

    def begin(self, bounds: Bounds) -> None:
        """Nothing."""

    def take_off(self, height_m: float) -> ReplayedOrder:
        """See `Drone`."""
        return self._order("take-off")

    def hover(self) -> ReplayedOrder:
        """See `Drone`."""
        return self._order("hover")

    def turn_to(self, heading_rad: float) -> ReplayedOrder:
        """See `Drone`."""
        return self._order("turn")

    def fly(self, path: Path) -> ReplayedOrder:
        """See `Drone`."""
        return self._order("path")

    def aim(self, heading_rad: float) -> None:
        """Nothing."""

    def hold(self) -> ReplayedOrder:
        """It holds at once."""
        return ReplayedOrder(OrderTape("hold", state=OrderState.DONE.value, ended_at=0), self._video)

    def land(self) -> ReplayedOrder:
        """See `Drone`."""
        return self._order("land")

    def events(self) -> list[DroneEvent]:
        """What ended the flight, when its pictures are over."""
        if not self._video.over:
            return []
        return [DroneEvent(self._video.clock_s, "pilot", "the recording is over")]

    def _order(self, kind: str) -> ReplayedOrder:
        """The next order of that kind.

        Raises:
            FlightEnded: in flight there was none: other settings would have flown on.
        """
        for order in self._orders:
            if order.kind == kind:
                return ReplayedOrder(order, self._video)
        raise FlightEnded(f"the recorded flight has no further {kind}", "Other settings would have flown otherwise.")
