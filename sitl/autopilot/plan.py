"""The mission that is stored in the autopilot, and the mission protocol's uploads and downloads.

https://mavlink.io/en/services/mission.html. ArduPilot asks with MISSION_REQUEST and keeps home as item 0; PX4 asks with
MISSION_REQUEST_INT and has no home item.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.flavour import Flavour
from sitl.autopilot.local_frame import LocalFrame
from sitl.autopilot.rotation import Vec

MISSION: int = mavlink.MAV_MISSION_TYPE_MISSION
_TYPES = (MISSION, mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY)
_CAPACITY = 500
_FRAMES = (0, 2, 3, 5, 6, 10, 11)
_INT_FRAMES = {
    mavlink.MAV_FRAME_GLOBAL: mavlink.MAV_FRAME_GLOBAL_INT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
}
_FLOAT_FRAMES = {told: asked for asked, told in _INT_FRAMES.items()}
_AMSL = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)


@dataclass(frozen=True, slots=True)
class PlanItem:
    """One item, as MISSION_ITEM_INT carries it."""

    frame: int
    command: int
    autocontinue: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


class Plan:
    """Items of the three kinds of plan; the mission has a current item."""

    PLACES = (
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
    )

    def __init__(self, flavour: Flavour) -> None:
        self.flavour = flavour
        self._items: dict[int, tuple[PlanItem, ...]] = dict.fromkeys(_TYPES, ())
        self.current = 0
        self.reached: int | None = None
        """Item that was reached since it was last asked for (MISSION_ITEM_REACHED)."""

    def items(self, kind: int, home: PlanItem) -> tuple[PlanItem, ...]:
        """What a download gives: on ArduPilot item 0 of a mission is home as it is now."""
        stored = self._items.get(kind, ())
        if kind == MISSION and stored and self.flavour.home_is_item_0:
            return (home, *stored[1:])
        return stored

    def store(self, kind: int, items: tuple[PlanItem, ...]) -> None:
        """Replace a whole plan; items are kept as the autopilot keeps them."""
        self._items[kind] = tuple(map(self._kept, items)) if kind == MISSION else items
        if kind == MISSION:
            self.current = 0

    def _kept(self, item: PlanItem) -> PlanItem:
        """PX4 tells frames by their INT names and yaw with float32's error; ArduPilot cuts heights to centimetres."""
        if self.flavour.home_is_item_0:
            return replace(item, z=math.trunc(100.0 * item.z) / 100.0)
        *first, yaw = item.params
        one, two, three = first
        there_and_back = float(np.float32(math.degrees(np.float32(math.radians(yaw)))))
        return replace(item, frame=_INT_FRAMES.get(item.frame, item.frame), params=(one, two, three, there_and_back))

    def count(self, kind: int) -> int:
        """How many items are stored."""
        return len(self._items.get(kind, ()))

    @property
    def flyable(self) -> bool:
        """Whether there is a mission beside home."""
        return len(self._items[MISSION]) > int(self.flavour.home_is_item_0)

    def select(self, index: int) -> bool:
        """Make an item the current one; False if there is none with this index."""
        if not 0 <= index < len(self._items[MISSION]):
            return False
        self.current = index
        return True

    def current_item(self) -> PlanItem | None:
        """The item to fly; None without a mission."""
        items = self._items[MISSION]
        first = int(self.flavour.home_is_item_0)
        if len(items) <= first:
            return None
        self.current = max(first, min(self.current, len(items) - 1))
        return items[self.current]

    def advance(self) -> bool:
        """Go to the next item; False at the end."""
        self.reached = self.current
        if self.current + 1 >= len(self._items[MISSION]):
            return False
        self.current += 1
        return True

    @staticmethod
    def position(item: PlanItem, place: LocalFrame, home_up: float) -> Vec:
        """Where an item is, ENU."""
        east, north, up = place.enu(item.x / 1e7, item.y / 1e7, item.z)
        return east, north, up if item.frame in _AMSL else item.z + home_up


@dataclass(frozen=True, slots=True)
class _Upload:
    kind: int
    count: int
    items: tuple[PlanItem, ...]
    asked_s: float
    started_s: float
    system: int
    component: int


