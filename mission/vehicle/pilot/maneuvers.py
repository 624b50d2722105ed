"""The manoeuvres that the pilot process flies with setpoints: stand still, turn, follow a path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mission.records import Vector
from mission.vehicle.drone import OrderState, Path
from mission.vehicle.limits import Room
from mission.vehicle.path_follower import Setpoint, setpoint_at
from mission.vehicle.state.vehicle_state import LocalState, VehicleState

STILL_M_S = 0.4
NEAR_M = 0.5
_FAR_M = 1.0
"""Farther than this from where it should be after all patience, a manoeuvre has failed."""
_STILL_FOR_S = 0.3
_PATIENCE_S = 4.0
_FACING_RAD = math.radians(3.0)
_FACING_ROUGHLY_RAD = math.radians(8.0)
_STOPPING_S = 0.5
"""A multicopter told to stop comes to rest about this time times its speed further on (1 m at 2 m/s)."""


@dataclass(frozen=True, slots=True)
class ManeuverOutcome:
    """How a manoeuvre came out."""

    state: OrderState
    reason: str = ""


DONE = ManeuverOutcome(OrderState.DONE)


class Guidance:
    """The setpoint and the heading that are being flown, and the heading that is aimed at.

    Args:
        vehicle: what the autopilot reports.
        max_yaw_rate_rad_s: the commanded heading moves no faster towards its aim.
    """

    def __init__(self, vehicle: VehicleState, max_yaw_rate_rad_s: float) -> None:
        self.vehicle = vehicle
        self.target = Setpoint(np.zeros(3), np.zeros(3))
        self.yaw_rad = 0.0
        self.aim_rad: float | None = None
        self._rate = max_yaw_rate_rad_s
        self._slewed_s: float | None = None

    def stop_here(self, room: Room) -> None:
        """Aim to come to rest, within the bounds, where the vehicle can; a target nearby that stands still is kept."""
        local = self.local
        at_rest = float(np.linalg.norm(self.target.velocity_ned_m_s)) == 0.0
        if at_rest and float(np.linalg.norm(self.target.position_ned_m - local.position_ned_m)) < NEAR_M:
            return
        place = local.position_ned_m + _STOPPING_S * local.velocity_ned_m_s
        if room.outside(place):
            place = local.position_ned_m
        self.target = Setpoint(place.copy(), np.zeros(3))

    def start(self, now_s: float) -> None:
        """Begin from the vehicle's own heading."""
        self.yaw_rad, self._slewed_s = self.vehicle.yaw_rad, now_s

    def slew(self, now_s: float) -> None:
        """Move the commanded heading towards the aim."""
        last, self._slewed_s = self._slewed_s, now_s
        if self.aim_rad is None or last is None:
            return
        most = self._rate * max(0.0, min(0.2, now_s - last))
        self.yaw_rad = wrap(self.yaw_rad + max(-most, min(most, wrap(self.aim_rad - self.yaw_rad))))

    @property
    def local(self) -> LocalState:
        """The measured position.

        Raises:
            RuntimeError: none was reported; the caller checks the vehicle's health first.
        """
        if self.vehicle.local is None:
            raise RuntimeError("no local position was reported")
        return self.vehicle.local

    @property
    def off_m(self) -> float:
        """Distance from the setpoint."""
        return float(np.linalg.norm(self.local.position_ned_m - self.target.position_ned_m))

    @property
    def still(self) -> bool:
        """Whether it hardly moves."""
        return float(np.linalg.norm(self.local.velocity_ned_m_s)) < STILL_M_S


class Maneuver(Protocol):
    """One manoeuvre; `step` moves the guidance and says how it came out when it is over."""

    def step(self, guidance: Guidance, now_s: float) -> ManeuverOutcome | None:
        """Called at each tick."""
        ...


class StandStill:
    """Wait until the vehicle rests at its setpoint."""

    def __init__(self, began_s: float) -> None:
        self._began_s = began_s
        self._still_since_s: float | None = None

    def step(self, guidance: Guidance, now_s: float) -> ManeuverOutcome | None:
        """DONE when it was still and near its place for 0.3 s."""
        if not (guidance.still and guidance.off_m < NEAR_M):
            self._still_since_s = None
        elif self._still_since_s is None:
            self._still_since_s = now_s
        elif now_s - self._still_since_s >= _STILL_FOR_S:
            return DONE
        if now_s - self._began_s < _PATIENCE_S:
            return None
        if guidance.off_m < _FAR_M:
            return DONE
        return ManeuverOutcome(OrderState.ENDED, f"the vehicle stays {guidance.off_m:.1f} m from where it should hover")


class TurnManeuver:
    """Turn on the spot to a heading (radians clockwise from north); a later aim replaces it."""

    def __init__(self, heading_rad: float) -> None:
        self._heading_rad: float | None = wrap(heading_rad)
        self._facing_since_s: float | None = None
        self._commanded_s: float | None = None

    def step(self, guidance: Guidance, now_s: float) -> ManeuverOutcome | None:
        """DONE when the reported heading was within 3 degrees for 0.3 s."""
        if self._heading_rad is not None:
            guidance.aim_rad, self._heading_rad = self._heading_rad, None
            return None
        if guidance.aim_rad is not None and abs(wrap(guidance.yaw_rad - guidance.aim_rad)) > 1e-6:
            self._commanded_s = None
            return None
        if self._commanded_s is None:
            self._commanded_s = now_s
        error = abs(wrap(guidance.vehicle.yaw_rad - guidance.yaw_rad))
        if error > _FACING_RAD:
            self._facing_since_s = None
        elif self._facing_since_s is None:
            self._facing_since_s = now_s
        elif now_s - self._facing_since_s >= _STILL_FOR_S:
            return DONE
        if now_s - self._commanded_s < _PATIENCE_S:
            return None
        if error < _FACING_ROUGHLY_RAD:
            return DONE
        return ManeuverOutcome(
            OrderState.ENDED, f"the vehicle stays {math.degrees(error):.0f} degrees from its heading"
        )


class FollowPath:
    """Fly a path from where the setpoint stands, then come to rest at its end."""

    def __init__(self, path: Path, start_ned_m: Vector, began_s: float) -> None:
        self._path = path
        self._start_ned_m = start_ned_m.copy()
        self._began_s = began_s
        self._rest: StandStill | None = None

    def step(self, guidance: Guidance, now_s: float) -> ManeuverOutcome | None:
        """DONE at the path's end, at rest."""
        along = now_s - self._began_s
        guidance.target = setpoint_at(self._path, along, self._start_ned_m)
        if along < self._path.duration_s:
            return None
        if self._rest is None:
            self._rest = StandStill(now_s)
        return self._rest.step(guidance, now_s)


def wrap(angle_rad: float) -> float:
    """The same angle between -pi and pi."""
    return math.remainder(angle_rad, math.tau)
