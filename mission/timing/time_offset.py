"""The offset between video time and telemetry time, from a movement that both have seen.

The background of the picture shows how far the camera turned between two frames; the attitude reports say the same with
their own time stamps. The shift that makes both agree best is the offset, the same for heading, roll and pitch, each
with noise of its own. It needs a turn that starts, stops or changes its rate: a steady one is the same at every shift.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mission.camera.camera import Camera
from mission.camera.mounting import Mounting
from mission.pose.buffer import Pose
from mission.records import Frame, Vector
from mission.timing.background_rotation import BackgroundRotation, Turn
from mission.timing.rate_match import RateMatch, best_offset
from mission.timing.reported_rotation import ReportedRotation

_MAX_GAP_S = 0.25
_MIN_PAIRS = 12
_MOST_PAIRS = 240
"""Newest ones that are compared: a pattern and what comes before it. The time that it takes grows with their cube."""
_MIN_TURN_RAD = math.radians(3.0)
_MIN_UNSTEADY_RAD = math.radians(1.5)
_MIN_CORRELATION = 0.8
_GAIN = (0.6, 1.6)
_MAX_SIGMA_S = 0.03
_SETTLED_S = 0.010
_FLOOR_SIGMA_S = 0.001
_EDGE_S = 0.01
_YAW, _ROLL, _PITCH = 2, 0, 1
"""Rows of body_from_camera: about which of the body's axes (down, forward, right) a camera turned."""


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """By how much the video's times are late against the telemetry's."""

    offset_s: float
    """A frame of time t shows the pose at t - offset_s; to be added to the camera's `latency_s`."""
    sigma_s: float
    turned_rad: float
    """How far the aircraft turned to and fro while this was measured."""
    gain: float
    """Turn seen in the picture over turn reported; 1 with the right focal length."""

    @property
    def settled(self) -> bool:
        """Whether it is known well enough to look for no better one."""
        return self.sigma_s <= _SETTLED_S


@dataclass(frozen=True, slots=True, eq=False)
class _Pair:
    from_s: float
    to_s: float
    rotation_vector: Vector
    shutter_s: Vector
    """(3,): when, after the frames' times, each component was exposed."""


class TimeOffsetMeter:
    """Collects the picture's rotation while the aircraft flies, and compares it with the telemetry when asked.

    Args:
        camera: the lens, the mounting and the rolling shutter.
        span_s: how much of the past is kept.
        search_s: the smallest and the largest offset looked for.
        mounting: how the camera sits on a level aircraft where that is not the camera's own, as on a gimbal.
    """

    def __init__(
        self,
        camera: Camera,
        span_s: float = 30.0,
        search_s: tuple[float, float] = (-0.2, 0.6),
        mounting: Mounting | None = None,
    ) -> None:
        self._camera = camera
        self._mounting = camera.mounting if mounting is None else mounting
        self._background = BackgroundRotation(camera.intrinsics, self._mounting)
        self._span_s = span_s
        self._search_s = search_s
        self._pairs: deque[_Pair] = deque()
        self._last_s: float | None = None
        self.reason = "No frame was seen yet"
        """Why the last `measure` gave nothing; empty when it did."""

    def add(self, frame: Frame) -> Turn | None:
        """Take in the next frame; about 3 ms at 640 x 480.

        Returns:
            How the camera turned since the last frame, None where the picture does not tell.
        """
        if self._last_s is not None and not 0.0 < frame.t_s - self._last_s <= _MAX_GAP_S:
            self._background.restart()
        turn = self._background.measure(frame.image)
        if turn is not None and self._last_s is not None:
            self.add_turn(self._last_s, frame.t_s, turn)
        self._last_s = frame.t_s
        while self._pairs and frame.t_s - self._pairs[0].from_s > self._span_s:
            self._pairs.popleft()
        return turn

    def add_turn(self, from_s: float, to_s: float, turn: Turn) -> None:
        """Take in how the camera turned between two frames, where that was measured elsewhere."""
        shutter_s = np.array([self._camera.row_time_s(0.0, float(row)) for row in turn.row_px])
        self._pairs.append(_Pair(from_s, to_s, turn.rotation_vector, shutter_s))

    def measure(self, pose_at: Callable[[float], Pose | None]) -> TimeOffset | None:
        """The offset from all that was collected.

        Args:
            pose_at: the aircraft's reported pose at a program time (`Drone.pose_at`).

        Returns:
            None when the movement was too small or too steady to tell, or picture and telemetry do not agree;
            `reason` says which.
        """
        found = self._measure(pose_at)
        if isinstance(found, str):
            self.reason = f"The offset between video and telemetry cannot be told: {found}"
            return None
        self.reason = ""
        return found

    def _measure(self, pose_at: Callable[[float], Pose | None]) -> TimeOffset | str:
        if len(self._pairs) < _MIN_PAIRS:
            return "too few frames with enough background were seen"
        low, high = self._search_s
        pairs = list(self._pairs)[-_MOST_PAIRS:]
        spans = np.array([(pair.from_s, pair.to_s) for pair in pairs])
        seen = np.array([pair.rotation_vector for pair in pairs])
        reported = ReportedRotation.collect(pose_at, self._camera, spans[0, 0] - high, spans[-1, 1] - low)
        known = reported.known(spans - low) & reported.known(spans - high)
        if np.count_nonzero(known) < _MIN_PAIRS:
            return "too little telemetry covers the frames"
        spans, seen = spans[known], seen[known]
        shutter_s = np.array([pair.shutter_s for pair in pairs])[known]
        body = self._mounting.body_from_camera.as_matrix()

        def match(axis: Vector) -> RateMatch:
            exposed = spans + (shutter_s @ np.square(axis))[:, None]
            return RateMatch(exposed, seen @ axis, lambda shifted: reported.turn(shifted, axis))

        matches = [match(body[row]) for row in (_YAW, _ROLL, _PITCH)]
        rates, offset_s = matches[0], best_offset(matches, low, high)
        turned_rad = rates.turned_rad(offset_s)
        if turned_rad < _MIN_TURN_RAD:
            turned, needed = math.degrees(turned_rad), math.degrees(_MIN_TURN_RAD)
            return f"the aircraft turned by only {turned:.1f} deg; it takes {needed:.0f}"
        if rates.unsteady_rad(offset_s) < _MIN_UNSTEADY_RAD:
            return "the turn was too steady: it must begin, end or change while it is watched"
        agreements = [match.agreement(offset_s) for match in matches]
        gain, correlation = agreements[0].gain, agreements[0].correlation
        told = sum(1.0 / max(axis.sigma_s, _FLOOR_SIGMA_S) ** 2 for axis in agreements)
        sigma_s = math.hypot(1.0 / math.sqrt(told), _FLOOR_SIGMA_S)
        if correlation < _MIN_CORRELATION or not _GAIN[0] < gain < _GAIN[1]:
            return (
                f"the picture does not turn as the telemetry says (correlation {correlation:.2f}, ratio {gain:.2f}): "
                "wrong field of view or mounting, or no still background"
            )
        if min(offset_s - low, high - offset_s) < _EDGE_S:
            return f"the offset is outside of {low:.1f} to {high:.1f} s"
        if sigma_s > _MAX_SIGMA_S:
            return f"the turn was too slow: the offset is uncertain by {sigma_s:.3f} s"
        return TimeOffset(offset_s, sigma_s, turned_rad, gain)
