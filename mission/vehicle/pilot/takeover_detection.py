"""How it shows that somebody else flies the vehicle: the pilot, a ground station, or the autopilot's failsafe."""

from __future__ import annotations

from typing import Literal

import numpy as np

from mission.records import Vector
from mission.vehicle.drone import EventKind
from mission.vehicle.state.modes import FlightMode, ModeKind
from mission.vehicle.state.vehicle_state import VehicleState

Phase = Literal["idle", "climbing", "entering", "flying", "holding", "landing"]
"""What we do with the vehicle: nothing, a take-off, taking control, flying setpoints, putting it into hold, landing."""

_ALLOWED: dict[Phase, tuple[ModeKind, ...]] = {
    "idle": (),
    "entering": ("offboard",),
    "flying": ("offboard",),
    "landing": ("land",),
}
_ELSEWHERE_M = 3.0

Takeover = tuple[EventKind, str]
"""Kind of the event, and what happened."""


def mode_takeover(phase: Phase, mode: FlightMode, vehicle: VehicleState) -> Takeover | None:
    """Whether a change to this mode was none of ours in this phase (`holding` looks at its modes by itself).

    The modes of a climb are those that `TakeOff.allows`.
    """
    if phase == "holding" or mode.kind in _ALLOWED.get(phase, ()):
        return None
    if phase == "landing" and mode.kind == "hold" and not vehicle.in_air:
        return None  # PX4 goes to Hold when it has landed.
    if vehicle.critical:
        return "failsafe", f"the autopilot's failsafe changed to {mode.name}"
    return "pilot", f"the mode was changed to {mode.name}, not by us"


def sent_elsewhere(vehicle: VehicleState, target_ned_m: Vector, since_s: float) -> Takeover | None:
    """An operator's "fly here" on ArduPilot is GUIDED, as our flying is: only the autopilot's own target shows it.

    Args:
        vehicle: what the autopilot reports.
        target_ned_m: (3,) our setpoint in the local frame.
        since_s: older reports (POSITION_TARGET_GLOBAL_INT) are from before our setpoints.
    """
    target = vehicle.position_target
    if vehicle.autopilot != "ardupilot" or target is None or vehicle.local is None or target.t_s < since_s:
        return None
    # ModeGuided::get_wp: while it follows our position and velocity setpoints ArduCopter reports no point at all.
    if not target.alone:
        there = vehicle.local_of(target.lat_deg, target.lon_deg)
        if there is None or float(np.hypot(*(there - target_ned_m[:2]))) <= _ELSEWHERE_M:
            return None
    return "pilot", "the autopilot was sent to another place (send it again: our setpoints may have replaced that)"
