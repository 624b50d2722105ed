"""Arm and climb to a height, on PX4 and on ArduPilot, each step verified by what the autopilot reports."""

from __future__ import annotations

from typing import Literal

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.drone import OrderState
from mission.vehicle.pilot.controls import Controls
from mission.vehicle.pilot.maneuvers import DONE, ManeuverOutcome
from mission.vehicle.pilot.request import Request
from mission.vehicle.state.modes import Autopilot, FlightMode, ModeKind
from mission.vehicle.state.vehicle_state import VehicleState

_STEP_TIMEOUT_S = 8.0
_SHORT_M = 1.5
"""PX4 ends its take-off by changing to Hold when less than this is missing (NAV_MC_ALT_RAD is 0.8 m)."""
_SLOW_M_S = 0.25
_STEADY_S = 0.4


class TakeOff:
    """Mode, arm, climb, and wait for the height AND for IN_AIR.

    Setpoints during the climb would cut it short on both autopilots, and PX4 reports IN_AIR early. On ArduPilot the
    climb is flown in GUIDED; PX4 has a mode for it and goes to Hold at its end.

    Each step is ordered once, see `Request`.

    Args:
        height_m: above the ground.
        autopilot: which one it is.
        before: the mode in which the vehicle is.
        began_s: now.
    """

    def __init__(self, height_m: float, autopilot: Autopilot, before: FlightMode, began_s: float) -> None:
        self._height_m = height_m
        self._autopilot = autopilot
        self._before = before
        self._stage: Literal["mode", "arm", "climb"] = "mode"
        self._stage_s = began_s
        self._request = Request("mode")
        self._climbed = False
        self._steady_since_s: float | None = None
        self._deadline_s = began_s + 3 * _STEP_TIMEOUT_S + 3.0 * height_m

    def allows(self, mode: FlightMode, height_m: float | None) -> bool:
        """Whether a change to this mode at this height is part of the take-off; another one is somebody else's."""
        if self._autopilot == "ardupilot":
            return mode.kind == "offboard"
        if mode.kind == "take-off" and self._stage == "climb":
            self._climbed = True
            return True
        if mode.kind != "hold":
            return False
        short = self._climbed and height_m is not None and self._height_m - height_m > _SHORT_M
        return not short or self._autopilot == "ardrone"

    def step(self, vehicle: VehicleState, controls: Controls, now_s: float) -> ManeuverOutcome | None:
        """Go on; DONE when it hovers at the height."""
        if self._stage == "mode":
            wanted: ModeKind = "offboard" if vehicle.autopilot == "ardupilot" else "hold"
            if vehicle.mode.kind == wanted:
                self._next("arm", now_s)
            elif vehicle.mode == self._before:
                attempt = self._request.due(controls, now_s, vehicle.mode_s)
                if attempt is not None:
                    controls.ask_mode(wanted, attempt)
        if self._stage == "arm":
            if vehicle.armed:
                self._next("climb", now_s)
            else:
                attempt = self._request.due(controls, now_s, vehicle.heartbeat_s)
                if attempt is not None:
                    controls.arm(attempt)
        if self._stage == "climb":
            return self._climb(vehicle, controls, now_s)
        if now_s - self._stage_s > _STEP_TIMEOUT_S:
            what = "change its mode for the take-off" if self._stage == "mode" else "arm"
            return ManeuverOutcome(OrderState.REFUSED, f"the autopilot does not {what}{_because(controls.complaint())}")
        return None

    def _climb(self, vehicle: VehicleState, controls: Controls, now_s: float) -> ManeuverOutcome | None:
        on_ground = vehicle.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
        self._climbed = self._climbed or vehicle.mode.kind == "take-off" or not on_ground
        if not vehicle.armed:
            return ManeuverOutcome(OrderState.ENDED, "the vehicle was disarmed before it had taken off")
        if not self._climbed:
            attempt = self._request.due(controls, now_s, vehicle.mode_s)
            if attempt is not None:
                controls.take_off(self._height_m, attempt)
        if on_ground and now_s - self._stage_s > _STEP_TIMEOUT_S:
            return ManeuverOutcome(OrderState.REFUSED, f"the vehicle does not take off{_because(controls.complaint())}")
        if self._arrived(vehicle):
            if self._steady_since_s is None:
                self._steady_since_s = now_s
            elif now_s - self._steady_since_s >= _STEADY_S:
                return DONE
        else:
            self._steady_since_s = None
        if now_s > self._deadline_s:
            height = vehicle.height_m
            at = "an unknown height" if height is None else f"{height:.1f} m"
            return ManeuverOutcome(OrderState.ENDED, f"the climb to {self._height_m:.1f} m ended at {at}")
        return None

    def _arrived(self, vehicle: VehicleState) -> bool:
        height, local = vehicle.height_m, vehicle.local
        if height is None or local is None or vehicle.landed_state != mavlink.MAV_LANDED_STATE_IN_AIR:
            return False
        if vehicle.mode.kind == "take-off" or abs(float(local.velocity_ned_m_s[2])) > _SLOW_M_S:
            return False
        # PX4 counts from the altitude it knew at take-off, which may be off by some decimetres from the local frame.
        within = 0.5 if vehicle.mode.kind == "hold" else 0.3
        return abs(height - self._height_m) < max(within, 0.1 * self._height_m)

    def _next(self, stage: Literal["arm", "climb"], now_s: float) -> None:
        self._stage, self._stage_s = stage, now_s
        self._request = Request("arm" if stage == "arm" else "take-off")


def _because(complaint: str) -> str:
    return f": {complaint}" if complaint else ""
