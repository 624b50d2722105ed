"""What the pilot process can do to the vehicle: MAVSDK's offboard and action plugins, and commands of our own."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable

from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard, OffboardError, PositionNedYaw, VelocityNedYaw
from mavsdk.system import System
from pymavlink.dialects.v20 import all as mavlink

from mission.drones.link import MavlinkLink
from mission.drones.modes import ModeKind, mode_parameters
from mission.drones.path_follower import Setpoint
from mission.drones.vehicle import VehicleState
from mission.errors import LinkError

_LOG = logging.getLogger(__name__)
_TEXT_S = 3.0


class MavsdkControls:
    """`mission.drones.flight_controls.Controls` on MAVSDK 4. Nothing blocks: answers show in the vehicle's state.

    MAVSDK repeats the last setpoint at 20 Hz for ever. Destroying its Offboard plugin is the one way to silence it that
    leaves the flight mode alone (`offboard.stop` commands Hold, which would undo what the pilot has just chosen).

    Args:
        system: the vehicle in MAVSDK.
        link: the pilot process's own pymavlink side, for modes and the take-off command.
        vehicle: what the autopilot reports.
        clock: monotonic seconds.
    """

    def __init__(
        self, system: System, link: MavlinkLink, vehicle: VehicleState, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._system = system
        self._link = link
        self._vehicle = vehicle
        self._clock = clock
        self._action = Action(system)
        self._offboard: Offboard | None = None
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

    def start(self) -> None:
        """Ask for the mode that flies setpoints."""
        if self._offboard is not None:
            self._offboard.start_async(lambda result, _: self._answered("offboard", result.name))

    def stop(self) -> None:
        """Stop the setpoints and ask for hold."""
        if self._offboard is not None:
            self._offboard.stop_async(lambda result, _: self._answered("hold", result.name))
        else:
            self.ask_mode("hold", 0)

    def release(self) -> None:
        """Stop the setpoints at once and leave the mode as it is."""
        offboard, self._offboard = self._offboard, None
        if offboard is not None:
            offboard.destroy()

    def ask_mode(self, kind: ModeKind, attempt: int) -> None:
        """Send MAV_CMD_DO_SET_MODE without waiting."""
        one, two, three = mode_parameters(self._vehicle.autopilot, kind, attempt)
        self._link.send(
            mavlink.MAVLink_command_long_message(
                self._link.target_system,
                self._link.target_component,
                mavlink.MAV_CMD_DO_SET_MODE,
                min(attempt, 255),
                one,
                two,
                three,
                0,
                0,
                0,
                0,
            )
        )

    def arm(self) -> None:
        """Ask to arm."""
        self._action.arm_async(lambda result, _: self._answered("arming", result.name))

    def take_off(self, height_m: float) -> None:
        """Send MAV_CMD_NAV_TAKEOFF: its altitude is above home on ArduPilot and AMSL on PX4."""
        nan = math.nan
        if self._vehicle.autopilot == "ardupilot":
            params = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m]
        else:
            params = [nan, 0.0, 0.0, nan, nan, nan, self._vehicle.alt_amsl_m + height_m]
        threading.Thread(target=self._command_take_off, args=(params,), name="take-off", daemon=True).start()

    def complaint(self) -> str:
        """Why the autopilot refused the last request, with what it says about it; empty when it did not."""
        complaint, self._complaint = self._complaint, ""
        now = self._clock()
        said = [text for t_s, severity, text in list(self._vehicle.texts) if severity <= 4 and now - t_s < _TEXT_S]
        return ", ".join([c for c in (complaint, *said[-1:]) if c])

    def _command_take_off(self, params: list[float]) -> None:
        try:
            result = self._link.command(mavlink.MAV_CMD_NAV_TAKEOFF, params)
        except LinkError as error:
            self._complaint = error.cause
            return
        if result != mavlink.MAV_RESULT_ACCEPTED:
            self._complaint = f"take-off: {mavlink.enums['MAV_RESULT'][result].name}"

    def _answered(self, what: str, result: str) -> None:
        if result != "SUCCESS":
            self._complaint = f"{what}: {result}"
