"""Flight modes of PX4 and ArduCopter: what HEARTBEAT.custom_mode means and how a mode is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pymavlink.dialects.v20 import all as mavlink

Autopilot = Literal["px4", "ardupilot", "ardrone", "other"]
ModeKind = Literal["offboard", "hold", "take-off", "land", "return", "mission", "manual", "unknown"]
"""`offboard` flies setpoints from outside: OFFBOARD of PX4, GUIDED of ArduPilot."""

MULTICOPTERS = frozenset(
    {
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_TYPE_COAXIAL,
        mavlink.MAV_TYPE_HELICOPTER,
        mavlink.MAV_TYPE_HEXAROTOR,
        mavlink.MAV_TYPE_OCTOROTOR,
        mavlink.MAV_TYPE_TRICOPTER,
        mavlink.MAV_TYPE_DODECAROTOR,
        mavlink.MAV_TYPE_DECAROTOR,
    }
)
"""HEARTBEAT.type of what can hover; ArduPlane's mode numbers mean other things than ArduCopter's."""


@dataclass(frozen=True, slots=True)
class FlightMode:
    """A flight mode: what it is for, and what the autopilot calls it."""

    kind: ModeKind
    name: str
    sticks: bool = True
    """Whether moved sticks do anything, where the autopilot's parameters do not say otherwise."""


_PX4_MAIN: dict[int, FlightMode] = {
    1: FlightMode("manual", "Manual"),
    2: FlightMode("manual", "Altitude"),
    3: FlightMode("manual", "Position"),
    5: FlightMode("manual", "Acro"),
    6: FlightMode("offboard", "Offboard"),
    7: FlightMode("manual", "Stabilized"),
}
_PX4_AUTO: dict[int, FlightMode] = {
    2: FlightMode("take-off", "Takeoff"),
    3: FlightMode("hold", "Hold"),
    4: FlightMode("mission", "Mission"),
    5: FlightMode("return", "Return"),
    6: FlightMode("land", "Land"),
    8: FlightMode("mission", "Follow"),
    9: FlightMode("land", "Precision Land"),
}
_LOITER, _BRAKE = 5, 17
_COPTER: dict[int, FlightMode] = {
    0: FlightMode("manual", "STABILIZE"),
    1: FlightMode("manual", "ACRO"),
    2: FlightMode("manual", "ALT_HOLD"),
    3: FlightMode("mission", "AUTO"),
    4: FlightMode("offboard", "GUIDED"),
    5: FlightMode("hold", "LOITER"),
    6: FlightMode("return", "RTL"),
    7: FlightMode("mission", "CIRCLE"),
    9: FlightMode("land", "LAND"),
    13: FlightMode("manual", "SPORT"),
    16: FlightMode("hold", "POSHOLD"),
    17: FlightMode("hold", "BRAKE", sticks=False),
    21: FlightMode("return", "SMART_RTL"),
    23: FlightMode("mission", "FOLLOW"),
    27: FlightMode("return", "AUTO RTL"),
}


def autopilot_of(mav_autopilot: int) -> Autopilot:
    """Which of the two autopilots a HEARTBEAT.autopilot names."""
    if mav_autopilot == mavlink.MAV_AUTOPILOT_PX4:
        return "px4"
    if mav_autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return "ardupilot"
    return "other"


def flight_mode(autopilot: Autopilot, custom_mode: int) -> FlightMode:
    """The mode behind a custom_mode of HEARTBEAT or CURRENT_MODE (PX4: main in byte 2, sub in byte 3)."""
    if autopilot == "px4":
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        known = _PX4_AUTO.get(sub) if main == 4 else _PX4_MAIN.get(main)
        return known or FlightMode("unknown", f"PX4 mode {main}.{sub}")
    if autopilot == "ardupilot":
        return _COPTER.get(custom_mode) or FlightMode("unknown", f"mode {custom_mode}")
    return FlightMode("unknown", f"mode {custom_mode}")


def mode_parameters(
    autopilot: Autopilot, kind: ModeKind, attempt: int = 0, *, sticks: bool = False
) -> tuple[float, float, float]:
    """param1 to param3 of MAV_CMD_DO_SET_MODE.

    ArduPilot holds in BRAKE, which knows no sticks, or in LOITER, which would follow a throttle stick at its lower end
    to the ground. Should one be refused, every third attempt asks for the other. PX4's Hold gives way to moved sticks
    by itself (COM_RC_OVERRIDE).

    Args:
        autopilot: which one.
        kind: of the mode.
        attempt: how often it was asked for before.
        sticks: whether the sticks rest in the middle, so that a hold may be one in which they work.

    Raises:
        ValueError: this mode cannot be asked for.
    """
    flag = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    if autopilot == "px4":
        px4 = {"offboard": (6, 0), "take-off": (4, 2), "hold": (4, 3), "land": (4, 6)}
        if kind in px4:
            return flag, float(px4[kind][0]), float(px4[kind][1])
    elif autopilot == "ardupilot":
        first, other = (_LOITER, _BRAKE) if sticks else (_BRAKE, _LOITER)
        copter = {"offboard": 4, "hold": first if attempt % 3 != 2 else other, "land": 9}
        if kind in copter:
            return flag, float(copter[kind]), 0.0
    raise ValueError(f"no {kind} mode for {autopilot}")
