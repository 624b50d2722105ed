"""What the AR.Drone reports, in the terms in which the pilot's rules look at any aircraft (`VehicleState`).

The AR.Drone has no flight modes. What we do with it (`doing`) and what its control state says together make one: so it
shows as a change of mode when somebody else lands it, flips it or cuts its motors.
"""

from __future__ import annotations

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.ardrone.navdata import DroneState, Navdata
from mission.vehicle.ardrone.navdata_options import Control
from mission.vehicle.ardrone.reckoning import Reckoned
from mission.vehicle.state.modes import FlightMode, ModeKind
from mission.vehicle.state.vehicle_state import LocalState, VehicleState

GROUNDED = (Control.DEFAULT, Control.INIT, Control.LANDED, Control.TEST)
_FRESH_S = 0.6
_SILENT_S = 2.0
"""The drone itself takes its link as lost after this long; so do we."""
_WARNING = 4
_WARNINGS = {
    DroneState.EMERGENCY: "emergency: the motors are cut",
    DroneState.USER_EMERGENCY_LANDING: "emergency landing",
    DroneState.CUTOUT: "a motor was blocked",
    DroneState.MOTOR_PROBLEM: "motor problem",
    DroneState.ANGLES_OUT_OF_RANGE: "angles out of range",
    DroneState.BATTERY_LOW: "battery low",
    DroneState.TOO_MUCH_WIND: "too much wind",
    DroneState.ULTRASOUND_DEAF: "the ultrasound hears no ground",
    DroneState.COMMUNICATION_LOST: "the drone does not hear us",
    DroneState.SOFTWARE_FAULT: "software fault",
    DroneState.MAGNETOMETER_NEEDS_CALIBRATION: "the magnetometer needs calibration",
}


class ArdroneVehicle(VehicleState):
    """The newest of what one AR.Drone reports."""

    def __init__(self) -> None:
        super().__init__(1)
        self.autopilot = "ardrone"
        self.vehicle_type = mavlink.MAV_TYPE_QUADROTOR
        self.gps_fix = mavlink.GPS_FIX_TYPE_NO_GPS
        self.doing: ModeKind | None = None
        """What we make it do; None when we leave it alone."""
        self.readied = False
        """Whether it was made ready to take off: what arming is elsewhere."""
        self.control: int = Control.DEFAULT
        self.navdata: Navdata | None = None
        self._state = 0

    def connected(self, now_s: float) -> bool:
        """Whether navdata is young enough."""
        return self.heartbeat_s is not None and now_s - self.heartbeat_s < _SILENT_S

    def position_ok(self, now_s: float) -> bool:
        """Whether the dead reckoning is fresh: there need be no GPS."""
        return self.local is not None and now_s - self.local.t_s < _FRESH_S

    def heading_ok(self, now_s: float) -> bool:
        """Whether a heading is fresh; it may be relative to where the drone was switched on."""
        return self.attitude_s is not None and now_s - self.attitude_s < _FRESH_S

    def fault(self, now_s: float) -> str | None:
        """None: it vouches for nothing that could fail."""
        del now_s
        return None

    def take(self, navdata: Navdata, reckoned: Reckoned | None, now_s: float) -> None:
        """Take in a packet and the pose that was reckoned from it (None for an old or a bare one)."""
        with self._lock:
            self.heartbeat_s = now_s
            self._take_state(navdata, now_s)
            if reckoned is None or navdata.demo is None:
                return
            self.navdata = navdata
            self.control = navdata.demo.control
            self.battery_fraction = navdata.demo.battery_fraction
            self._take_pose(reckoned, now_s)
            self._take_critical()
            self._take_landed()
            self._take_mode(now_s)

    def _take_state(self, navdata: Navdata, now_s: float) -> None:
        for bit, text in _WARNINGS.items():
            if navdata.says(bit) and not self._state & bit:
                self.texts.append((now_s, _WARNING, text))
        self._state = navdata.state
        self.prearm_ok = not (navdata.says(DroneState.CUTOUT) or navdata.says(DroneState.MOTOR_PROBLEM))

    def _take_pose(self, reckoned: Reckoned, now_s: float) -> None:
        east, north, up = (float(v) for v in reckoned.position_enu_m)
        v_east, v_north, v_up = (float(v) for v in reckoned.velocity_enu_m_s)
        self.local = LocalState(now_s, np.array([north, east, -up]), np.array([v_north, v_east, -v_up]))
        self.ground_down_m = 0.0
        self.yaw_rad, self.attitude_s = reckoned.yaw_rad, now_s
        self.heading_known = True
        self.global_s = now_s

    def _take_critical(self) -> None:
        """An emergency ends what is flown; one that is left over on the ground is reset by the next take-off."""
        flown = self.control not in GROUNDED or self.doing in ("offboard", "take-off", "land")
        cut = bool(self._state & (DroneState.EMERGENCY | DroneState.USER_EMERGENCY_LANDING))
        self.critical = cut and flown

    def _take_landed(self) -> None:
        if self.control in GROUNDED:
            if self.critical or self.landed_state != mavlink.MAV_LANDED_STATE_ON_GROUND:
                self.readied = False
            self.landed_state = mavlink.MAV_LANDED_STATE_ON_GROUND
        elif self.control == Control.TAKING_OFF:
            self.landed_state = mavlink.MAV_LANDED_STATE_TAKEOFF
        elif self.control == Control.LANDING:
            self.landed_state = mavlink.MAV_LANDED_STATE_LANDING
        else:
            self.landed_state = mavlink.MAV_LANDED_STATE_IN_AIR
        grounded = self.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
        cut = bool(self._state & DroneState.EMERGENCY)
        self.armed = not cut and (self.readied or not grounded)

    def _take_mode(self, now_s: float) -> None:
        mode = self._mode_now()
        if self.mode_s is not None and mode != self.mode:
            self.mode_changes.append((now_s, mode))
        self.mode, self.mode_s = mode, now_s

    def _mode_now(self) -> FlightMode:
        if self._state & DroneState.EMERGENCY:
            return FlightMode("unknown" if self.critical else "hold", "Emergency")
        if self.control == Control.LANDING:
            return FlightMode("land", "Landing")
        if self.control in GROUNDED:
            # Found on the ground while it should fly: somebody has landed it.
            landed = self.doing == "offboard"
            return FlightMode("land", "Landed") if landed else FlightMode("hold", "Landed")
        if self.control == Control.LOOPING:
            return FlightMode("manual", "Flip")
        if self.control == Control.TAKING_OFF or self.doing == "take-off":
            return FlightMode("take-off", "Taking off")
        if self.doing == "offboard":
            return FlightMode("offboard", "Flying by tilt")
        if self.doing is None and self.mode.kind == "offboard":
            return self.mode
        return FlightMode("hold", "Hovering")
