"""The orders that a ground station can give, as read from a command's parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import all as mavlink

from mission.procedure.result import TargetChoice
from mission.records import Box

LEAST_SIDE: Final = 0.004
"""A box thinner than this part of the picture is a slip of the hand."""


@dataclass(frozen=True, slots=True)
class Mark:
    """What the operator marked on the picture: fractions of its width and height, from the top left corner."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def is_point(self) -> bool:
        """Whether it is a click rather than a box."""
        return self.right == self.left and self.bottom == self.top

    def choice(self, width_px: int, height_px: int) -> TargetChoice:
        """The same in pixels of a picture."""
        left, top = self.left * width_px, self.top * height_px
        if self.is_point:
            return TargetChoice(point=(left, top))
        return TargetChoice(Box(left, top, self.right * width_px - left, self.bottom * height_px - top))


@dataclass(frozen=True, slots=True)
class LocateOrder:
    """Fly and locate: the marked target, else the one that is tracked, else the one nearest the middle."""

    mark: Mark | None = None


@dataclass(frozen=True, slots=True)
class Follow:
    """Track the marked target in the picture; nothing flies."""

    mark: Mark


@dataclass(frozen=True, slots=True)
class NextCandidate:
    """Track the next person in view; nothing flies."""


@dataclass(frozen=True, slots=True)
class HandToAutopilot:
    """Give the last answer to the autopilot: as region of interest, as waypoint."""

    roi: bool
    waypoint: bool


Order = LocateOrder | Follow | NextCandidate | HandToAutopilot

ORDER_COMMANDS: Final = (
    mavlink.MAV_CMD_USER_1,
    mavlink.MAV_CMD_USER_3,
    mavlink.MAV_CMD_USER_4,
    mavlink.MAV_CMD_CAMERA_TRACK_POINT,
    mavlink.MAV_CMD_CAMERA_TRACK_RECTANGLE,
)
MARK_COMMANDS: Final = (mavlink.MAV_CMD_CAMERA_TRACK_POINT, mavlink.MAV_CMD_CAMERA_TRACK_RECTANGLE)
"""Of the camera protocol: any camera may be meant."""
STOP_COMMANDS: Final = (mavlink.MAV_CMD_USER_2, mavlink.MAV_CMD_CAMERA_STOP_TRACKING)


def order_of(command: int, params: Sequence[float], *, box_locates: bool) -> Order | None:
    """The order that one of `ORDER_COMMANDS` gives; None when its parameters give none.

    Args:
        command: MAV_CMD.
        params: the first four parameters, any float.
        box_locates: whether a box or a point starts a flight.
    """
    if command == mavlink.MAV_CMD_USER_3:
        return NextCandidate()
    if command == mavlink.MAV_CMD_USER_4:
        return _hand_to_autopilot(params[0])
    if command == mavlink.MAV_CMD_CAMERA_TRACK_POINT:
        mark = point(*params[:2])
    elif command == mavlink.MAV_CMD_CAMERA_TRACK_RECTANGLE:
        mark = rectangle(*params[:4])
    else:
        left, top, right, bottom = (0.0 if math.isnan(p) else p for p in params[:4])
        if (left, top, right, bottom) == (0.0, 0.0, 0.0, 0.0):
            return LocateOrder()
        mark = point(left, top) if (right, bottom) == (0.0, 0.0) else rectangle(left, top, right, bottom)
        return None if mark is None else LocateOrder(mark)
    if mark is None:
        return None
    return LocateOrder(mark) if box_locates else Follow(mark)


def point(x: float, y: float) -> Mark | None:
    """A click; None outside the picture."""
    return Mark(x, y, x, y) if 0.0 <= x <= 1.0 and 0.0 <= y <= 1.0 else None


def rectangle(left: float, top: float, right: float, bottom: float) -> Mark | None:
    """A box; corners in any order, cut to the picture; None when nothing is left of it."""
    if not all(math.isfinite(value) for value in (left, top, right, bottom)):
        return None
    x0, x1 = sorted(min(max(x, 0.0), 1.0) for x in (left, right))
    y0, y1 = sorted(min(max(y, 0.0), 1.0) for y in (top, bottom))
    return Mark(x0, y0, x1, y1) if x1 - x0 >= LEAST_SIDE and y1 - y0 >= LEAST_SIDE else None


def _hand_to_autopilot(what: float) -> HandToAutopilot | None:
    """0 both, 1 the region of interest, 2 the waypoint."""
    if math.isnan(what):
        what = 0.0
    return HandToAutopilot(roi=what != 2.0, waypoint=what != 1.0) if what in (0.0, 1.0, 2.0) else None
