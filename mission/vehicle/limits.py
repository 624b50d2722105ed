"""The limits of a flight that are watched at every tick: the program's silence, the link, battery, time and room."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mission.records import Vector
from mission.vehicle.drone import Bounds, EventKind, Path
from mission.vehicle.fence import Fence
from mission.vehicle.path_follower import check_path, outside, setpoint_at
from mission.vehicle.state.vehicle_state import VehicleState

_CHECK_STEP_S = 0.02
COMPASS_SIGMA_RAD = math.radians(4.0)
"""Constant error of a heading that stands on a magnetometer: compass calibration, declination, currents of the motors.
Autopilots report none; several degrees are usual, ten are met."""


@dataclass(frozen=True, slots=True)
class FlightSettings:
    """Limits of the pilot process that are not part of an order's bounds."""

    deadman_s: float = 0.47
    """Silence of the program after which the vehicle is stopped: with a tick, hold is ordered within 0.5 s."""
    stale_s: float = 0.6
    """Age of the local position beyond which setpoints stop: the bounds cannot be watched any more."""
    min_battery_fraction: float = 0.2
    max_yaw_rate_rad_s: float = 1.2
    speed_margin_m_s: float = 1.0
    """The measured speed may exceed the allowed one by this much: overshoot, and what a hover in wind wanders at."""
    max_step_m: float = 0.8
    """The position may differ from what its own velocity explains by this much within half a second."""
    max_turn_rad: float = math.radians(8.0)
    """The heading may differ from what its own rate explains by this much within half a second."""
    max_tracking_error_m: float = 1.5
    """The vehicle may be this far from where its setpoints of the last second were."""
    measured_margin_m: float = 1.5
    """The measured position may leave the bounds by this much: overrun and the estimator's own steps."""
    fence_margin_m: float = 2.0
    """Setpoints stay this far inside the autopilot's geofence: its overrun after a stop is 1 to 2 m."""
    max_packet_loss: float = 0.3
    """Of what the autopilot sends; beyond, a take-over may be seen too late."""
    release: Literal["sticks", "hold"] = "sticks"
    """The mode in which control is given back on ArduPilot: one in which the pilot's sticks work (LOITER) where the
    throttle stick rests in the middle, or always one without sticks (BRAKE)."""
    compass_sigma_rad: float = COMPASS_SIGMA_RAD
    """Standard deviation of the constant error of the autopilot's heading."""
    must_hold: bool = True
    """No flight when the autopilot would do anything but hold after our setpoints have stopped."""


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
    fence: Fence | None = None
    fence_margin_m: float = 0.0

    def outside(self, position_ned_m: Vector, margin_m: float = 0.0) -> str | None:
        """How a position (3,) lies outside the bounds, widened by a margin, or outside the geofence; None inside."""
        reason = outside(position_ned_m, self.bounds, self.centre_ned_m, self.ground_down_m, margin_m)
        if reason is None and self.fence is not None:
            keep_m = max(0.0, self.fence_margin_m - margin_m)
            reason = self.fence.outside(position_ned_m, self.ground_down_m, keep_m)
        return reason

    def refuses(self, path: Path, start_ned_m: Vector, now_s: float) -> str | None:
        """Why a path from a start (3,) may not be flown: bounds, time or geofence; None when it may."""
        reason = check_path(path, self.bounds, start_ned_m, self.centre_ned_m, self.ground_down_m, self.left_s(now_s))
        if reason or self.fence is None:
            return reason
        steps = [min(i * _CHECK_STEP_S, path.duration_s) for i in range(math.ceil(path.duration_s / _CHECK_STEP_S) + 1)]
        places = np.array([setpoint_at(path, t_s, start_ned_m).position_ned_m for t_s in steps])
        reason = self.fence.first_outside(places, self.ground_down_m, self.fence_margin_m)
        return f"the path would leave the geofence: {reason}" if reason else None

    def left_s(self, now_s: float) -> float:
        """What is left of the time allowed."""
        return self.bounds.max_duration_s - (now_s - self.since_s)


def limit_exceeded(
    vehicle: VehicleState,
    settings: FlightSettings,
    room: Room | None,
    silent_s: float,
    now_s: float,
    packet_loss: float | None = None,
) -> tuple[EventKind, str] | None:
    """The first limit that is exceeded, as the kind of event and its reason.

    Args:
        vehicle: what the autopilot reports.
        settings: limits.
        room: where it may be; None while the autopilot itself climbs.
        silent_s: since the program was last heard.
        now_s: program time.
        packet_loss: fraction of the autopilot's packets that do not arrive; None when that is not known.
    """
    battery, local = vehicle.battery_fraction, vehicle.local
    if silent_s > settings.deadman_s:
        return "deadman", f"the program was silent for {silent_s:.2f} s"
    if not vehicle.connected(now_s) or local is None or now_s - local.t_s > settings.stale_s:
        if vehicle.stands_still(now_s):
            return "failsafe", "the autopilot's reports come, but stand still"
        return "link-lost", with_loss("the autopilot's position is no longer received", packet_loss, settings)
    if packet_loss is not None and packet_loss > settings.max_packet_loss:
        return "link-lost", lossy(packet_loss, settings)
    if battery is not None and battery < settings.min_battery_fraction:
        return "failsafe", f"the battery is at {100 * battery:.0f} %"
    if room is None:
        return None
    if room.left_s(now_s) < 0.0:
        return "failsafe", f"the time allowed ({room.bounds.max_duration_s:.0f} s) is over"
    reason = room.outside(local.position_ned_m, settings.measured_margin_m)
    return ("failsafe", f"the vehicle left its bounds: {reason}") if reason else None


def lossy(packet_loss: float, settings: FlightSettings) -> str:
    """A link that loses too much, in words for the operator."""
    return f"the link loses {100 * packet_loss:.0f} % of the packets, more than {100 * settings.max_packet_loss:.0f} %"


def with_loss(reason: str, packet_loss: float | None, settings: FlightSettings) -> str:
    """A reason that lost packets may be behind, with them beside it when too many are known to be lost."""
    if packet_loss is None or packet_loss <= settings.max_packet_loss:
        return reason
    return f"{reason}; {lossy(packet_loss, settings)}"
