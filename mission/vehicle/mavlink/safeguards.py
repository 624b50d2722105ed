"""What the autopilot guards by itself, from its parameters: its geofence, and what it does when setpoints stop.

PX4: GF_ACTION, GF_MAX_HOR_DIST, GF_MAX_VER_DIST, COM_OBL_RC_ACT, COM_RC_OVERRIDE. ArduPilot: FENCE_*; when setpoints
stop it hovers in GUIDED after GUID_TIMEOUT. Polygons and circles come over the mission protocol (`FencePlan`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.fence import Fence, FenceArea
from mission.vehicle.mavlink.fence_plan import FENCE_PLAN_MESSAGES, FencePlan
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.parameter_value import number_of
from mission.vehicle.state.modes import Autopilot
from mission.vehicle.state.vehicle_state import VehicleState

SAFEGUARD_MESSAGES = ("PARAM_VALUE", "HOME_POSITION", *FENCE_PLAN_MESSAGES)
"""Messages that `Safeguards.take` reads."""

_NAMES: dict[Autopilot, tuple[str, ...]] = {
    "px4": ("COM_OBL_RC_ACT", "COM_RC_OVERRIDE", "GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"),
    "ardupilot": (
        *("FENCE_ENABLE", "FENCE_TYPE", "FENCE_RADIUS", "FENCE_ALT_MAX", "FENCE_ALT_MIN"),
        *("FENCE_AUTOENABLE", "FENCE_OPTIONS", "GUID_TIMEOUT", "RCMAP_THROTTLE"),
    ),
}
_ASK_AGAIN_S = 0.4
_ATTEMPTS = 10
_OPTIONAL = ("COM_RC_OVERRIDE", "FENCE_AUTOENABLE", "FENCE_OPTIONS", "RCMAP_THROTTLE")
"""Not every version has them: asked for a few times."""
_CHANNELS = range(1, 19)
_OPTIONAL_ATTEMPTS = 3
_HOLD = 5
_STOPS_THE_MOTORS = (6, 7)
_WHEN_SETPOINTS_STOP = {
    0: "changes to Position, and without a remote control sinks to the ground while it drifts",
    1: "changes to Altitude, and without a remote control sinks to the ground while it drifts",
    2: "changes to manual flight, and without a remote control sinks to the ground while it drifts",
    3: "returns to its home",
    4: "lands",
    6: "terminates the flight",
    7: "stops its motors",
}
_LONGEST_GUIDED_S = 5.0
_OVERRIDES_HOLD = 1
"""Bit of COM_RC_OVERRIDE: moved sticks take the vehicle from the automatic modes to Position."""
_FENCE_CEILING, _FENCE_CIRCLE, _FENCE_PLAN, _FENCE_FLOOR = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""
_FENCE_TYPE_DEFAULT = 7.0
_ANY_INCLUSION = 2
"""Bit of FENCE_OPTIONS: inside one of the areas is enough. PX4 always does so."""


class Safeguards:
    """The autopilot's own limits and reactions, asked for until they are known or have stayed unanswered.

    Args:
        vehicle: what the autopilot reports.
    """

    def __init__(self, vehicle: VehicleState) -> None:
        self._vehicle = vehicle
        self._plan = FencePlan()
        self._values: dict[str, float] = {}
        self._home_deg: tuple[float, float] | None = None
        self._attempts = 0
        self._asked_s = -math.inf

    @property
    def known(self) -> bool:
        """Whether every parameter and the fence plan were told, or asked for often enough."""
        wanted = [name for name in self._missing() if not (name in _OPTIONAL and self._attempts >= _OPTIONAL_ATTEMPTS)]
        told = not wanted or self._attempts >= _ATTEMPTS
        return self._vehicle.autopilot in _NAMES and told and self._plan.known

    def take(self, message: Any) -> None:
        """Take in one of `SAFEGUARD_MESSAGES`, of the autopilot; called in the link's thread."""
        if message.get_srcSystem() != self._vehicle.system or message.get_srcComponent() != 1:
            return
        if message.get_type() == "HOME_POSITION":
            if message.latitude or message.longitude:
                self._home_deg = message.latitude * 1e-7, message.longitude * 1e-7
            return
        if message.get_type() in FENCE_PLAN_MESSAGES:
            self._plan.take(message)
            return
        value = number_of(message, self._vehicle.autopilot)
        if value is not None and message.param_id in _NAMES.get(self._vehicle.autopilot, ()):
            self._values[message.param_id] = value
            if message.param_id == "RCMAP_THROTTLE" and value in _CHANNELS:
                self._vehicle.sticks.throttle_channel = int(value)

    def ask(self, link: MavlinkLink, now_s: float) -> None:
        """Ask for what is not known yet; called at every tick, never waits."""
        if not self._vehicle.connected(now_s):
            return
        self._plan.ask(link, now_s)
        if not self._missing() or self._attempts >= _ATTEMPTS or now_s - self._asked_s < _ASK_AGAIN_S:
            return
        self._asked_s, self._attempts = now_s, self._attempts + 1
        for name in self._missing():
            link.send(
                mavlink.MAVLink_param_request_read_message(link.target_system, link.target_component, name.encode(), -1)
            )

    def order_begins(self) -> None:
        """Read the fence plan again, which a ground station may have changed since, and what was never answered."""
        self._plan.refresh()
        if not set(self._missing()) <= set(_OPTIONAL):
            self._attempts = min(self._attempts, _ATTEMPTS - _OPTIONAL_ATTEMPTS)

    def fence(self) -> Fence | None:
        """The geofence in the local frame; None when there is none, or no place for it yet."""
        local = self._vehicle.local
        radius, low, high = self._cylinder()
        areas = self._areas()
        limited = math.isfinite(radius) or math.isfinite(low) or math.isfinite(high) or bool(areas)
        if not limited or local is None:
            return None
        centre = local.position_ned_m[:2].copy()
        if math.isfinite(radius):
            if self._home_deg is None:
                return None
            home = self._vehicle.local_of(*self._home_deg)
            if home is None:
                return None
            centre = home
        any_inclusion = self._vehicle.autopilot == "px4" or bool(
            int(self._values.get("FENCE_OPTIONS", 0.0)) & _ANY_INCLUSION
        )
        return Fence(centre, radius, low, high, areas, any_inclusion)

    def refusal(self, must_hold: bool) -> str | None:
        """Why the autopilot's own reactions forbid a flight, or None.

        Args:
            must_hold: anything but holding still when the setpoints stop is a reason.
        """
        if not self.known:
            return "the autopilot's geofence and failsafes are not known yet"
        action = self._values.get("COM_OBL_RC_ACT")
        if action in _STOPS_THE_MOTORS:
            return (
                f"PX4 {_WHEN_SETPOINTS_STOP[int(action)]} when setpoints stop (COM_OBL_RC_ACT is {action:.0f}): set "
                "it to 5 (Hold)"
            )
        if must_hold and self._vehicle.autopilot == "px4" and action != _HOLD:
            return (
                f"should the pilot process die, PX4 {_instead_of_holding(action)}: set COM_OBL_RC_ACT to 5 (Hold), or "
                "accept that with link.accept_failsafe"
            )
        if self._plan_counts() and self._plan.trouble:
            return f"the autopilot's geofence cannot be checked: {self._plan.trouble}"
        if math.isfinite(self._cylinder()[0]) and self._home_deg is None:
            return "the centre of the geofence is not known: the autopilot tells no home position"
        return None

    def cautions(self) -> list[str]:
        """What the operator should know before the flight, once `known`."""
        values, notes = self._values, []
        if self._vehicle.autopilot == "px4":
            action = values.get("COM_OBL_RC_ACT")
            if action is None:
                notes.append("PX4 does not tell what it does when setpoints stop (COM_OBL_RC_ACT)")
            elif action != _HOLD:
                notes.append(f"should the pilot process die, PX4 {_instead_of_holding(action)}")
            if "COM_RC_OVERRIDE" in values and not int(values["COM_RC_OVERRIDE"]) & _OVERRIDES_HOLD:
                notes.append("in Hold the sticks do nothing (COM_RC_OVERRIDE): change the mode to fly by hand")
        elif values.get("GUID_TIMEOUT", 0.0) > _LONGEST_GUIDED_S:
            notes.append(f"should the pilot process die, it flies on for {values['GUID_TIMEOUT']:.0f} s (GUID_TIMEOUT)")
        if not {"GF_ACTION", "FENCE_ENABLE"} & values.keys():
            notes.append("the autopilot does not tell its geofence: it is not checked before the flight")
        elif self._plan_counts() and self._plan.silent:
            notes.append("the autopilot does not tell its fence plan: polygons and circles are not checked")
        return notes

    def _cylinder(self) -> tuple[float, float, float]:
        """Radius, lowest and highest height above home, infinite where there is no limit."""
        values = self._values
        if self._vehicle.autopilot == "px4":
            if not self._fence_on():
                return math.inf, -math.inf, math.inf
            radius, high = values.get("GF_MAX_HOR_DIST", 0.0), values.get("GF_MAX_VER_DIST", 0.0)
            return radius if radius > 0.0 else math.inf, -math.inf, high if high > 0.0 else math.inf
        if not self._fence_on():
            return math.inf, -math.inf, math.inf
        kind = self._fence_type()
        return (
            values.get("FENCE_RADIUS", math.inf) if kind & _FENCE_CIRCLE else math.inf,
            values.get("FENCE_ALT_MIN", -math.inf) if kind & _FENCE_FLOOR else -math.inf,
            values.get("FENCE_ALT_MAX", math.inf) if kind & _FENCE_CEILING else math.inf,
        )

    def _areas(self) -> tuple[FenceArea, ...]:
        if not self._plan_counts():
            return ()
        areas = []
        for planned in self._plan.areas:
            corners = [self._vehicle.local_of(*corner) for corner in planned.corners_deg]
            known = [corner for corner in corners if corner is not None]
            if len(known) == len(corners):
                areas.append(FenceArea(planned.inclusion, np.array(known), planned.radius_m))
        return tuple(areas)

    def _fence_on(self) -> bool:
        """Whether the autopilot enforces its geofence, or will once it is armed."""
        values, told = self._values, self._vehicle.fence_active
        if self._vehicle.autopilot == "px4":
            return values.get("GF_ACTION", 0.0) != 0.0
        if not self._vehicle.armed and values.get("FENCE_AUTOENABLE"):
            return True
        # A switch or DO_FENCE_ENABLE do not show in FENCE_ENABLE.
        return bool(values.get("FENCE_ENABLE")) if told is None else told

    def _plan_counts(self) -> bool:
        return self._fence_on() and (self._vehicle.autopilot == "px4" or bool(self._fence_type() & _FENCE_PLAN))

    def _fence_type(self) -> int:
        return int(self._values.get("FENCE_TYPE", _FENCE_TYPE_DEFAULT))

    def _missing(self) -> Iterable[str]:
        return [name for name in _NAMES.get(self._vehicle.autopilot, ()) if name not in self._values]


def _instead_of_holding(action: float | None) -> str:
    if action is None:
        return "does what it does not tell (COM_OBL_RC_ACT is not known)"
    return f"{_WHEN_SETPOINTS_STOP.get(int(action), 'does something unknown')} (COM_OBL_RC_ACT is {action:.0f})"
