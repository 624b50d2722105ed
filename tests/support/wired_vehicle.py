"""An autopilot in simulated time at the far end of a link with delay: our orders and its answers as real messages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.drone import Bounds
from mission.vehicle.limits import FlightSettings
from mission.vehicle.mavlink.controls import MavsdkControls
from mission.vehicle.mavlink.pilot_config import PILOT_COMPONENT
from mission.vehicle.path_follower import Setpoint
from mission.vehicle.pilot.preconditions import NoGuards
from mission.vehicle.pilot.protocol import EventReport, FlyOrder, OrderKind, OrderReport
from mission.vehicle.pilot.rules import FlightRules
from mission.vehicle.state.modes import flight_mode
from mission.vehicle.state.packet_loss import PacketLoss
from mission.vehicle.state.vehicle_state import VehicleState

TICK_S = 0.02
LATENCY_S = 0.02
"""Each way."""
NEWS_S = 0.1
"""What the pilot does is known to us after this long, or later: a first order may cross it on its way."""
Flavour = Literal["px4", "ardupilot"]
CODES: dict[Flavour, dict[str, int]] = {
    "px4": {
        "hold": 3 << 24 | 4 << 16,
        "offboard": 6 << 16,
        "take-off": 2 << 24 | 4 << 16,
        "land": 6 << 24 | 4 << 16,
        "position": 3 << 16,
        "return": 5 << 24 | 4 << 16,
    },
    "ardupilot": {"offboard": 4, "hold": 17, "loiter": 5, "land": 9, "altitude": 2, "return": 6},
}
_CLIMB_M_S = 1.5
ALL = 1_000_000
"""Answers: as many as there may ever be."""


class _Link:
    """Our side of the link, as far as the controls use it."""

    def __init__(self, send: Callable[[Any], None]) -> None:
        self.source_system, self.source_component = 1, PILOT_COMPONENT
        self.target_system, self.target_component = 1, 1
        self.send = send


class WiredControls(MavsdkControls):
    """The real ones, but for MAVSDK's setpoints."""

    def __init__(self, vehicle: WiredVehicle) -> None:
        link = _Link(vehicle.order_sent)
        super().__init__(None, link, vehicle.state, vehicle.loss, lambda: vehicle.now_s)  # type: ignore[arg-type]
        self._vehicle_there = vehicle

    def setpoint(self, setpoint: Setpoint, yaw_rad: float) -> None:
        self._vehicle_there.streamed_s = self._vehicle_there.now_s

    def release(self) -> None:
        self._vehicle_there.streamed_s = None


