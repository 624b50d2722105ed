"""Tracking a person in the picture without flying: what the operator sees before the order to locate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final, Protocol

from gcs_plugin.component.tracking import TrackedBox
from mission.detect import Confirmation, Detector
from mission.errors import DetectionError, VideoError
from mission.procedure.flight_loop import FRAME_WAIT_S, VIDEO_LOST_S
from mission.records import Box, Detection, Frame
from mission.track import Track
from mission.video import VideoSource

Choose = Callable[[Sequence[Detection]], Detection]
"""Picks one of the people that were found."""


class Follower(Protocol):
    """Follows the target from frame to frame (`mission.procedure.pointing.Pointing`)."""

    def follow(self, frame: Frame) -> Track:
        """Where it is in the next frame."""
        ...


class Following:
    """Finds the chosen person and follows it until told to stop.

    Args:
        video: the camera's pictures.
        detector: finds people.
        start: starts the tracker on a box of a frame.
        follower: follows from there.
        stopped: answers True when it should end.
        meanwhile: does something long while the link is looked at.
        clock: the program's clock, seconds.
        serve: called in every turn: looks at the link.
    """

    def __init__(
        self,
        video: VideoSource,
        detector: Detector,
        start: Callable[[Frame, Box], None],
        follower: Follower,
        stopped: Callable[[], bool],
        meanwhile: Callable[[Callable[[], list[Detection]]], list[Detection]],
        clock: Callable[[], float],
        serve: Callable[[], None] = lambda: None,
    ) -> None:
        self._video = video
        self._detector = detector
        self._start = start
        self._follower = follower
        self._stopped = stopped
        self._meanwhile = meanwhile
        self._clock = clock
        self._serve = serve

    def run(self, choose: Choose, timeout_s: float, show: Callable[[TrackedBox, Frame], None]) -> None:
        """Track until stopped.

        Args:
            choose: which person.
            timeout_s: how long to look for people.
            show: is told where the target is, and in which frame.

        Raises:
            DetectionError: nobody is seen, or not where it was marked, or the target was lost.
            VideoError: the video stopped.
        """
        frames = self._frames()
        if not self._acquire(frames, choose, timeout_s):
            return
        for frame in frames:
            track = self._follower.follow(frame)
            height, width = frame.image.shape[:2]
            show(TrackedBox(track, width, height), frame)
            if track.state == "lost":
                raise DetectionError("the target was lost", "Mark it again.")

    def _acquire(self, frames: Iterator[Frame], choose: Choose, timeout_s: float) -> bool:
        """Whether somebody is tracked now; somebody who is seen in two looks running."""
        confirmation = Confirmation()
        started_s = self._clock()
        for frame in frames:
            found = self._meanwhile(partial(self._detector.detect, frame.image))
            steady = confirmation.confirmed(found)
            if steady:
                self._start(frame, choose(steady).box)
                return True
            if self._clock() - started_s > timeout_s:
                raise DetectionError(f"no person found in {timeout_s:.0f} s", "Turn the camera towards the person.")
        return False

    def _frames(self) -> Iterator[Frame]:
        """New frames until stopped."""
        last_index, last_s = -1, self._clock()
        while True:
            self._serve()
            if self._stopped():
                return
            frame = self._video.latest(last_index, FRAME_WAIT_S)
            if frame is not None:
                last_index, last_s = frame.index, self._clock()
                yield frame
            elif self._clock() - last_s > VIDEO_LOST_S:
                raise VideoError(f"no picture for {VIDEO_LOST_S:.0f} s", "Check the camera and the video link.")


BESIDE: Final = 0.5
"""A candidate is another person when its middle is this part of a body's width away."""


def next_candidate(people: Sequence[Detection], after: Box | None) -> Detection:
    """The next person to the right of a box, the leftmost one after the last.

    Args:
        people: one at least.
        after: the present target's box; None starts with the leftmost.
    """
    ordered = sorted(people, key=lambda d: d.box.centre_px[0])
    if after is None:
        return ordered[0]
    beyond = after.centre_px[0] + BESIDE * after.width_px
    return next((d for d in ordered if d.box.centre_px[0] > beyond), ordered[0])
