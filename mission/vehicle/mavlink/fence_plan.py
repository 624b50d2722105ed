"""The polygons and circles of a fence plan, read from the autopilot (MAVLink mission protocol, type fence)."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.link import MavlinkLink

FENCE_PLAN_MESSAGES: Final = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_ACK")
"""Messages that `FencePlan.take` reads."""

_FENCE = mavlink.MAV_MISSION_TYPE_FENCE
_POLYGONS = {
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES = {mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True, mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False}
"""Commands, and whether they mean an area to stay inside of."""
_ASK_AGAIN_S = 0.4
_ATTEMPTS = 8
_MOST_ITEMS = 1000
_CORNERS = 3


@dataclass(frozen=True, slots=True)
class PlannedArea:
    """An area of the plan: corners (latitude, longitude) in degrees, of a circle its centre alone, and its radius."""

    inclusion: bool
    corners_deg: tuple[tuple[float, float], ...]
    radius_m: float = 0.0


class FencePlan:
    """Reads the plan, item by item. `take` is called in the link's thread, the rest in the pilot's loop."""

    def __init__(self) -> None:
        self.areas: tuple[PlannedArea, ...] = ()
        """As read last."""
        self.trouble = ""
        """Why the areas are not known though there are some; empty when they are known."""
        self.silent = False
        """The autopilot answered nothing."""
        self.known = False
        """Whether it was read, or cannot be."""
        self._lock = threading.Lock()
        self._reading, self._due, self._thank = True, True, False
        self._count: int | None = None
        self._items: dict[int, Any] = {}
        self._asked_s, self._attempts = -math.inf, 0

    def refresh(self) -> None:
        """Read it again, as a ground station may have changed it; what was read last holds until then."""
        with self._lock:
            if not self._reading:
                self._start()

    def take(self, message: Any) -> None:
        """Take in a message of the mission protocol; others than of fence plans are passed over."""
        if message.mission_type != _FENCE:
            return
        with self._lock:
            if not self._reading:
                return
            name = message.get_type()
            if name == "MISSION_COUNT":
                self._counted(message.count)
            elif name == "MISSION_ACK":
                self._refused(message.type)
            elif self._count is not None and message.seq < self._count:
                self._items[message.seq] = message
                self._attempts, self._due = 0, True
                if len(self._items) == self._count:
                    self._whole()

    def ask(self, link: MavlinkLink, now_s: float) -> None:
        """Ask for what is not known yet; called at every tick, never waits."""
        with self._lock:
            if self._thank:
                self._thank = False
                link.send(mavlink.MAVLink_mission_ack_message(link.target_system, link.target_component, 0, _FENCE))
            if not self._reading or not (self._due or now_s - self._asked_s >= _ASK_AGAIN_S):
                return
            if self._attempts >= _ATTEMPTS:
                self._give_up()
                return
            self._asked_s, self._due, self._attempts = now_s, False, self._attempts + 1
            to = link.target_system, link.target_component
            if self._count is None:
                link.send(mavlink.MAVLink_mission_request_list_message(*to, _FENCE))
            else:
                missing = next(seq for seq in range(self._count) if seq not in self._items)
                link.send(mavlink.MAVLink_mission_request_int_message(*to, missing, _FENCE))

    def _start(self) -> None:
        self._reading, self._due, self._thank = True, True, False
        self._count, self._items = None, {}
        self._asked_s, self._attempts = -math.inf, 0

    def _give_up(self) -> None:
        if self._count is not None:
            self._end(self.areas, f"{len(self._items)} of the {self._count} items of its plan came")
        else:
            self.silent = self.silent or not self.known
            self._end(self.areas, self.trouble)

    def _counted(self, count: int) -> None:
        if self._count is not None:
            return
        self.silent = False
        if count > _MOST_ITEMS:
            self._end((), f"its plan has {count} items, more than {_MOST_ITEMS}")
        elif count == 0:
            self._end((), "")
        else:
            self._count, self._attempts, self._due = count, 0, True

    def _refused(self, result: int) -> None:
        if result in (mavlink.MAV_MISSION_UNSUPPORTED, mavlink.MAV_MISSION_ACCEPTED) and self._count is None:
            self._end((), "")  # it has none
        elif result != mavlink.MAV_MISSION_ACCEPTED:
            self._count, self._items = (
                None,
                {},
            )  # busy with another station, or the plan was changed: again from the start

    def _whole(self) -> None:
        self._thank = True
        areas = areas_of([self._items[seq] for seq in range(len(self._items))])
        self._end(areas or (), "" if areas is not None else "its plan cannot be understood")

    def _end(self, areas: tuple[PlannedArea, ...], trouble: str) -> None:
        self.areas, self.trouble = areas, trouble
        self._reading, self.known = False, True


def areas_of(items: list[Any]) -> tuple[PlannedArea, ...] | None:
    """The areas of a whole plan's items in their order; None when they make none.

    Args:
        items: MISSION_ITEM_INT or MISSION_ITEM. A polygon's corners follow each other, with their number in param1.
    """
    areas: list[PlannedArea] = []
    at = 0
    while at < len(items):
        item = items[at]
        if item.command in _POLYGONS:
            count = int(item.param1) if math.isfinite(item.param1) else 0
            corners = items[at : at + count]
            places = tuple(place for place in map(_place, corners) if place is not None)
            if count < _CORNERS or len(places) != count or any(c.command != item.command for c in corners):
                return None
            areas.append(PlannedArea(_POLYGONS[item.command], places))
            at += count
            continue
        if item.command in _CIRCLES:
            centre = _place(item)
            if centre is None or not (math.isfinite(item.param1) and item.param1 > 0.0):
                return None
            areas.append(PlannedArea(_CIRCLES[item.command], (centre,), float(item.param1)))
        elif item.command != mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT:
            return None
        at += 1
    return tuple(areas)


def _place(item: Any) -> tuple[float, float] | None:
    scale = 1e-7 if item.get_type() == "MISSION_ITEM_INT" else 1.0
    lat, lon = item.x * scale, item.y * scale
    known = math.isfinite(lat) and math.isfinite(lon) and abs(lat) <= 90.0 and abs(lon) <= 180.0
    return (lat, lon) if known else None