class WiredVehicle:
    """Time passes only by `run`. PX4 reports a change at its next sample of 20 Hz, ArduPilot at once; both at 1 Hz.

    Args:
        flavour: of the autopilot.
        mode: in which it is at the start.
        airborne: hovering at 3 m; else on the ground.
    """

    def __init__(self, flavour: Flavour, mode: str, *, airborne: bool = True) -> None:
        self.flavour = flavour
        self.now_s = 100.0
        self.state = VehicleState(1)
        self.loss = PacketLoss()
        self.mode = mode
        self.armed = airborne
        self.height_m = 3.0 if airborne else 0.0
        self.climb_to_m: float | None = None
        self.streamed_s: float | None = None
        self.lose_answers = 0
        self.lose_orders = 0
        self.refuse = False
        self.sent: list[tuple[float, int, float]] = []
        """When we sent which command with which second parameter."""
        self.carried_out: list[tuple[float, int]] = []
        """When the autopilot did which command."""
        self.after: dict[int, Callable[[], None]] = {}
        """What the pilot does after a command was carried out first; see `pilot_acts`."""
        self.acted_s: float | None = None
        """When the pilot did it."""
        self.undone: list[str] = []
        """What we changed by orders that set out after the pilot had acted, but for a first one that crossed it."""
        self._delays: dict[int, float] = {}
        self._due: list[tuple[float, Callable[[], None]]] = []
        self._packer = mavlink.MAVLink(None, 1, 1)
        self._told_mode = ""
        self._beat_s = self._pose_s = -1.0
        self.reports: list[OrderReport | EventReport] = []
        self.controls = WiredControls(self)
        self.flight = FlightRules(self.controls, self.state, FlightSettings(), self.reports.append, NoGuards())
        self._ids = 0
        self.run(0.3)

    # Us -------------------------------------------------------------------------------------------------------------

    def order_sent(self, message: Any) -> None:
        """A message of ours sets out."""
        self.sent.append((self.now_s, message.command, message.param2))
        if self.lose_orders > 0:
            self.lose_orders -= 1
            return
        sent_s = self.now_s
        self._due.append((sent_s + LATENCY_S, lambda: self._obey(message, sent_s)))

    def order(self, kind: OrderKind, height_m: float | None = None) -> int:
        self._ids += 1
        self.flight.order(FlyOrder(id=self._ids, kind=kind, height_m=height_m), self.now_s)
        return self._ids

    def begin(self) -> None:
        self.flight.begin(Bounds(), self.now_s)

    def last(self, order: int) -> OrderReport:
        return next(r for r in reversed(self.reports) if isinstance(r, OrderReport) and r.id == order)

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            due = [entry for entry in self._due if entry[0] <= self.now_s + 1e-9]
            self._due = [entry for entry in self._due if entry not in due]
            for _, act in due:
                act()
            self._climb()
            self._tell()
            self.flight.heard(self.now_s)
            self.flight.step(self.now_s)

    # The pilot ------------------------------------------------------------------------------------------------------

    def pilot_acts(self, command: int, delay_s: float, act: Callable[[], None]) -> None:
        """So long after a command was first carried out, the pilot does something."""
        self.after[command], self._delays[command] = act, delay_s

    def pilot_mode(self, mode: str) -> None:
        """The pilot's switch."""
        self.mode, self.acted_s, self.climb_to_m = mode, self.now_s, None

    def pilot_disarms(self) -> None:
        """The pilot's other switch."""
        self.armed, self.acted_s = False, self.now_s

    # The autopilot --------------------------------------------------------------------------------------------------

    def _obey(self, message: Any, sent_s: float) -> None:
        result = mavlink.MAV_RESULT_TEMPORARILY_REJECTED if self.refuse else self._do(message, sent_s)
        self._say(mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, 1, PILOT_COMPONENT), answer=True)
        act = self.after.pop(message.command, None) if result == mavlink.MAV_RESULT_ACCEPTED else None
        if act is not None:
            self._due.append((self.now_s + self._delays[message.command], act))

    def _do(self, message: Any, sent_s: float) -> int:
        before = self.mode, self.armed
        if message.command == mavlink.MAV_CMD_DO_SET_MODE:
            code = int(message.param2)
            if self.flavour == "px4":
                code = code << 16 | int(message.param3) << 24
            mode = next(name for name, known in CODES[self.flavour].items() if known == code)
            stale = self.streamed_s is None or self.now_s - self.streamed_s > 0.5
            if mode == "offboard" and self.flavour == "px4" and stale:
                return int(mavlink.MAV_RESULT_DENIED)
            self.mode = mode
        elif message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = True
        elif message.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            if not self.armed:
                return int(mavlink.MAV_RESULT_DENIED)
            self.mode = "take-off" if self.flavour == "px4" else self.mode
            self.climb_to_m = 3.0
        self.carried_out.append((self.now_s, message.command))
        known_s = NEWS_S if message.confirmation == 0 else 0.0
        crossed = self.acted_s is None or sent_s <= self.acted_s + known_s
        if not crossed and (self.mode, self.armed) != before:
            self.undone.append(f"{before} to {(self.mode, self.armed)}")
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _climb(self) -> None:
        if self.climb_to_m is None or not self.armed:
            return
        self.height_m = min(self.climb_to_m, self.height_m + _CLIMB_M_S * TICK_S)
        if self.height_m == self.climb_to_m:
            self.climb_to_m = None
            self.mode = "hold" if self.mode == "take-off" else self.mode

    def _say(self, message: Any, *, answer: bool = False) -> None:
        """A lost answer, too, has its number."""
        frame = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        if answer and self.lose_answers > 0:
            self.lose_answers -= 1
            return
        self._due.append((self.now_s + LATENCY_S, lambda: self._hear(frame)))

    def _hear(self, frame: bytes) -> None:
        self.loss.observe(frame, 1, self.now_s)
        message = mavlink.MAVLink(None).decode(bytearray(frame))
        if message.get_type() == "COMMAND_ACK":
            self.controls.take_answer(message, self.now_s)
        else:
            self.state.update(message, self.now_s)

    def _tell(self) -> None:
        tick = round((self.now_s - 100.0) / TICK_S)
        px4 = self.flavour == "px4"
        code = CODES[self.flavour][self.mode]
        assert flight_mode(self.flavour, code).kind != "unknown"
        changed = self.mode != self._told_mode
        if px4 and changed and tick % 3 == 0:
            self._told_mode = self.mode
            self._say(mavlink.MAVLink_current_mode_message(0, code, code))
        if self.now_s - self._beat_s >= 1.0 or (changed and not px4):
            self._beat_s, self._told_mode = self.now_s, self.mode
            armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
            maker = mavlink.MAV_AUTOPILOT_PX4 if px4 else mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
            self._say(mavlink.MAVLink_heartbeat_message(2, maker, armed, code, mavlink.MAV_STATE_ACTIVE, 3))
            self._say(mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 70, 70, 0, 0, 12, 53_000, 300, 300, 0, 0, 0))
            self._say(
                mavlink.MAVLink_estimator_status_message(0, 1023, 0, 0, 0, 0, 0, 0, 0.3, 0.3)
                if px4
                else mavlink.MAVLink_ekf_status_report_message(831, 0, 0, 0, 0, 0)
            )
        if self.now_s - self._pose_s >= 0.1:
            self._pose_s = self.now_s
            self._pose()

    def _pose(self) -> None:
        boot_ms, up_mm = round(1000 * self.now_s), round(1000 * self.height_m)
        landed = mavlink.MAV_LANDED_STATE_IN_AIR if self.height_m > 0.1 else mavlink.MAV_LANDED_STATE_ON_GROUND
        climbs = -_CLIMB_M_S if self.climb_to_m is not None and self.armed else 0.0
        self._say(mavlink.MAVLink_extended_sys_state_message(0, landed))
        where = (370_000_000, 1_270_000_000, 30_000 + up_mm, up_mm)
        self._say(mavlink.MAVLink_global_position_int_message(boot_ms, *where, 0, 0, 0, 0))
        self._say(mavlink.MAVLink_local_position_ned_message(boot_ms, 0.0, 0.0, -self.height_m, 0.0, 0.0, climbs))
        self._say(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0))
