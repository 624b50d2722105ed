"""A vehicle in memory: the state that the pilot's rules look at, and controls that answer as an autopilot would."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.drone import Bounds, OrderState, Path
from mission.vehicle.limits import FlightSettings
from mission.vehicle.path_follower import Setpoint
from mission.vehicle.pilot.controls import Answer, Ordered
from mission.vehicle.pilot.protocol import EventReport, FlyOrder, OrderKind, OrderReport
from mission.vehicle.pilot.rules import FlightRules
from mission.vehicle.state.modes import ModeKind, mode_parameters
from mission.vehicle.state.vehicle_state import VehicleState

TICK_S = 0.02
PX4_MODES = {
    "hold": (4, 3),
    "offboard": (6, 0),
    "land": (4, 6),
    "take-off": (4, 2),
    "position": (3, 0),
    "return": (4, 5),
}
COPTER_MODES = {"hold": 17, "offboard": 4, "land": 9, "loiter": 5, "stabilize": 0, "return": 6}


class FakeVehicle:
    """Obeys setpoints at once and modes after one tick; time passes only by `run`."""

    def __init__(self, autopilot: Literal["px4", "ardupilot"] = "px4") -> None:
        self.autopilot = autopilot
        self.now_s = 100.0
        self.state = VehicleState(1)
        self.log: list[str] = []
        self.reports: list[OrderReport | EventReport] = []
        self.setpoints: list[tuple[float, Setpoint, float]] = []
        self.place = np.array([0.0, 0.0, 0.0])
        self.velocity = np.zeros(3)
        self.yaw = self._last_yaw = 0.0
        self.armed = False
        self.landed = mavlink.MAV_LANDED_STATE_ON_GROUND
        self.battery = 90
        self.custom_mode = self._code("hold" if autopilot == "px4" else "stabilize")
        self.obeys = self._obeyed = True
        self.silent = False
        self.fix = 3
        self.nowhere = False
        self.estimator = 1023 if autopilot == "px4" else 831
        self.boot_s: float | None = None
        """Where the autopilot's clock stands still."""
        self.streaming = False
        self.program_alive = True
        self.flight = FlightRules(self, self.state, FlightSettings(), self.reports.append)
        self._ids = 0
        self._tell()

    # The autopilot --------------------------------------------------------------------------------------------------

    def switch(self, mode: str) -> None:
        """The operator's switch."""
        self.custom_mode = self._code(mode)

    def airborne(self, height_m: float = 3.0) -> FakeVehicle:
        """Already flying, in hold (GUIDED on ArduPilot, as after a take-off)."""
        self.run(0.1)
        self.armed, self.landed = True, mavlink.MAV_LANDED_STATE_IN_AIR
        self.place = np.array([0.0, 0.0, -height_m])
        self.custom_mode = self._code("hold" if self.autopilot == "px4" else "offboard")
        self.run(0.1)
        return self

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            if self.streaming and self.setpoints and self.obeys and self.custom_mode == self._code("offboard"):
                _, setpoint, yaw = self.setpoints[-1]
                self.velocity = setpoint.velocity_ned_m_s
                self.place, self.yaw = setpoint.position_ned_m.copy(), yaw
            else:
                self.velocity = np.zeros(3)
            if not self.silent:
                self._tell()
            if self.program_alive:
                self.flight.heard(self.now_s)
            self.flight.step(self.now_s)

    # What the pilot does --------------------------------------------------------------------------------------------

    def setpoint(self, setpoint: Setpoint, yaw_rad: float) -> None:
        self.streaming = True
        self.setpoints.append((self.now_s, setpoint, yaw_rad))

    def release(self) -> None:
        self.log.append("release")
        self.streaming = False

    def ask_mode(self, kind: ModeKind, attempt: int) -> None:
        mode_parameters(self.autopilot, kind, attempt)
        self._do(f"mode {kind}", kind)

    def arm(self, attempt: int) -> None:
        self.log.append("arm")
        self._obeyed = self.obeys
        self.armed = self.obeys

    def take_off(self, height_m: float, attempt: int) -> None:
        self.log.append(f"take-off {height_m}")
        self._obeyed = self.obeys
        if self.obeys:
            self.landed = mavlink.MAV_LANDED_STATE_IN_AIR
            self.place = np.array([0.0, 0.0, -height_m])

    def answer(self, order: Ordered, since_s: float) -> Answer:
        return "accepted" if self._obeyed else "refused"

    def complaint(self) -> str:
        return "" if self.obeys else "COMMAND_DENIED"

    # What the program does ------------------------------------------------------------------------------------------

    def begin(self, bounds: Bounds | None = None) -> None:
        self.flight.begin(bounds or Bounds(), self.now_s)

    def order(
        self,
        kind: OrderKind,
        *,
        height_m: float | None = None,
        heading_rad: float | None = None,
        path: Path | None = None,
    ) -> int:
        self._ids += 1
        order = FlyOrder(id=self._ids, kind=kind, height_m=height_m, heading_rad=heading_rad, path=path)
        self.flight.order(order, self.now_s)
        return self._ids

    def state_of(self, order: int) -> OrderState:
        states = [r.state for r in self.reports if isinstance(r, OrderReport) and r.id == order]
        return states[-1] if states else OrderState.PENDING

    def reason_of(self, order: int) -> str:
        return next(r.reason for r in reversed(self.reports) if isinstance(r, OrderReport) and r.id == order)

    def events(self, kind: str) -> list[EventReport]:
        return [r for r in self.reports if isinstance(r, EventReport) and r.kind == kind]

    def _do(self, what: str, mode: str) -> None:
        self.log.append(what)
        self._obeyed = self.obeys
        if self.obeys:
            self.custom_mode = self._code(mode)

    def _code(self, mode: str) -> int:
        if self.autopilot == "ardupilot":
            return COPTER_MODES[mode]
        main, sub = PX4_MODES[mode]
        return main << 16 | sub << 24

    def _tell(self) -> None:
        px4 = self.autopilot == "px4"
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        maker = mavlink.MAV_AUTOPILOT_PX4 if px4 else mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        boot_ms = round(1000 * (self.now_s if self.boot_s is None else self.boot_s))
        rate, self._last_yaw = math.remainder(self.yaw - self._last_yaw, math.tau) / TICK_S, self.yaw
        north, east, down = (float(v) for v in self.place)
        lat, lon = (
            37.0 + math.degrees(north / 6.371e6),
            127.0 + math.degrees(east / 6.371e6 / math.cos(math.radians(37))),
        )
        if self.nowhere:
            lat = lon = 0.0
        for message in (
            mavlink.MAVLink_heartbeat_message(2, maker, armed, self.custom_mode, mavlink.MAV_STATE_ACTIVE, 3),
            mavlink.MAVLink_extended_sys_state_message(0, self.landed),
            mavlink.MAVLink_sys_status_message(
                0, 0, mavlink.MAV_SYS_STATUS_PREARM_CHECK, 0, 12000, -1, self.battery, 0, 0, 0, 0, 0, 0
            ),
            mavlink.MAVLink_gps_raw_int_message(0, self.fix, 0, 0, 30_000, 70, 70, 0, 0, 12, 53_000, 300, 300, 0, 0, 0),
            mavlink.MAVLink_ekf_status_report_message(self.estimator, 0, 0, 0, 0, 0)
            if not px4
            else mavlink.MAVLink_estimator_status_message(0, self.estimator, 0, 0, 0, 0, 0, 0, 0.3, 0.3),
            mavlink.MAVLink_global_position_int_message(
                boot_ms,
                round(lat * 1e7),
                round(lon * 1e7),
                round(30_000 - 1000 * down),
                round(-1000 * down),
                0,
                0,
                0,
                0,
            ),
            mavlink.MAVLink_local_position_ned_message(boot_ms, north, east, down, *(float(v) for v in self.velocity)),
            mavlink.MAVLink_attitude_message(boot_ms, 0, 0, self.yaw, 0, 0, rate),
        ):
            self.hear(message)

    def hear(self, message: object) -> None:
        """Give a message of the autopilot to the state."""
        packer = mavlink.MAVLink(None, 1, 1)
        decoded = mavlink.MAVLink(None).decode(bytearray(message.pack(packer)))  # type: ignore[attr-defined]
        self.state.update(decoded, self.now_s)
