"""The limits of a flight that are watched at every tick: the program's silence, the link, battery, time and room."""

from __future__ import annotations

from dataclasses import dataclass

from mission.drones.drone import Bounds, EventKind
from mission.drones.path_follower import outside
from mission.drones.vehicle import VehicleState
from mission.records import Vector


@dataclass(frozen=True, slots=True)
class FlightSettings:
    """Limits of the pilot process that are not part of an order's bounds."""

    deadman_s: float = 0.5
    """Silence of the program after which the vehicle is stopped."""
    stale_s: float = 0.6
    """Age of the local position beyond which setpoints stop: the bounds cannot be watched any more."""
    min_battery_fraction: float = 0.2
    max_yaw_rate_rad_s: float = 1.2
    measured_margin_m: float = 1.5
    """The measured position may leave the bounds by this much: overrun and the estimator's own steps."""


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """The bounds of an order, placed where control was taken."""

    bounds: Bounds
    centre_ned_m: Vector
    """(3,) in the local frame."""
    ground_down_m: float
    """Down coordinate from which heights count."""
    since_s: float
    """When control was taken."""

    def outside(self, position_ned_m: Vector, margin_m: float = 0.0) -> str | None:
        """How a position (3,) lies outside, or None."""
        return outside(position_ned_m, self.bounds, self.centre_ned_m, self.ground_down_m, margin_m)

    def left_s(self, now_s: float) -> float:
        """What is left of the time allowed."""
        return self.bounds.max_duration_s - (now_s - self.since_s)


def limit_exceeded(
    vehicle: VehicleState, settings: FlightSettings, room: Room | None, silent_s: float, now_s: float
) -> tuple[EventKind, str] | None:
    """The first limit that is exceeded, as the kind of event and its reason.

    Args:
        vehicle: what the autopilot reports.
        settings: limits.
        room: where it may be; None while the autopilot itself climbs.
        silent_s: since the program was last heard.
        now_s: program time.
    """
    battery, local = vehicle.battery_fraction, vehicle.local
    if silent_s > settings.deadman_s:
        return "deadman", f"the program was silent for {silent_s:.2f} s"
    if not vehicle.connected(now_s) or local is None or now_s - local.t_s > settings.stale_s:
        return "link-lost", "the autopilot's position is no longer received"
    if battery is not None and battery < settings.min_battery_fraction:
        return "failsafe", f"the battery is at {100 * battery:.0f} %"
    if room is None:
        return None
    if room.left_s(now_s) < 0.0:
        return "failsafe", f"the time allowed ({room.bounds.max_duration_s:.0f} s) is over"
    reason = room.outside(local.position_ned_m, settings.measured_margin_m)
    return ("failsafe", f"the vehicle left its bounds: {reason}") if reason else None
