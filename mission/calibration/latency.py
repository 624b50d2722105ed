"""The video's latency, measured with an aircraft that yaws (`sidestep calibrate latency`)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from mission.camera.camera import Camera
from mission.errors import CalibrationError, FlightEnded, FlightRefused, VideoError
from mission.sighting import level_mounting
from mission.timing.time_offset import TimeOffset, TimeOffsetMeter
from mission.vehicle.drone import Bounds, Drone, Order, OrderState
from mission.video import VideoSource

_POLL_S = 0.5
_SETTLED_S = 0.006
"""Good enough to stop early."""
_MIN_WATCH_S = 4.0
_MAX_SILENCE_S = 2.0
_LAG_S = 0.7
_POSE_AGE_S = 0.2
"""A pose this old is in the buffer on both of its sides."""
"""Telemetry must reach this far beyond a frame before every offset can be tried."""
_ORDER_S = 20.0


@dataclass(frozen=True, slots=True)
class Wiggle:
    """A yaw to and fro around the heading that the aircraft has."""

    amplitude_rad: float = math.radians(20.0)
    turns: int = 4


def measure_latency(
    drone: Drone,
    video: VideoSource,
    camera: Camera,
    *,
    duration_s: float = 20.0,
    wiggle: Wiggle | None = None,
    clock: Callable[[], float] = time.monotonic,
    progress: Callable[[str], None] = lambda _: None,
) -> TimeOffset:
    """Watch the aircraft yaw, by the operator's hand or by our order, until the offset is known.

    Args:
        drone: connected; in the air when `wiggle` is given.
        video: opened with ``latency_s`` = the camera's.
        camera: lens and mounting.
        duration_s: longest time without a wiggle.
        wiggle: yaw by ourselves.
        clock: the program's.
        progress: told what goes on.

    Raises:
        CalibrationError: the movement did not tell; the message says why.
        VideoError: the video stopped.
        FlightRefused: a wiggle was asked for on the ground.
        FlightEnded: the pilot or a failsafe ended the wiggle.
    """
    pose = None if camera.gimbal == "none" else drone.pose_at(clock() - _POSE_AGE_S)
    mounting = level_mounting(pose, camera)
    watch = _Watch(drone, video, TimeOffsetMeter(camera, mounting=mounting), clock)
    if wiggle is None:
        progress("Yaw the aircraft left and right by 20 degrees or more, briskly, two or three times.")
        return watch.until_known(duration_s)
    telemetry = drone.telemetry()
    if not telemetry.in_air or telemetry.heading_rad is None:
        raise FlightRefused("The aircraft is not in the air", "Take off and hover first, or yaw it by hand.")
    middle = telemetry.heading_rad
    drone.begin(Bounds(max_duration_s=_ORDER_S * (wiggle.turns + 2)))
    try:
        watch.until_done(drone.hover())
        for turn in range(wiggle.turns):
            progress(f"Turn {turn + 1} of {wiggle.turns}")
            side = 1.0 if turn % 2 == 0 else -1.0
            watch.until_done(drone.turn_to((middle + side * wiggle.amplitude_rad) % (2.0 * math.pi)))
        watch.until_done(drone.turn_to(middle))
    finally:
        drone.hold()
    return watch.until_known(_LAG_S)


class _Watch:
    """Feeds the meter while something else goes on."""

    def __init__(self, drone: Drone, video: VideoSource, meter: TimeOffsetMeter, clock: Callable[[], float]) -> None:
        self._drone, self._video, self._meter, self._clock = drone, video, meter, clock
        self._index = -1
        self._seen_s = clock()

    def until_done(self, order: Order) -> None:
        end_s = self._clock() + _ORDER_S
        while order.state in (OrderState.PENDING, OrderState.FLYING) and self._clock() < end_s:
            self._take()
        if order.state is not OrderState.DONE:
            raise FlightEnded(f"The {order.kind} did not end well: {order.reason or order.state.value}")

    def until_known(self, duration_s: float) -> TimeOffset:
        began_s = self._clock()
        asked_s = began_s
        while self._clock() - began_s < duration_s:
            self._take()
            now = self._clock()
            if now - asked_s < _POLL_S or now - began_s < _MIN_WATCH_S:
                continue
            asked_s = now
            found = self._meter.measure(self._drone.pose_at)
            if found is not None and found.sigma_s < _SETTLED_S:
                return found
        found = self._meter.measure(self._drone.pose_at)
        if found is None:
            raise CalibrationError(self._meter.reason, "Yaw by 20 degrees or more, briskly, two or three times.")
        return found

    def _take(self) -> None:
        self._drone.keep_alive()  # a sign of life: an aircraft whose program falls silent is stopped
        frame = self._video.latest(self._index, 0.05)
        now = self._clock()
        if frame is not None:
            self._index, self._seen_s = frame.index, now
            self._meter.add(frame)
        elif now - self._seen_s > _MAX_SILENCE_S:
            raise VideoError(
                f"The video stopped: {self._video.stats().error or 'no frames'}", "Check the camera and its connection."
            )
