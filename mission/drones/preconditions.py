"""Why a vehicle may not be flown now, in words for the operator."""

from __future__ import annotations

from mission.drones.vehicle import VehicleState


def refusal(vehicle: VehicleState, min_battery_fraction: float, now_s: float, *, on_ground: bool) -> str | None:
    """The first reason not to take off (`on_ground`) or not to take control in the air; None when there is none."""
    if not vehicle.connected(now_s):
        return "the autopilot is not heard"
    if vehicle.autopilot == "other":
        return "the autopilot is neither PX4 nor ArduPilot"
    if not vehicle.multicopter:
        return "the vehicle is not a multicopter"
    if on_ground and (vehicle.armed or vehicle.in_air):
        return "the vehicle is already armed or in the air"
    if not on_ground and not vehicle.in_air:
        return "the vehicle is not armed and airborne"
    if not vehicle.position_ok(now_s):
        return "the position is not healthy (GPS fix, estimator)"
    if not vehicle.heading_ok(now_s):
        return "the heading is not healthy"
    if on_ground and vehicle.prearm_ok is False:
        return "the autopilot's checks before arming do not pass"
    battery = vehicle.battery_fraction
    if battery is not None and battery < min_battery_fraction:
        return f"the battery is at {100 * battery:.0f} %, below {100 * min_battery_fraction:.0f} %"
    if vehicle.critical:
        return f"the autopilot is in a failsafe ({vehicle.mode.name})"
    if not on_ground and vehicle.mode.kind in ("land", "return", "take-off", "unknown"):
        return f"the vehicle is in {vehicle.mode.name}"
    if not on_ground and vehicle.mode.kind == "offboard" and vehicle.autopilot == "px4":
        return "another controller is flying it in Offboard"
    return None
