"""Whether the vehicle moves as it is told to, and as it says itself: what shows that the pose is not to be flown by.

An estimator that corrects itself in one step (an EKF reset) makes the autopilot chase a place that has moved, faster
than the flight may be.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from mission.records import Vector
from mission.vehicle.limits import FlightSettings
from mission.vehicle.path_follower import Setpoint
from mission.vehicle.pilot.maneuvers import wrap
from mission.vehicle.state.vehicle_state import HeadingState, LocalState, VehicleState

_WINDOW_S = 0.5
_GAP_S = 1.0
"""Motion across a longer gap in the reports is not judged."""
_FAULT_FOR_S = 0.5
_OFF_FOR_S = 0.2
_LAG_S = 1.0
"""How late a vehicle may be on its path: PX4 was measured 2.1 m behind a setpoint that moves at 2 m/s, and 0.9 m beside
where that had been within the last second."""
_NEAR_M = 1.0
_PATIENCE_S = 4.0


class MotionWatch:
    """Compares what is reported with itself and with what was ordered; `step` is called at each tick of a flight.

    Args:
        settings: limits.
        began_s: now. The vehicle may come faster than allowed and pass its place until it was near and slow once, or
            until four seconds later.
    """

    def __init__(self, settings: FlightSettings, began_s: float) -> None:
        self._settings = settings
        self._began_s = began_s
        self._local: LocalState | None = None
        self._heading: HeadingState | None = None
        self._drift: Vector = np.zeros(3)
        self._drifts: deque[tuple[float, Vector]] = deque()
        self._twist_rad = 0.0
        self._twists: deque[tuple[float, float]] = deque()
        self._targets: deque[tuple[float, Vector]] = deque()
        self._settled = False
        self._fault_since_s: float | None = None
        self._off_since_s: float | None = None

    def fault(self, vehicle: VehicleState, now_s: float) -> str | None:
        """What the autopilot says is wrong with its pose, when it has said so for half a second."""
        fault = vehicle.fault(now_s)
        if fault is None:
            self._fault_since_s = None
        elif self._fault_since_s is None:
            self._fault_since_s = now_s
        elif now_s - self._fault_since_s > _FAULT_FOR_S:
            return fault
        return None

    def step(self, vehicle: VehicleState, target: Setpoint, max_speed_m_s: float, now_s: float) -> str | None:
        """Why the vehicle is not to be flown on, or None.

        Args:
            vehicle: what the autopilot reports.
            target: what was ordered.
            max_speed_m_s: allowed.
            now_s: program time.
        """
        return (
            self._stepped(vehicle.local)
            or self._turned(vehicle.heading)
            or self._flown(vehicle.local, target, max_speed_m_s, now_s)
        )

    def _stepped(self, local: LocalState | None) -> str | None:
        """A position that its own velocity does not explain."""
        last = self._local
        if local is None or local.boot_s is None or local is last:
            return None
        self._local = local
        dt = math.inf if last is None or last.boot_s is None else local.boot_s - last.boot_s
        if last is None or not 0.0 < dt < _GAP_S:
            self._drifts.clear()
        else:
            mean = 0.5 * (last.velocity_ned_m_s + local.velocity_ned_m_s)
            self._drift = self._drift + (local.position_ned_m - last.position_ned_m - dt * mean)
        while self._drifts and local.boot_s - self._drifts[0][0] > _WINDOW_S + dt:
            self._drifts.popleft()
        step_m = max((float(np.linalg.norm(self._drift - drift)) for _, drift in self._drifts), default=0.0)
        self._drifts.append((local.boot_s, self._drift))
        if step_m <= self._settings.max_step_m:
            return None
        return f"the reported position jumped by {step_m:.1f} m, which its velocity does not explain"

    def _turned(self, heading: HeadingState | None) -> str | None:
        """A heading that its own rate does not explain."""
        last = self._heading
        if heading is None or heading is last:
            return None
        self._heading = heading
        dt = math.inf if last is None else heading.boot_s - last.boot_s
        if last is None or not 0.0 < dt < _GAP_S:
            self._twists.clear()
        else:
            mean = 0.5 * (last.yaw_rate_rad_s + heading.yaw_rate_rad_s)
            self._twist_rad += wrap(heading.yaw_rad - last.yaw_rad - dt * mean)
        while self._twists and heading.boot_s - self._twists[0][0] > _WINDOW_S + dt:
            self._twists.popleft()
        turn_rad = max((abs(self._twist_rad - twist) for _, twist in self._twists), default=0.0)
        self._twists.append((heading.boot_s, self._twist_rad))
        if turn_rad <= self._settings.max_turn_rad:
            return None
        return f"the reported heading jumped by {math.degrees(turn_rad):.0f} degrees, which its rate does not explain"

    def _flown(self, local: LocalState | None, target: Setpoint, max_speed_m_s: float, now_s: float) -> str | None:
        """A vehicle that is faster than allowed, or far from where it was told to be."""
        if local is None:
            return None
        speed_m_s = float(np.linalg.norm(local.velocity_ned_m_s))
        self._targets.append((now_s, target.position_ned_m))
        while now_s - self._targets[0][0] > _LAG_S:
            self._targets.popleft()
        places = np.array([place for _, place in self._targets])
        off_m = float(np.linalg.norm(places - local.position_ned_m, axis=1).min())
        near = off_m < _NEAR_M and speed_m_s < max_speed_m_s
        self._settled = self._settled or near or now_s - self._began_s > _PATIENCE_S
        if not self._settled:
            return None
        if speed_m_s > max_speed_m_s + self._settings.speed_margin_m_s:
            return f"it moves at {speed_m_s:.1f} m/s, the limit is {max_speed_m_s:.1f} m/s"
        if off_m <= self._settings.max_tracking_error_m:
            self._off_since_s = None
        elif self._off_since_s is None:
            self._off_since_s = now_s
        elif now_s - self._off_since_s > _OFF_FOR_S:
            return f"it is {off_m:.1f} m from where it should be"
        return None
