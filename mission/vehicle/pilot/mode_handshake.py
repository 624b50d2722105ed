"""Taking the vehicle and giving it back: order a mode until the autopilot reports it. No ack is trusted to mean yes.

What we did not change is not changed back: hold is ordered only while the autopilot reports a mode of ours.
"""

from __future__ import annotations

from typing import Final

from mission.vehicle.drone import OrderState
from mission.vehicle.pilot.controls import Controls
from mission.vehicle.pilot.maneuvers import DONE, ManeuverOutcome
from mission.vehicle.pilot.request import Request
from mission.vehicle.pilot.takeover_detection import Phase, Takeover
from mission.vehicle.state.modes import FlightMode, ModeKind
from mission.vehicle.state.vehicle_state import VehicleState

_PATIENCE_S = 8.0
_ASK_AGAIN_S = 0.7
_CONFIRM_S = 3.0
"""The longer patience holds on a link that loses packets: there an order is repeated at the pace of heartbeats."""
_ON_ITS_WAY_S = 0.3
"""A report that comes sooner after an order may have left the autopilot before it."""
_LATE_S = 1.5
"""An order that may still be on its way when we give up is awaited for this long."""

OURS: Final[dict[Phase, tuple[ModeKind, ...]]] = {
    "climbing": ("take-off", "offboard"),
    "entering": ("offboard",),
    "flying": ("offboard",),
    "landing": ("land",),
}
"""The modes in which the vehicle is by our order, in each phase."""


class Entering:
    """Orders the mode that flies setpoints, and waits for it.

    PX4 denies Offboard until it has heard a setpoint: on a link that loses packets, the first one may be lost.

    Args:
        before: the mode in which the vehicle is; one that flies setpoints already is not ordered again.
        began_s: now.
    """

    def __init__(self, before: FlightMode, began_s: float) -> None:
        self._before = before
        self._began_s = began_s
        self._request = Request("mode")
        self._complaint = ""

    def step(self, vehicle: VehicleState, controls: Controls, now_s: float) -> ManeuverOutcome | None:
        """DONE when it is in the mode, REFUSED when it does not come to it."""
        if vehicle.mode.kind == "offboard" and vehicle.mode_s is not None and vehicle.mode_s > self._began_s:
            return DONE
        self._complaint = controls.complaint() or self._complaint
        lossy = controls.answer("mode", now_s) == "lossy"
        if now_s - self._began_s > (_PATIENCE_S if lossy else _CONFIRM_S):
            why = f": {self._complaint}" if self._complaint else ": it does not answer"
            return ManeuverOutcome(OrderState.REFUSED, f"the autopilot does not let us fly it{why}")
        if vehicle.mode == self._before and self._before.kind != "offboard":
            attempt = self._request.due(controls, now_s, vehicle.mode_s)
            if attempt is not None:
                controls.ask_mode("offboard", attempt)
        return None


class Holding:
    """Orders hold for as long as the autopilot reports a mode of ours, and waits for another one.

    Args:
        phase: what we did with the vehicle.
        before: the mode in which it is.
        began_s: now.
    """

    def __init__(self, phase: Phase, before: FlightMode, began_s: float) -> None:
        self._ours = OURS.get(phase, ())
        self._before = before
        self._began_s = began_s
        self._asked_s: float | None = None
        self._attempt = 0

    def step(self, vehicle: VehicleState, controls: Controls, now_s: float) -> Takeover | None:
        """What came of it: "mode" when it is given back, "pilot" when somebody took it, "failsafe" when nothing."""
        mode = vehicle.mode
        if not vehicle.armed:
            return "mode", "it is disarmed"
        if mode.kind in self._ours:
            if now_s - self._began_s > _PATIENCE_S:
                return "failsafe", f"the autopilot did not confirm to hold: it says {mode.name}"
            self._ask(vehicle, controls, now_s)
        elif vehicle.mode_s is not None and vehicle.mode_s > self._began_s:
            if mode.kind != "hold" and mode != self._before:
                return "pilot", f"the mode was changed to {mode.name}, not by us"
            if self._asked_s is not None:
                sticks = "" if mode.sticks else "; sticks do nothing in it: change the mode to fly by hand"
                return "mode", f"holding in {mode.name}, control given back{sticks}"
            if now_s - self._began_s > _LATE_S:
                return "mode", f"it stays in {mode.name}"
        elif now_s - self._began_s > _PATIENCE_S:
            return "failsafe", f"the autopilot does not tell its mode: the last one was {mode.name}"
        return None

    def _ask(self, vehicle: VehicleState, controls: Controls, now_s: float) -> None:
        if self._asked_s is not None:
            told = vehicle.mode_s is not None and vehicle.mode_s - self._asked_s > _ON_ITS_WAY_S
            if not told or now_s - self._asked_s < _ASK_AGAIN_S:
                return
        self._asked_s = now_s
        controls.ask_mode("hold", self._attempt)
        self._attempt += 1


class Landing:
    """Orders the landing, and waits until the vehicle is down and disarmed.

    Args:
        before: the mode in which it is.
        began_s: now.
    """

    def __init__(self, before: FlightMode, began_s: float) -> None:
        self._before = before
        self._began_s = began_s
        self._request = Request("mode")
        self._landing = False

    def step(self, vehicle: VehicleState, controls: Controls, now_s: float) -> ManeuverOutcome | None:
        """How it came out, when it is over."""
        if not vehicle.armed:
            return DONE
        if vehicle.mode.kind == "land":
            self._landing = True
        if self._landing:
            # Leaving the mode in the air is a takeover; on the ground PX4 does, before HEARTBEAT says "disarmed".
            return None
        if now_s - self._began_s > _PATIENCE_S:
            return ManeuverOutcome(OrderState.ENDED, "the autopilot does not land")
        if vehicle.mode == self._before:
            attempt = self._request.due(controls, now_s, vehicle.mode_s)
            if attempt is not None:
                controls.ask_mode("land", attempt)
        return None
