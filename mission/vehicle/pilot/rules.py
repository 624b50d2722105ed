"""The pilot's rules: who may fly, when it ends, and what is ordered then. Pure: time, vehicle and controls come in."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mission.vehicle.drone import Bounds, EventKind, OrderState
from mission.vehicle.limits import FlightSettings, Room, limit_exceeded, with_loss
from mission.vehicle.path_follower import Setpoint
from mission.vehicle.pilot.controls import Controls
from mission.vehicle.pilot.maneuvers import FollowPath, Guidance, Maneuver, StandStill, TurnManeuver
from mission.vehicle.pilot.mode_handshake import OURS, Entering, Holding, Landing
from mission.vehicle.pilot.motion_watch import MotionWatch
from mission.vehicle.pilot.preconditions import Guards, NoGuards, height_refusal, refusal
from mission.vehicle.pilot.protocol import EventReport, FlyOrder, OrderReport
from mission.vehicle.pilot.take_off import TakeOff
from mission.vehicle.pilot.takeover_detection import Phase, Takeover, mode_takeover, sent_elsewhere
from mission.vehicle.state.vehicle_state import VehicleState

_SETPOINT_S = 0.03
"""Every second tick. Not faster: on ArduPilot each setpoint replaces an operator's "fly here", which only shows in the
autopilot's own target, reported every 20 ms, until the next setpoint."""
_RIVAL_MEMORY_S = 2.0
_TARGET_SETTLES_S = 1.0
"""ArduPilot's report of its target may be from before our setpoints for this long."""


