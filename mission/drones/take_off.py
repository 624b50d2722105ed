"""Arm and climb to a height, on PX4 and on ArduPilot, each step verified by what the autopilot reports."""

from __future__ import annotations

from typing import Literal

from pymavlink.dialects.v20 import all as mavlink

from mission.drones.drone import OrderState
from mission.drones.flight_controls import Controls
from mission.drones.maneuvers import DONE, Outcome
from mission.drones.modes import ModeKind
from mission.drones.vehicle import VehicleState

_STEP_TIMEOUT_S = 8.0
_REPEAT_S = 4.0
"""The controls themselves repeat what is not acknowledged; this repeats what was acknowledged and not done."""
_SLOW_M_S = 0.25
_STEADY_S = 0.4


class TakeOff:
    """Mode, arm, climb, and wait for the height AND for IN_AIR.

    Setpoints during the climb would cut it short on both autopilots, and PX4 reports IN_AIR early. On ArduPilot the
    climb is flown in GUIDED; PX4 has a mode for it and goes to Hold at its end.

    Args:
        height_m: above the ground.
        began_s: now.
    """

    def __init__(self, height_m: float, began_s: float) -> None:
        self._height_m = height_m
        self._stage: Literal["mode", "arm", "climb"] = "mode"
        self._stage_s = began_s
        self._asked_s: float | None = None
        self._attempt = 0
        self._steady_since_s: float | None = None
        self._deadline_s = began_s + 3 * _STEP_TIMEOUT_S + 3.0 * height_m

    def step(self, vehicle: VehicleState, controls: Controls, now_s: float) -> Outcome | None:
        """Go on; DONE when it hovers at the height."""
        if self._stage == "mode":
            wanted: ModeKind = "offboard" if vehicle.autopilot == "ardupilot" else "hold"
            if vehicle.mode.kind == wanted:
                self._next("arm", now_s)
            elif self._due(now_s):
                controls.ask_mode(wanted, 0)
        if self._stage == "arm":
            if vehicle.armed:
                self._next("climb", now_s)
            elif self._due(now_s):
                controls.arm()
        if self._stage == "climb":
            return self._climb(vehicle, controls, now_s)
        if now_s - self._stage_s > _STEP_TIMEOUT_S:
            what = "change its mode for the take-off" if self._stage == "mode" else "arm"
            return Outcome(OrderState.REFUSED, f"the autopilot does not {what}{_because(controls.complaint())}")
        return None

    def _climb(self, vehicle: VehicleState, controls: Controls, now_s: float) -> Outcome | None:
        on_ground = vehicle.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
        if on_ground and vehicle.mode.kind != "take-off" and self._due(now_s):
            controls.take_off(self._height_m)
        if not vehicle.armed:
            return Outcome(OrderState.ENDED, "the vehicle was disarmed before it had taken off")
        if on_ground and now_s - self._stage_s > _STEP_TIMEOUT_S:
            return Outcome(OrderState.REFUSED, f"the vehicle does not take off{_because(controls.complaint())}")
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
            return Outcome(OrderState.ENDED, f"the climb to {self._height_m:.1f} m ended at {at}")
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
        self._stage, self._stage_s, self._asked_s = stage, now_s, None

    def _due(self, now_s: float) -> bool:
        if self._asked_s is not None and now_s - self._asked_s < _REPEAT_S:
            return False
        self._asked_s = now_s
        return True


def _because(complaint: str) -> str:
    return f": {complaint}" if complaint else ""
