"""What the pilot process can do to the vehicle: setpoints by MAVSDK, orders by commands of our own."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from typing import Any, Final, Literal

from mavsdk.plugins.offboard import Offboard, OffboardError, PositionNedYaw, VelocityNedYaw
from mavsdk.system import System
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.path_follower import Setpoint
from mission.vehicle.pilot.controls import Answer, Ordered
from mission.vehicle.state.modes import ModeKind, mode_parameters
from mission.vehicle.state.packet_loss import PacketLoss
from mission.vehicle.state.vehicle_state import VehicleState

_LOG = logging.getLogger(__name__)
_TEXT_S = 3.0
_LOSSY = 0.03
"""Fraction of lost packets beyond which a missing answer tells nothing."""
_HEARD_S = 0.2
"""Without any packet for longer, what was sent may be missing without a gap in the numbers that shows it."""
_COMMANDS: Final[dict[Ordered, int]] = {
    "mode": mavlink.MAV_CMD_DO_SET_MODE,
    "arm": mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    "take-off": mavlink.MAV_CMD_NAV_TAKEOFF,
}
_ORDERS: Final[dict[int, Ordered]] = {command: order for order, command in _COMMANDS.items()}
_TAKEN: Final = (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS)


class MavsdkControls:
    """`mission.vehicle.pilot.controls.Controls` on MAVSDK 4. Nothing blocks: answers show in the vehicle's state.

    Only setpoints go through MAVSDK: its plugins send a command again when the answer is lost, whatever the pilot has
    done since, and end the process when they are destroyed meanwhile. Its Offboard plugin streams the last setpoint at
    20 Hz without having been started; destroying it is the one way to silence it.

    Args:
        system: the vehicle in MAVSDK.
        link: the pilot process's own pymavlink side, for all orders.
        vehicle: what the autopilot reports.
        loss: of the packets that the autopilot sends.
        clock: monotonic seconds.
        release: the mode in which control is given back (`FlightSettings.release`).
    """

    def __init__(
        self,
        system: System,
        link: MavlinkLink,
        vehicle: VehicleState,
        loss: PacketLoss,
        clock: Callable[[], float] = time.monotonic,
        *,
        release: Literal["sticks", "hold"] = "sticks",
    ) -> None:
        self._system = system
        self._link = link
        self._vehicle = vehicle
        self._loss = loss
        self._release = release
        self._clock = clock
        self._offboard: Offboard | None = None
        self._answers: dict[Ordered, tuple[float, int]] = {}
        self._complaint = ""

    def setpoint(self, setpoint: Setpoint, yaw_rad: float) -> None:
        """Send a position and velocity setpoint with an absolute heading (SET_POSITION_TARGET_LOCAL_NED)."""
        if self._offboard is None:
            self._offboard = Offboard(self._system)
        yaw_deg = math.degrees(yaw_rad)
        north, east, down = (float(v) for v in setpoint.position_ned_m)
        v_north, v_east, v_down = (float(v) for v in setpoint.velocity_ned_m_s)
        try:
            self._offboard.set_position_velocity_ned(
                PositionNedYaw(north, east, down, yaw_deg), VelocityNedYaw(v_north, v_east, v_down, yaw_deg)
            )
        except OffboardError as error:
            # The link is down, which the flight sees by itself.
            _LOG.warning("setpoint: %s", error)

    def release(self) -> None:
        """Stop the setpoints at once and leave the mode as it is."""
        offboard, self._offboard = self._offboard, None
        if offboard is not None:
            offboard.destroy()

    def ask_mode(self, kind: ModeKind, attempt: int) -> None:
        """Send MAV_CMD_DO_SET_MODE once."""
        sticks = self._release == "sticks" and self._vehicle.sticks.rest(self._clock())
        self._command("mode", attempt, *mode_parameters(self._vehicle.autopilot, kind, attempt, sticks=sticks))

    def arm(self, attempt: int) -> None:
        """Send MAV_CMD_COMPONENT_ARM_DISARM once."""
        self._command("arm", attempt, 1.0)

    def take_off(self, height_m: float, attempt: int) -> None:
        """Send MAV_CMD_NAV_TAKEOFF once: its altitude is above home on ArduPilot and AMSL on PX4."""
        nan = math.nan
        if self._vehicle.autopilot == "ardupilot":
            self._command("take-off", attempt, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)
        else:
            self._command("take-off", attempt, nan, 0.0, 0.0, nan, nan, nan, self._vehicle.alt_amsl_m + height_m)

    def take_answer(self, ack: Any, now_s: float) -> None:
        """Take in a COMMAND_ACK; called in the link's thread. Those to others are passed over."""
        if (ack.get_srcSystem(), ack.get_srcComponent()) != (self._link.target_system, self._link.target_component):
            return
        order = _ORDERS.get(ack.command)
        addressed = ack.target_component == self._link.source_component
        # Without an address it may be the answer to somebody else, which is no reason to order again.
        if order is None or not (addressed or (ack.target_component == 0 and ack.result in _TAKEN)):
            return
        self._answers[order] = now_s, ack.result
        if ack.result not in _TAKEN:
            found = mavlink.enums["MAV_RESULT"].get(ack.result)
            name = str(ack.result) if found is None else found.name.removeprefix("MAV_RESULT_")
            self._complaint = f"{order}: {name}"

    def answer(self, order: Ordered, since_s: float) -> Answer:
        """What became of the order of this kind that was sent at a time."""
        answered_s, result = self._answers.get(order, (-math.inf, 0))
        if answered_s >= since_s:
            return "accepted" if result in _TAKEN else "refused"
        now = self._clock()
        fraction = self._loss.fraction(now)
        if fraction is not None and fraction > _LOSSY:
            return "lossy"
        heard_s = self._vehicle.heard_s
        whole = heard_s is not None and now - heard_s < _HEARD_S and self._loss.missing_s < since_s
        return "not-received" if whole else "silent"

    def complaint(self) -> str:
        """Why the autopilot refused the last order, with what it says about it; empty when it did not."""
        complaint, self._complaint = self._complaint, ""
        now = self._clock()
        said = [text for t_s, severity, text in list(self._vehicle.texts) if severity <= 4 and now - t_s < _TEXT_S]
        return ", ".join([c for c in (complaint, *said[-1:]) if c])

    def _command(self, order: Ordered, attempt: int, *params: float) -> None:
        seven = [*params, *([0.0] * 7)][:7]
        self._link.send(
            mavlink.MAVLink_command_long_message(
                self._link.target_system, self._link.target_component, _COMMANDS[order], min(attempt, 255), *seven
            )
        )
