"""Taking back a target that left the picture: turn to where it should be, and look whether it is there again."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from mission.detect import Detector
from mission.errors import DetectionError
from mission.procedure.flight_loop import FlightLoop
from mission.procedure.pointing import Pointing, TargetTracker
from mission.procedure.result import Stage, Watcher
from mission.records import Frame

PATIENCE_S: Final = 4.0
"""Longer, and whoever walks is somewhere else; a tracker has coasted before."""
TIMES: Final = 2
"""So often in one flight: a target that is lost again and again does not stay in the picture."""


class Regain:
    """Takes the target back after the tracker has lost it.

    Args:
        loop: gives the frames.
        detector: finds people.
        tracker: of the target.
        pointing: knows where the target should be.
        watcher: is told.
        clock: the program's clock, seconds.
    """

    def __init__(
        self,
        loop: FlightLoop,
        detector: Detector,
        tracker: TargetTracker,
        pointing: Pointing,
        watcher: Watcher,
        clock: Callable[[], float],
    ) -> None:
        self._loop = loop
        self._detector = detector
        self._tracker = tracker
        self._pointing = pointing
        self._watcher = watcher
        self._clock = clock
        self._left = TIMES

    def run(self, stage: Stage, shown: Callable[[Frame], object], *, steer: bool) -> bool:
        """Whether the target is followed again: the one person near where it should be, with the target's looks.

        Args:
            stage: of the procedure, for the watcher.
            shown: is called with every frame.
            steer: whether the aircraft may be turned to where the target should be.

        Raises:
            SidestepError: what ends a flight (`FlightLoop.frames`).
        """
        if self._left == 0:
            return False
        self._left -= 1
        self._watcher.stage(stage, "the target left the picture; looking for it where it should be")
        for frame in self._loop.frames(PATIENCE_S):
            shown(frame)
            self._pointing.pass_over(frame)
            self._watcher.frame(frame, None)
            if steer:
                self._pointing.steer(self._clock())
            found = self._loop.meanwhile(partial(self._detector.detect, frame.image))
            near = [person.box for person in found if self._pointing.expects(person.box)]
            if len(near) != 1:
                continue
            try:
                back = self._loop.meanwhile(partial(self._tracker.take_back, frame, near[0], self._pointing.roll_rad))
            except DetectionError:
                continue  # the detector took something else for a person
            if back:
                self._pointing.resume(near[0])
                self._watcher.stage(stage, "the target is in the picture again")
                return True
        return False