class FlightRules:
    """One vehicle's flying by our orders, from the operator's permission to hold.

    `begin` gives a permission to take control once. It ends with hold (then `land` is still possible), and entirely
    when somebody else takes the vehicle: from then on nothing is sent until the next `begin`.

    Args:
        controls: what flies.
        vehicle: what the autopilot reports.
        settings: limits.
        report: called with what the program should know.
        guards: what is known of the vehicle beyond its state.
    """

    def __init__(
        self,
        controls: Controls,
        vehicle: VehicleState,
        settings: FlightSettings,
        report: Callable[[OrderReport | EventReport], None],
        guards: Guards | None = None,
    ) -> None:
        self.phase: Phase = "idle"
        self._controls = controls
        self._vehicle = vehicle
        self._settings = settings
        self._report = report
        self._guards = guards or NoGuards()
        self._guidance = Guidance(vehicle, settings.max_yaw_rate_rad_s)
        self._bounds = Bounds()
        self._permitted = False
        self._control_taken = False
        self._heard_s = -math.inf
        self._order: FlyOrder | None = None
        self._maneuver: Maneuver | None = None
        self._take_off: TakeOff | None = None
        self._room = Room(self._bounds, np.zeros(3), 0.0, 0.0)
        self._phase_s = self._sent_s = 0.0
        self._holding = Holding("idle", vehicle.mode, 0.0)
        self._landing, self._entering = Landing(vehicle.mode, 0.0), Entering(vehicle.mode, 0.0)
        self._watch = MotionWatch(settings, 0.0)
        self._rival: tuple[float, str] | None = None
        self._rival_told = False

    def heard(self, now_s: float) -> None:
        """The program is alive."""
        self._heard_s = now_s

    def begin(self, bounds: Bounds, now_s: float) -> None:
        """The operator permits to take control once."""
        if self.phase in ("flying", "entering", "climbing"):
            self._event(now_s, "refused", "a new order by the operator while the last one is still flown: hold first")
            return
        self._bounds, self._permitted, self._control_taken = bounds, True, False
        self._vehicle.take_mode_changes()

    def aim(self, heading_rad: float) -> None:
        """The heading to keep."""
        self._guidance.aim_rad = heading_rad

    def order(self, order: FlyOrder, now_s: float) -> None:
        """Take an order; an earlier one that is not final ends."""
        self._end_order(now_s, OrderState.ENDED, f"replaced by the order to {order.kind}")
        self._order = order
        reason = self._accept(order, now_s)
        if reason:
            self._event(now_s, "refused", reason)
            self._end_order(now_s, OrderState.REFUSED, reason)

    def _accept(self, order: FlyOrder, now_s: float) -> str | None:
        if order.kind == "hold":
            self._order_hold(now_s)
            return None
        if not self._permitted:
            return "no order by the operator permits to fly: begin is needed first"
        if order.kind == "take-off":
            return self._accept_take_off(order, now_s)
        if order.kind == "land":
            return self._accept_land(now_s)
        if self.phase not in ("flying", "entering"):
            reason = self._take_control(now_s)
            if reason:
                return reason
        return self._set_maneuver(order, now_s) if self.phase == "flying" else None

    def _accept_take_off(self, order: FlyOrder, now_s: float) -> str | None:
        height = order.height_m
        if self.phase != "idle" or self._control_taken:
            return "a take-off is only flown from the ground, at the start of an order"
        if height is None:
            return "the order has no height"
        fence, margin_m = self._guards.fence(), self._settings.fence_margin_m
        reason = height_refusal(height, self._bounds, fence, margin_m, self._vehicle) or refusal(
            self._vehicle, self._settings, self._guards, now_s, on_ground=True
        )
        if reason is None:
            self._watch, self._rival_told = MotionWatch(self._settings, now_s), False
            self._take_off = TakeOff(height, self._vehicle.autopilot, self._vehicle.mode, now_s)
            self._enter("climbing", now_s)
            self._flying(now_s)
        return reason

    def _accept_land(self, now_s: float) -> str | None:
        if not self._vehicle.in_air:
            return "the vehicle is not in the air"
        if self.phase == "holding":
            return "the vehicle is being put into hold; land after that"
        self._controls.release()
        self._maneuver, self._landing = None, Landing(self._vehicle.mode, now_s)
        self._enter("landing", now_s)
        self._flying(now_s)
        return None

    def _take_control(self, now_s: float) -> str | None:
        if self._control_taken:
            return "control was given back: begin is needed to take it again"
        if self.phase != "idle":
            return with_loss(f"the vehicle is {self.phase}", self._guards.packet_loss(now_s), self._settings)
        vehicle = self._vehicle
        reason = refusal(vehicle, self._settings, self._guards, now_s, on_ground=False)
        if reason is None and self._rival is not None and now_s - self._rival[0] < _RIVAL_MEMORY_S:
            reason = f"another controller is flying it: {self._rival[1]}"
        if reason is not None:
            return reason
        local, height = self._guidance.local, vehicle.height_m
        if height is None:
            return "the height above the take-off point is not known"
        here = local.position_ned_m.copy()
        fence, margin_m = self._guards.fence(), self._settings.fence_margin_m
        self._room = Room(self._bounds, here, float(here[2]) + height, now_s, fence, margin_m)
        reason = self._room.outside(here)
        if reason:
            return f"the vehicle is outside the allowed room: {reason}"
        self._guidance.target = Setpoint(np.full(3, math.inf), np.zeros(3))
        self._guidance.stop_here(self._room)
        self._guidance.start(now_s)
        vehicle.take_mode_changes()
        self._controls.complaint()
        self._send_setpoint(now_s)
        self._entering = Entering(vehicle.mode, now_s)
        self._watch, self._rival_told = MotionWatch(self._settings, now_s), False
        self._control_taken = True
        self._enter("entering", now_s)
        return None

    def _set_maneuver(self, order: FlyOrder, now_s: float) -> str | None:
        guidance = self._guidance
        if order.kind == "path":
            if order.path is None:
                return "the order has no path"
            rest = float(np.linalg.norm(guidance.target.velocity_ned_m_s)) == 0.0
            start = guidance.target.position_ned_m if rest else guidance.local.position_ned_m
            reason = self._room.refuses(order.path, start, now_s)
            if reason:
                self._set_still(now_s)
                return reason
            self._maneuver = FollowPath(order.path, start, now_s)
        else:
            if order.kind == "turn" and (order.heading_rad is None or not math.isfinite(order.heading_rad)):
                return "the order has no heading"
            self._set_still(now_s)
            if order.kind == "turn" and order.heading_rad is not None:
                self._maneuver = TurnManeuver(order.heading_rad)
        self._flying(now_s)
        return None

    def _set_still(self, now_s: float) -> None:
        self._guidance.stop_here(self._room)
        self._maneuver = StandStill(now_s)

    def _order_hold(self, now_s: float) -> None:
        if self.phase in ("entering", "flying", "climbing", "landing"):
            self._hold(now_s)
            self._flying(now_s)
        elif self.phase == "idle":
            self._flying(now_s)
            self._end_order(now_s, OrderState.DONE, "the vehicle was not under our control")

    def step(self, now_s: float) -> None:
        """Look at everything once; called at 50 Hz."""
        self._watch_modes(now_s)
        if self.phase in ("entering", "flying", "climbing"):
            room = self._room if self.phase == "flying" else None
            loss, silent_s = self._guards.packet_loss(now_s), now_s - self._heard_s
            exceeded = limit_exceeded(self._vehicle, self._settings, room, silent_s, now_s, loss)
            astray = exceeded or self._astray(now_s)
            if astray is not None:
                self.stop(*astray, now_s)
        if self.phase == "climbing":
            self._step_climb(now_s)
        elif self.phase == "entering":
            self._step_entering(now_s)
        elif self.phase == "flying":
            self._step_flying(now_s)
        elif self.phase == "holding":
            self._step_holding(now_s)
        elif self.phase == "landing":
            self._step_landing(now_s)

    def _astray(self, now_s: float) -> Takeover | None:
        """What is wrong with the reported pose, or with how the vehicle follows us."""
        reason = self._watch.fault(self._vehicle, now_s)
        if reason is None and self.phase == "flying":
            target, limit_m_s = self._guidance.target, self._bounds.max_speed_m_s
            reason = self._watch.step(self._vehicle, target, limit_m_s, now_s)
        if reason is None:
            return None
        rival = self._rival
        beside = f" ({rival[1]})" if rival is not None and now_s - rival[0] < _RIVAL_MEMORY_S else ""
        return "failsafe", reason + beside

    def rival(self, text: str, now_s: float, *, obeyed: bool = False) -> None:
        """Somebody else's setpoint or "fly here" was seen on the link.

        Seen is not obeyed: a packet alone ends nothing. The vehicle is given up when its mode or its target changes, or
        when it acknowledges the other one (`obeyed`); it is put into hold when it does not fly as we say.
        """
        self._rival = (now_s, text)
        if self.phase not in ("entering", "flying", "climbing"):
            return
        if obeyed:
            self._taken_over(now_s, "pilot", f"{text}, and the autopilot obeys it")
        elif not self._rival_told:
            self._rival_told = True
            self._event(now_s, "caution", f"{text}; we fly on while the vehicle follows us")

    def stop(self, kind: EventKind, reason: str, now_s: float) -> None:
        """End what is flown by us and put the vehicle into hold; nothing when it is not flown by us."""
        if self.phase in ("entering", "flying", "climbing"):
            self._event(now_s, kind, f"{reason}; holding")
            self._end_order(now_s, OrderState.ENDED, reason)
            self._hold(now_s)

    def _watch_modes(self, now_s: float) -> None:
        vehicle = self._vehicle
        for t_s, mode in vehicle.take_mode_changes():
            if self.phase == "climbing" and self._take_off and self._take_off.allows(mode, vehicle.height_m):
                continue
            taken = mode_takeover(self.phase, mode, vehicle) if self._permitted else None
            if taken is not None:
                self._taken_over(t_s, *taken)
        if self.phase != "flying":
            return
        if vehicle.mode.kind != "offboard":
            taken = mode_takeover(self.phase, vehicle.mode, vehicle)
        elif not vehicle.armed:
            taken = "failsafe", "the vehicle was disarmed"
        else:
            since_s = self._room.since_s + _TARGET_SETTLES_S
            taken = sent_elsewhere(vehicle, self._guidance.target.position_ned_m, since_s)
        if taken is not None:
            self._taken_over(now_s, *taken)

    def _taken_over(self, t_s: float, kind: EventKind, reason: str) -> None:
        self._controls.release()
        self._permitted = False
        self._maneuver = self._take_off = None
        self.phase = "idle"
        self._event(t_s, kind, reason)
        self._end_order(t_s, OrderState.ENDED, reason)

    def _step_climb(self, now_s: float) -> None:
        outcome = None if self._take_off is None else self._take_off.step(self._vehicle, self._controls, now_s)
        if outcome is None:
            return
        self._take_off = None
        if not self._vehicle.armed and outcome.state is OrderState.ENDED:
            self._taken_over(now_s, "failsafe", outcome.reason)
            return
        if outcome.state is OrderState.ENDED:
            self.stop("failsafe", outcome.reason, now_s)
            return
        self.phase = "idle"
        self._vehicle.take_mode_changes()
        if outcome.state is OrderState.REFUSED:
            self._event(now_s, "refused", outcome.reason)
        self._end_order(now_s, outcome.state, outcome.reason)

    def _step_entering(self, now_s: float) -> None:
        vehicle = self._vehicle
        self._send_setpoint(now_s)
        outcome = self._entering.step(vehicle, self._controls, now_s)
        if outcome is None:
            return
        order, reason = self._order, None
        if outcome.state is OrderState.DONE:
            self._event(now_s, "mode", f"we fly it, in {vehicle.mode.name}")
            self._enter("flying", now_s)
            vehicle.take_mode_changes()
            reason = self._set_maneuver(order, now_s) if order is not None else None
            if order is None:
                self._set_still(now_s)
        else:
            reason = with_loss(outcome.reason, self._guards.packet_loss(now_s), self._settings)
        if reason:
            self._event(now_s, "refused", reason)
            self._end_order(now_s, OrderState.REFUSED, reason)
        if outcome.state is OrderState.REFUSED:
            # The order may still be on its way: it is undone if it is carried out after all.
            self._hold(now_s)

    def _step_flying(self, now_s: float) -> None:
        outcome = None if self._maneuver is None else self._maneuver.step(self._guidance, now_s)
        self._guidance.slew(now_s)
        reason = self._room.outside(self._guidance.target.position_ned_m)
        if reason:
            self.stop("failsafe", f"the setpoint would leave the bounds: {reason}", now_s)
            return
        self._send_setpoint(now_s)
        if outcome is not None:
            self._maneuver = None
            self._end_order(now_s, outcome.state, outcome.reason)

    def _send_setpoint(self, now_s: float) -> None:
        if now_s - self._sent_s > _SETPOINT_S:
            self._sent_s = now_s
            self._controls.setpoint(self._guidance.target, self._guidance.yaw_rad)

    def _hold(self, now_s: float) -> None:
        """Stop the setpoints and give the vehicle back: to hold, when it is in a mode of ours."""
        self._maneuver = self._take_off = None
        self._controls.release()
        self._holding = Holding(self.phase, self._vehicle.mode, now_s)
        self._enter("holding", now_s)
        self._holding.step(self._vehicle, self._controls, now_s)

    def order_hold_once(self) -> None:
        """Order hold if the vehicle is in a mode of ours; for the moment before this process ends, from any thread."""
        if self._vehicle.mode.kind in OURS.get(self.phase, ()):
            self._controls.ask_mode("hold", 0)

    def _step_holding(self, now_s: float) -> None:
        came = self._holding.step(self._vehicle, self._controls, now_s)
        if came is None:
            return
        self.phase, (kind, text) = "idle", came
        text = with_loss(text, self._guards.packet_loss(now_s), self._settings) if kind == "failsafe" else text
        self._permitted = self._permitted and kind == "mode"
        self._vehicle.take_mode_changes()
        self._event(now_s, kind, text)
        self._end_order(now_s, OrderState.ENDED if kind == "failsafe" else OrderState.DONE, text)

    def _step_landing(self, now_s: float) -> None:
        outcome = self._landing.step(self._vehicle, self._controls, now_s)
        if outcome is not None:
            self.phase = "idle"
            self._permitted = False
            self._end_order(now_s, outcome.state, outcome.reason)

    def _enter(self, phase: Phase, now_s: float) -> None:
        self.phase, self._phase_s = phase, now_s

    def _flying(self, now_s: float) -> None:
        if self._order is not None:
            self._report(OrderReport(id=self._order.id, state=OrderState.FLYING, t_s=now_s))

    def _end_order(self, now_s: float, state: OrderState, reason: str) -> None:
        if self._order is not None:
            self._report(OrderReport(id=self._order.id, state=state, reason=reason, t_s=now_s))
            self._order = None

    def _event(self, t_s: float, kind: EventKind, text: str) -> None:
        self._report(EventReport(t_s=t_s, kind=kind, text=text))