class PlanTransfer:
    """The autopilot's side of the mission protocol with one peer; times in seconds."""

    RETRY_S = 0.5
    GIVE_UP_S = 5.0

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._upload: _Upload | None = None

    def handle(self, message: Any, now: float, home: PlanItem) -> list[Any]:
        """The answers to a MISSION_* message that is meant for us."""
        kind = message.get_type()
        peer = (message.get_srcSystem(), message.get_srcComponent())
        if kind == "MISSION_REQUEST_LIST":
            if message.mission_type not in _TYPES:
                return [self._ack(peer, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)]
            count = len(self._plan.items(message.mission_type, home))
            return [mavlink.MAVLink_mission_count_message(*peer, count, message.mission_type)]
        if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            return [self._item(message, peer, home)]
        if kind == "MISSION_COUNT":
            return self._begin(message, peer, now)
        if kind == "MISSION_ITEM_INT":
            return self._receive(message, peer, now)
        if kind == "MISSION_CLEAR_ALL":
            kinds = _TYPES if message.mission_type == mavlink.MAV_MISSION_TYPE_ALL else (message.mission_type,)
            for each in kinds:
                self._plan.store(each, ())
            return [self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)]
        return []

    def step(self, now: float) -> list[Any]:
        """Ask again for an item that did not come; give up after five seconds."""
        up = self._upload
        if up is None or now - up.asked_s < self.RETRY_S:
            return []
        if now - up.started_s > self.GIVE_UP_S:
            self._upload = None
            return [self._ack((up.system, up.component), mavlink.MAV_MISSION_OPERATION_CANCELLED, up.kind)]
        self._upload = replace(up, asked_s=now)
        return [self._ask(self._upload)]

    def _begin(self, message: Any, peer: tuple[int, int], now: float) -> list[Any]:
        if message.mission_type not in _TYPES:
            return [self._ack(peer, mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)]
        if message.count > _CAPACITY:
            return [self._ack(peer, mavlink.MAV_MISSION_NO_SPACE, message.mission_type)]
        if message.count == 0:
            self._plan.store(message.mission_type, ())
            return [self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)]
        self._upload = _Upload(message.mission_type, message.count, (), now, now, *peer)
        return [self._ask(self._upload)]

    def _receive(self, message: Any, peer: tuple[int, int], now: float) -> list[Any]:
        up = self._upload
        if up is None or message.mission_type != up.kind:
            if message.seq + 1 == self._plan.count(message.mission_type):
                return [self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)]  # our ack was lost
            return [self._ack(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE, message.mission_type)]
        if message.seq != len(up.items):
            return [self._ask(up)]  # sent twice, or one was lost
        if up.kind == MISSION and message.frame not in _FRAMES:
            self._upload = None
            return [self._ack(peer, mavlink.MAV_MISSION_UNSUPPORTED_FRAME, up.kind)]
        if not math.isfinite(message.z):
            self._upload = None
            return [self._ack(peer, mavlink.MAV_MISSION_INVALID_PARAM7, up.kind)]
        params = (message.param1, message.param2, message.param3, message.param4)
        item = PlanItem(message.frame, message.command, message.autocontinue, params, message.x, message.y, message.z)
        up = replace(up, items=(*up.items, item), asked_s=now, started_s=now)
        if len(up.items) < up.count:
            self._upload = up
            return [self._ask(up)]
        self._upload = None
        self._plan.store(up.kind, up.items)
        return [self._ack(peer, mavlink.MAV_MISSION_ACCEPTED, up.kind)]

    def _item(self, message: Any, peer: tuple[int, int], home: PlanItem) -> Any:
        items = self._plan.items(message.mission_type, home)
        if not 0 <= message.seq < len(items):
            return self._ack(peer, mavlink.MAV_MISSION_INVALID_SEQUENCE, message.mission_type)
        item = items[message.seq]
        current = int(message.mission_type == MISSION and message.seq == self._plan.current)
        floats = message.get_type() == "MISSION_REQUEST"
        frame = _FLOAT_FRAMES.get(item.frame, item.frame) if floats else item.frame
        head = (*peer, message.seq, frame, item.command, current, item.autocontinue, *item.params)
        if floats:
            local = item.frame == mavlink.MAV_FRAME_MISSION
            x, y = (float(item.x), float(item.y)) if local else (item.x / 1e7, item.y / 1e7)
            return mavlink.MAVLink_mission_item_message(*head, x, y, item.z, message.mission_type)
        return mavlink.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, message.mission_type)

    def _ask(self, up: _Upload) -> Any:
        which = (up.system, up.component, len(up.items), up.kind)
        if self._plan.flavour.asks_mission_int and up.items:  # also PX4 asks for the first one the old way
            return mavlink.MAVLink_mission_request_int_message(*which)
        return mavlink.MAVLink_mission_request_message(*which)

    @staticmethod
    def _ack(peer: tuple[int, int], result: int, kind: int) -> Any:
        return mavlink.MAVLink_mission_ack_message(*peer, result, kind)
