"""Turning to the target, and measuring the video's time offset on that turn or on a short wiggle after it."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from mission.errors import DetectionError
from mission.procedure.flight_loop import FlightLoop
from mission.procedure.pointing import Pointing
from mission.procedure.regain import Regain
from mission.procedure.result import Stage, Watcher
from mission.records import Frame
from mission.timing.time_offset import TimeOffset, TimeOffsetMeter
from mission.vehicle.drone import Drone

CENTRED_RAD = math.radians(3.0)
NEARLY_CENTRED_RAD = math.radians(12.0)
"""Good enough for measuring the offset; before it is known, the aim lags behind a walking target."""
STEADY_S = 0.4
"""The target is centred when it has been for this long."""
TIMEOUT_S = 12.0
WIGGLES_RAD = (math.radians(12.0), math.radians(18.0))
"""How far to turn; further when the first was too little to tell."""
GIMBAL_WIGGLES_RAD = (math.radians(5.0), math.radians(8.0))
"""Of a gimbal's lens, which is steady: less tells as much, and small people stay where they are looked for."""
WIGGLE_S = 2.2
"""A yaw to one side, to the other and back."""


class Centring:
    """The stage between choosing the target and flying past it.

    Args:
        loop: gives the frames.
        drone: for its poses.
        pointing: follows the target.
        meter: measures the time offset; None when it shall not be measured.
        regain: takes a target back that left the picture.
        watcher: is told.
        clock: the program's clock, seconds.
    """

    def __init__(
        self,
        loop: FlightLoop,
        drone: Drone,
        pointing: Pointing,
        meter: TimeOffsetMeter | None,
        regain: Regain,
        watcher: Watcher,
        clock: Callable[[], float],
    ) -> None:
        self._loop = loop
        self._drone = drone
        self._pointing = pointing
        self._meter = meter
        self._regain = regain
        self._watcher = watcher
        self._clock = clock
        self._offset: TimeOffset | None = None
        self._wiggle_s: float | None = None
        self._wiggles = 0
        self._amounts = GIMBAL_WIGGLES_RAD if pointing.on_gimbal else WIGGLES_RAD

    def run(self) -> TimeOffset | None:
        """Turn until the target is in the middle; the time offset where it could be told.

        Raises:
            DetectionError: the target was lost.
            SidestepError: what ends a flight (`FlightLoop.frames`).
        """
        self._watcher.stage(Stage.CENTRE, "turning to the target")
        centred_since_s: float | None = None
        for frame in self._loop.frames(TIMEOUT_S):
            turn = None if self._meter is None else self._meter.add(frame)
            track = self._pointing.follow(frame, turn)
            self._watcher.frame(frame, track)
            if track.state == "lost":
                self._wiggle_s = centred_since_s = None
                if not self._regain.run(Stage.CENTRE, self._show_meter, steer=True):
                    raise DetectionError("the target was lost while turning to it", "Try again, or choose it by a box.")
                continue
            now = self._clock()
            beside = self._wiggle(now)
            self._pointing.face(now)
            self._pointing.steer(now, beside or 0.0)
            if beside is not None:
                centred_since_s = None
                continue
            wanted = CENTRED_RAD if self._meter is None else NEARLY_CENTRED_RAD
            if abs(self._pointing.off_axis_rad()) > wanted:
                centred_since_s = None
                continue
            centred_since_s = now if centred_since_s is None else centred_since_s
            if now - centred_since_s < STEADY_S:
                continue
            if self._meter is None:
                return self._offset
            centred_since_s = None
            if self._measured():
                continue
            if self._wiggles == len(self._amounts):
                self._give_up()
                continue
            self._watcher.stage(Stage.CENTRE, "a short yaw wiggle measures the video's time offset")
            self._wiggle_s = now
            self._wiggles += 1
        self._watcher.stage(Stage.CENTRE, "the target is not quite centred; going on")
        self._give_up()
        return self._offset

    def _show_meter(self, frame: Frame) -> None:
        if self._meter is not None:
            self._meter.add(frame)

    def _wiggle(self, now_s: float) -> float | None:
        """How far to point beside the target; None when no wiggle is flown."""
        if self._wiggle_s is None:
            return None
        phase = (now_s - self._wiggle_s) / WIGGLE_S
        if phase < 1.0:
            return self._amounts[self._wiggles - 1] * math.sin(2.0 * math.pi * phase)
        self._wiggle_s = None
        self._measured()
        return None

    def _measured(self, *, last: bool = False) -> bool:
        """Take the offset if it can be told well enough by now; if at all where nothing more is flown for it."""
        if self._meter is None:
            return False
        offset = self._loop.meanwhile(partial(self._meter.measure, self._drone.poses()))
        if offset is None or not (offset.settled or last):
            return False
        self._offset, self._meter = offset, None
        self._pointing.trust(offset.offset_s)
        self._watcher.stage(
            Stage.CENTRE, f"video runs {1e3 * offset.offset_s:.0f} ms behind telemetry (+-{1e3 * offset.sigma_s:.0f})"
        )
        return True

    def _give_up(self) -> None:
        """Take the offset or say why it cannot be told; either way go on with what there is."""
        if self._meter is None or self._measured(last=True):
            return
        self._watcher.stage(Stage.CENTRE, f"{self._meter.reason}; the pattern may tell")
        self._meter = None
        self._pointing.trust(0.0)
