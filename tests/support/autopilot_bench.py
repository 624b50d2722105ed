"""A ground station without sockets or waiting: it talks to the autopilot's core and moves its time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.records import Vector
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flavour import Mode
from sitl.autopilot.flight_stack import TICK_S
from sitl.autopilot.link import Link

START_S = 1000.0
IGNORE_POSITION, IGNORE_VELOCITY, IGNORE_ACCELERATION = 0b111, 0b111 << 3, 0b111 << 6
IGNORE_YAW, IGNORE_YAW_RATE = 1 << 10, 1 << 11


class Bench:
    """One autopilot, one or more peers, and all messages that came back."""

    def __init__(self, config: AutopilotConfig) -> None:
        self.autopilot = Autopilot(config, START_S, 1.8e9)
        self.now = START_S
        self.peer = Peer(self.autopilot)
        self.track: list[tuple[float, ...]] = []

    def run(self, seconds: float, stream: Callable[[float], Any] | None = None, every_s: float = 0.05) -> None:
        """Let time pass, sending `stream(seconds since the call)` regularly."""
        ticks, period = round(seconds / TICK_S), round(every_s / TICK_S)
        for k in range(ticks):
            if stream is not None and k % period == 0:
                self.peer.send(stream(k * TICK_S))
            self.now += TICK_S
            self.autopilot.step(self.now)
            truth = self.autopilot.truth
            self.track.append((self.now, *truth.position_enu_m, *truth.velocity_enu_m_s))

    def path(self) -> Vector:
        """(n, 7): time, true position and velocity ENU since the last call."""
        found = np.array(self.track)
        self.track = []
        return found

    def height(self) -> float:
        """True height above the ground."""
        return float(self.autopilot.truth.position_enu_m[2])

    def heading_deg(self) -> float:
        """True heading."""
        w, x, y, z = self.autopilot.vehicle.airframe.world_from_flu
        return 90.0 - math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))

    def fly_up(self, height: float = 3.0, seconds: float = 10.0) -> None:
        """Wait until ready, arm, take off."""
        self.run(3.5)
        ardupilot = self.autopilot.flavour.name == "ardupilot"
        if ardupilot:
            self.peer.set_mode(4)
        assert self.peer.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
        target = height if ardupilot else height + self.autopilot.place.alt_amsl_m
        assert self.peer.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, math.nan, math.nan, math.nan, target) == 0
        self.run(seconds)

    def hover(self, height: float = 3.0) -> None:
        """Start in the air at a height, armed, in Hold (ArduPilot: GUIDED): the short way for tests of what follows."""
        commander, ardupilot = self.autopilot.commander, self.autopilot.flavour.name == "ardupilot"
        self.autopilot.vehicle.place((0.0, 0.0, height))
        self.now += 100.0  # long since ready
        commander.armed, commander.landed, commander.armed_at, commander.air_at = True, False, self.now, self.now
        commander.mode = Mode.OFFBOARD if ardupilot else Mode.HOLD
        self.run(1.0)

    def enter_offboard(self, stream: Callable[[float], Any]) -> None:
        """Stream a little, then take control as MAVSDK does."""
        self.run(0.2, stream)
        ardupilot = self.autopilot.flavour.name == "ardupilot"
        assert (self.peer.set_mode(4) if ardupilot else self.peer.set_mode(6)) == 0


class Peer:
    """A MAVLink component on a link of its own."""

    def __init__(self, autopilot: Autopilot, system: int = 255, component: int = 190) -> None:
        self._autopilot = autopilot
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._receiver = mavlink.MAVLink(None)
        self._receiver.robust_parsing = True
        self.received: list[Any] = []
        self.link: Link = autopilot.add_link(self._take)

    def _take(self, data: bytes) -> None:
        self.received += self._receiver.parse_buffer(data) or []

    def send(self, message: Any) -> None:
        self._autopilot.receive(self.link, self.pack(message))

    def pack(self, message: Any) -> bytes:
        packed = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return packed

    def command(self, command: int, *params: float) -> int | None:
        """Send a COMMAND_LONG; the MAV_RESULT that came back at once."""
        self.received = [m for m in self.received if m.get_type() != "COMMAND_ACK"]
        padded = [*params, *[0.0] * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *padded))
        acks = [m.result for m in self.received if m.get_type() == "COMMAND_ACK" and m.command == command]
        return acks[-1] if acks else None

    def set_mode(self, main: int, sub: int = 0) -> int | None:
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub)

    def ask_rate(self, message_id: int, hz: float) -> int | None:
        return self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / hz)

    def of(self, kind: str) -> list[Any]:
        """What came of one type."""
        return [m for m in self.received if m.get_type() == kind]

    def texts(self) -> list[str]:
        return [m.text for m in self.of("STATUSTEXT")]


def setpoint(
    position_ned: tuple[float, float, float] | None = None,
    velocity_ned: tuple[float, float, float] | None = None,
    yaw: float | None = None,
    yaw_rate: float | None = None,
    frame: int = mavlink.MAV_FRAME_LOCAL_NED,
) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED with the mask that leaves out what is None."""
    mask = IGNORE_ACCELERATION
    mask |= 0 if position_ned else IGNORE_POSITION
    mask |= 0 if velocity_ned else IGNORE_VELOCITY
    mask |= 0 if yaw is not None else IGNORE_YAW
    mask |= 0 if yaw_rate is not None else IGNORE_YAW_RATE
    place, speed = position_ned or (0.0, 0.0, 0.0), velocity_ned or (0.0, 0.0, 0.0)
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *place, *speed, 0.0, 0.0, 0.0, yaw or 0.0, yaw_rate or 0.0
    )


def velocity_step(speed_east: float, seconds: float) -> Callable[[float], Any]:
    """East at a speed for some seconds, then stop; heading held north."""
    return lambda t: setpoint(velocity_ned=(0.0, speed_east if t < seconds else 0.0, 0.0), yaw=0.0)
