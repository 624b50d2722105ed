"""Taking the vehicle and giving it back: ask for a mode until the autopilot reports it. No ack is trusted."""

from __future__ import annotations

from mission.drones.drone import OrderState
from mission.drones.flight_controls import Controls
from mission.drones.maneuvers import DONE, Outcome
from mission.drones.modes import FlightMode
from mission.drones.takeover import Takeover
from mission.drones.vehicle import VehicleState

_PATIENCE_S = 8.0
_ASK_AGAIN_S = 0.7
_CONFIRM_S = 3.0


class Entering:
    """Waits for the mode that flies setpoints after `Controls.start`, asking again when the autopilot denies it.

    PX4 denies Offboard until it has heard a setpoint: on a link that loses packets, the first one may be lost.
    """

    def __init__(self, began_s: float) -> None:
        self._began_s = self._asked_s = began_s
        self._complaint = ""

    def step(self, vehicle: VehicleState, controls: Controls, now_s: float) -> Outcome | None:
        """DONE when it is in the mode, REFUSED when it does not come to it."""
        if vehicle.mode.kind == "offboard" and vehicle.mode_s is not None and vehicle.mode_s > self._began_s:
            return DONE
        complaint = controls.complaint()
        self._complaint = complaint or self._complaint
        if now_s - self._began_s > _CONFIRM_S:
            why = f": {self._complaint}" if self._complaint else ""
            return Outcome(OrderState.REFUSED, f"the autopilot does not let us fly it{why}")
        if self._complaint and now_s - self._asked_s > _ASK_AGAIN_S:
            self._asked_s = now_s
            controls.start()
        return None


class Holding:
    """Waits for hold after `Controls.stop`, asking again.

    Args:
        before: the mode in which it was asked for.
        began_s: now.
    """

    def __init__(self, before: FlightMode, began_s: float) -> None:
        self._before = before
        self._began_s = began_s
        self._asked_s = began_s
        self._attempt = 0

    def step(self, vehicle: VehicleState, controls: Controls, now_s: float) -> Takeover | None:
        """What came of it: "mode" when it holds, "pilot" when somebody chose another mode, "failsafe" when nothing."""
        mode = vehicle.mode
        if vehicle.mode_s is not None and vehicle.mode_s > self._began_s:
            if mode.kind == "hold":
                return "mode", f"holding in {mode.name}, control given back"
            if mode.kind not in ("offboard", "take-off") and mode != self._before:
                return "pilot", f"the mode was changed to {mode.name}, not by us"
        if now_s - self._began_s > _PATIENCE_S:
            return "failsafe", f"the autopilot did not confirm to hold: it says {mode.name}"
        if now_s - self._asked_s > _ASK_AGAIN_S:
            self._asked_s = now_s
            controls.ask_mode("hold", self._attempt)
            self._attempt += 1
        return None


class Landing:
    """Asks for the landing, and waits until the vehicle is down and disarmed."""

    def __init__(self, began_s: float) -> None:
        self._began_s = began_s
        self._asked_s: float | None = None
        self._landing = False

    def step(self, vehicle: VehicleState, controls: Controls, now_s: float) -> Outcome | None:
        """How it came out, when it is over."""
        if not vehicle.armed:
            return DONE
        if vehicle.mode.kind == "land":
            self._landing = True
        if self._landing:
            # Leaving the mode in the air is a takeover; on the ground PX4 does, before HEARTBEAT says "disarmed".
            return None
        if now_s - self._began_s > _PATIENCE_S:
            return Outcome(OrderState.ENDED, "the autopilot does not land")
        if self._asked_s is None or now_s - self._asked_s > _ASK_AGAIN_S:
            self._asked_s = now_s
            controls.ask_mode("land", 0)
        return None
