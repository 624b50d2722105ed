"""A vehicle in memory that holds a plan, with the habits of PX4 or of ArduPilot, and a link that loses messages.

Time is the link's own and passes only while somebody waits, so tests are exact and take no time.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from gcs_plugin.publish.messages import Message
from gcs_plugin.publish.mission_protocol import MissionItem

US = (245, 191)
VEHICLE = (1, 1)
PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


class Box:
    def __init__(self, link: FakeLink, types: tuple[str, ...]) -> None:
        self._link, self.types, self.messages = link, types, deque[Message]()

    def get(self, timeout_s: float) -> Message | None:
        self._link.wait(self, timeout_s)
        return self.messages.popleft() if self.messages else None


class FakeLink:
    """Both ends pack and parse real MAVLink 2.

    Every `lose_every`-th mission message is lost, in either direction, or each
    with the probability `loss`."""

    def __init__(
        self, vehicle: Vehicle, lose_every: int = 0, loss: float = 0.0, rng: np.random.Generator | None = None
    ) -> None:
        self._loss, self._rng = loss, rng
        self.source_system, self.source_component = US
        self.target_system, self.target_component = VEHICLE
        self.now_s = 100.0
        self.vehicle = vehicle
        self.lose_every = lose_every
        self.sent: list[Message] = []
        self.commands: list[tuple[int, tuple[float, ...], int, int, float, int]] = []
        self.command_result: int | Exception = mavlink.MAV_RESULT_ACCEPTED
        self._boxes: list[Box] = []
        self._count = 0
        self._ours = mavlink.MAVLink(None, *US)
        vehicle.link = self

    def clock(self) -> float:
        return self.now_s

    def send(self, message: Message) -> None:
        self.sent.append(message)
        if not self._lost():
            self.vehicle.take(_over_the_wire(message, self._ours))

    @contextmanager
    def listen(self, *types: str) -> Iterator[Box]:
        box = Box(self, types)
        self._boxes.append(box)
        try:
            yield box
        finally:
            self._boxes.remove(box)

    def command_int(self, command: int, params: Sequence[float], x: int, y: int, z: float, *, frame: int) -> int:
        self.commands.append((command, tuple(params), x, y, z, frame))
        if isinstance(self.command_result, Exception):
            raise self.command_result
        return self.command_result

    def deliver(self, message: Message, source: tuple[int, int] = VEHICLE) -> None:
        if message.get_type() != "HEARTBEAT" and self._lost():
            return
        arrived = _over_the_wire(message, mavlink.MAVLink(None, *source))
        for box in self._boxes:
            if message.get_type() in box.types:
                box.messages.append(arrived)

    def wait(self, box: Box, timeout_s: float) -> None:
        until = self.now_s + timeout_s
        while not box.messages and self.now_s < until:
            self.now_s = min(until, self.vehicle.next_event_s)
            self.vehicle.pass_time()

    def _lost(self) -> bool:
        self._count += 1
        if self._rng is not None:
            return bool(self._rng.random() < self._loss)
        return self.lose_every > 0 and self._count % self.lose_every == 0


def _over_the_wire(message: Message, sender: mavlink.MAVLink) -> Message:
    (parsed,) = mavlink.MAVLink(None).parse_buffer(message.pack(sender))
    return parsed


@dataclass
class Vehicle:
    """Holds a plan and speaks the mission protocol."""

    autopilot: int
    items: list[MissionItem]
    link: FakeLink = field(init=False)
    refuse_item: int | None = None
    """Answers this item of an upload with `refusal`, once."""
    refusal: int = mavlink.MAV_MISSION_NO_SPACE
    dies_at_item: int | None = None
    """Answers nothing more once this item has come; `wakes` says whether a later download is answered."""
    wakes: bool = False
    spoils: bool = False
    """Changes the second item of every upload of more than `spoils_above` items."""
    spoils_above: int = 0
    turns_by_deg: float = 0.0
    """Headings are read back turned by this."""
    mute: bool = False
    mute_at_upload: int | None = None
    """Falls silent when this upload is announced."""
    home_wanders: bool = False
    loses_final_ack: bool = False
    uploads: int = 0
    strangers: bool = False
    """Mixes in messages that look like answers and are not for us, not about the plan, or not from the vehicle."""
    _coming: list[MissionItem] | None = None
    _expected: int = 0
    _retry_s: float = float("inf")
    _retries: int = 0
    _beat_s: float = 100.5

    @property
    def next_event_s(self) -> float:
        return min(self._retry_s, self._beat_s)

    def pass_time(self) -> None:
        now = self.link.now_s
        if now >= self._beat_s:
            self._beat_s += 1.0
            self.link.deliver(mavlink.MAVLink_heartbeat_message(2, self.autopilot, 0, 0, 4, 3))
        if now >= self._retry_s:
            self._retries += 1
            if self._retries > 8:
                self._coming, self._retry_s = None, float("inf")
            else:
                self._request()

    def take(self, message: Message) -> None:
        if self.mute and not (self.wakes and message.get_type() == "MISSION_REQUEST_LIST"):
            return
        self.mute = False
        if self.strangers:
            self._disturb(message)
        match message.get_type():
            case "MISSION_REQUEST_LIST":
                if self.home_wanders and self.items:
                    self.items[0] = replace(self.items[0], z=self.items[0].z + 0.25)
                self._say(mavlink.MAVLink_mission_count_message(*US, len(self.items), 0))
            case "MISSION_REQUEST_INT":
                self._say(self._item(message.seq))
            case "MISSION_CLEAR_ALL":
                self.items = self.items[:1] if self.autopilot == ARDUPILOT else []
                self._ack(mavlink.MAV_MISSION_ACCEPTED)
            case "MISSION_COUNT":
                self._begin(message.count)
            case "MISSION_ITEM_INT":
                self._store(message)

    def _begin(self, count: int) -> None:
        if self._coming is not None and self._expected > 0:
            return
        self.uploads += 1
        if self.uploads == self.mute_at_upload:
            self.mute = True
            return
        self._count, self._expected, self._retries = count, 0, 0
        self._coming = []
        if self.autopilot == ARDUPILOT:  # writes into the plan itself
            del self.items[count:]
        self._request()

    def _store(self, message: Message) -> None:
        if self._coming is None:
            return
        if message.seq != self._expected:
            if self.autopilot == ARDUPILOT:
                self._ack(mavlink.MAV_MISSION_INVALID_SEQUENCE)
            else:
                self._request()
            return
        if message.seq == self.dies_at_item:
            self.dies_at_item, self.mute, self._coming, self._retry_s = None, True, None, float("inf")
            return
        if message.seq == self.refuse_item:
            self.refuse_item, self._coming, self._retry_s = None, None, float("inf")
            self._ack(self.refusal)
            return
        item = read(message)
        if self.spoils and message.seq == 1 and self._count > self.spoils_above:
            item = replace(item, x=item.x + 1000)
        self._coming.append(item)
        if self.autopilot == ARDUPILOT:
            if message.seq == 0:
                self.items[:1] = self.items[:1] or [HOME]
            else:
                self.items[message.seq : message.seq + 1] = [
                    replace(item, params=(*item.params[:3], 0.0), z=in_centimetres(item.z))
                ]
        self._expected += 1
        self._retries = 0
        if self._expected < self._count:
            self._request()
            return
        if self.autopilot == PX4:
            self.items = self._coming
        self._coming, self._retry_s = None, float("inf")
        if not self.loses_final_ack:
            self._ack(mavlink.MAV_MISSION_ACCEPTED)

    def _request(self) -> None:
        kind = (
            mavlink.MAVLink_mission_request_message
            if self.autopilot == ARDUPILOT
            else mavlink.MAVLink_mission_request_int_message
        )
        self._retry_s = self.link.now_s + (1.0 if self.autopilot == ARDUPILOT else 0.25)
        self._say(kind(*US, self._expected, 0))

    def _item(self, seq: int) -> Message:
        item = self.items[seq]
        item = replace(item, params=(*item.params[:3], item.params[3] + self.turns_by_deg))
        frame = {0: 5, 3: 6}.get(item.frame, item.frame) if self.autopilot == PX4 else item.frame
        return mavlink.MAVLink_mission_item_int_message(
            *US, seq, frame, item.command, int(seq == 0), item.autocontinue, *item.params, item.x, item.y, item.z, 0
        )

    def _ack(self, result: int) -> None:
        self._say(mavlink.MAVLink_mission_ack_message(*US, result, 0))

    def _say(self, message: Message) -> None:
        self.link.deliver(message)

    def _disturb(self, message: Message) -> None:
        refused = mavlink.MAV_MISSION_DENIED
        self.link.deliver(mavlink.MAVLink_mission_ack_message(*US, refused, 1))  # about the fence
        self.link.deliver(mavlink.MAVLink_mission_ack_message(255, 190, refused, 0))  # for a ground station
        self.link.deliver(mavlink.MAVLink_mission_ack_message(*US, refused, 0), source=(1, 100))  # from the camera
        if message.get_type() in ("MISSION_COUNT", "MISSION_ITEM_INT"):
            self.link.deliver(mavlink.MAVLink_mission_ack_message(*US, mavlink.MAV_MISSION_ACCEPTED, 0))  # too early
            self.link.deliver(mavlink.MAVLink_mission_request_message(*US, 500, 0))  # of no item
        if message.get_type() == "MISSION_REQUEST_INT":
            self.link.deliver(self._item((message.seq + 1) % len(self.items)))  # of another item


def read(message: Message) -> MissionItem:
    params = (message.param1, message.param2, message.param3, message.param4)
    return MissionItem(
        message.frame, message.command, params, message.x, message.y, message.z, message.autocontinue, message.current
    )


HOME = MissionItem(0, mavlink.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 0.0), 372276000, 1268405000, 30.0)
NAN = float("nan")


def in_centimetres(height_m: float) -> float:
    """A height as ArduPilot keeps and reports it: cut to centimetres, in single precision (AP_Mission.cpp)."""
    if math.isnan(height_m):
        return height_m
    return float(np.float32(int(np.float32(height_m) * np.float32(100.0))) * np.float32(0.01))


def plan(autopilot: int, length: int = 4) -> list[MissionItem]:
    """What an operator may have planned; on ArduPilot home comes first."""
    operators = [
        MissionItem(3, mavlink.MAV_CMD_NAV_TAKEOFF, (0.0, 0.0, 0.0, NAN), 0, 0, 10.0),
        MissionItem(3, mavlink.MAV_CMD_NAV_WAYPOINT, (1.5, 2.0, 0.0, NAN), 372281234, 1268409876, 12.300000190734863),
        MissionItem(2, mavlink.MAV_CMD_DO_CHANGE_SPEED, (1.0, 3.25, -1.0, 0.0), 0, 0, 0.0),
        MissionItem(3, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0, autocontinue=0),
    ][:length]
    if autopilot == ARDUPILOT:
        return [HOME, *(replace(each, params=(*each.params[:3], 0.0), z=in_centimetres(each.z)) for each in operators)]
    return [replace(item, frame={0: 5, 3: 6}.get(item.frame, item.frame)) for item in operators]
