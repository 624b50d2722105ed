"""Why a vehicle may not be flown now, in words for the operator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mission.vehicle.drone import Bounds, Telemetry
from mission.vehicle.fence import Fence
from mission.vehicle.limits import FlightSettings, lossy, with_loss
from mission.vehicle.state.vehicle_state import VehicleState

_FLOWN_M_S = 1.0
"""A vehicle in GUIDED that moves faster than this follows somebody."""


class Guards(Protocol):
    """What is known of the vehicle beyond its state: its own safeguards, and its link."""

    def fence(self) -> Fence | None:
        """The autopilot's geofence, in the local frame; None when it has none."""
        ...

    def refusal(self, must_hold: bool) -> str | None:
        """Why the autopilot's own reactions forbid a flight."""
        ...

    def packet_loss(self, now_s: float) -> float | None:
        """Fraction of the autopilot's packets that do not arrive; None when that is not known."""
        ...


@dataclass(frozen=True, slots=True)
class NoGuards:
    """For a vehicle that has none."""

    def fence(self) -> Fence | None:
        """None."""
        return None

    def refusal(self, must_hold: bool) -> str | None:
        """None."""
        return None

    def packet_loss(self, now_s: float) -> float | None:
        """Not known."""
        return None


def unfit(telemetry: Telemetry, min_battery_fraction: float) -> str | None:
    """Why an aircraft cannot be flown now, as far as telemetry tells; None when it can.

    Said at once when an order comes. The pilot process looks again, at more (`refusal`), before it takes control.
    """
    if not telemetry.connected:
        return "the autopilot is not heard"
    if not telemetry.armed or not telemetry.in_air:
        return "the vehicle is not armed and airborne"
    if not telemetry.position_ok:
        return "the position is not healthy"
    if not telemetry.heading_ok:
        return "the heading is not healthy"
    battery = telemetry.battery_fraction
    return None if battery is None or battery >= min_battery_fraction else f"the battery is at {100 * battery:.0f} %"


def gimbal_refusal(telemetry: Telemetry, *, ignored: bool) -> str | None:
    """Why what the camera file says of a gimbal must not be believed, or None.

    Args:
        telemetry: the newest.
        ignored: the operator has said that the camera is not on the gimbal.
    """
    if telemetry.gimbal_trouble:
        return telemetry.gimbal_trouble
    if ignored or not telemetry.gimbal:
        return None
    return (
        f"the aircraft carries a gimbal ({telemetry.gimbal}), and the camera is told as fixed: a stabilised camera "
        'would be answered a third wrong. Say gimbal = "mavlink" in its camera file, or set camera.ignore_gimbal where '
        "this camera is not on it"
    )


def height_refusal(
    height_m: float, bounds: Bounds, fence: Fence | None, margin_m: float, vehicle: VehicleState
) -> str | None:
    """Why a take-off to a height above the ground is not allowed; None when it is.

    Args:
        height_m: wanted.
        bounds: of the order.
        fence: of the autopilot.
        margin_m: kept free inside the fence.
        vehicle: where it stands.
    """
    if not bounds.min_height_m <= height_m <= bounds.max_height_m:
        return f"the take-off height is outside {bounds.min_height_m:.1f} to {bounds.max_height_m:.1f} m"
    if fence is None or vehicle.local is None:
        return None
    reason = fence.outside(np.array([*vehicle.local.position_ned_m[:2], -height_m]), 0.0, margin_m)
    return f"the take-off would leave the geofence: {reason}" if reason else None


def refusal(
    vehicle: VehicleState, settings: FlightSettings, guards: Guards, now_s: float, *, on_ground: bool
) -> str | None:
    """The first reason not to take off (`on_ground`) or not to take control in the air; None when there is none."""
    loss = guards.packet_loss(now_s)
    if not vehicle.connected(now_s):
        return with_loss("the autopilot is not heard", loss, settings)
    if vehicle.autopilot == "other":
        return "the autopilot is neither PX4 nor ArduPilot"
    if not vehicle.multicopter:
        return "the vehicle is not a multicopter"
    if on_ground and (vehicle.armed or vehicle.in_air):
        return "the vehicle is already armed or in the air"
    if not on_ground and not vehicle.in_air:
        return "the vehicle is not armed and airborne"
    if not vehicle.position_ok(now_s):
        return with_loss("the position is not healthy (GPS fix, estimator)", loss, settings)
    if not vehicle.heading_ok(now_s):
        return with_loss("the heading is not healthy", loss, settings)
    if on_ground and vehicle.prearm_ok is False:
        return "the autopilot's checks before arming do not pass"
    battery = vehicle.battery_fraction
    if battery is not None and battery < settings.min_battery_fraction:
        return f"the battery is at {100 * battery:.0f} %, below {100 * settings.min_battery_fraction:.0f} %"
    if loss is not None and loss > settings.max_packet_loss:
        return lossy(loss, settings)
    if vehicle.critical:
        return f"the autopilot is in a failsafe ({vehicle.mode.name})"
    if not on_ground and vehicle.mode.kind in ("land", "return", "take-off", "unknown"):
        return f"the vehicle is in {vehicle.mode.name}"
    if not on_ground and vehicle.mode.kind == "offboard" and vehicle.autopilot == "px4":
        return "another controller is flying it in Offboard"
    speed = 0.0 if vehicle.local is None else float(np.linalg.norm(vehicle.local.velocity_ned_m_s))
    if not on_ground and vehicle.mode.kind == "offboard" and speed > _FLOWN_M_S:
        return f"another controller is flying it: in {vehicle.mode.name} it moves at {speed:.1f} m/s"
    return guards.refusal(settings.must_hold)
