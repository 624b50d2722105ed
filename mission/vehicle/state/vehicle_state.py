"""What an autopilot reports, gathered from its messages: mode, health, battery, local position, height."""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.geodesy import geodetic_to_enu
from mission.records import GeodeticOrigin, Vector
from mission.vehicle.state.gps_receivers import GpsReceivers
from mission.vehicle.state.modes import MULTICOPTERS, Autopilot, FlightMode, autopilot_of, flight_mode
from mission.vehicle.state.packet_loss import overtaken
from mission.vehicle.state.sticks import Sticks

VEHICLE_MESSAGES = (
    "HEARTBEAT",
    "CURRENT_MODE",
    "SYS_STATUS",
    "EXTENDED_SYS_STATE",
    "GPS_RAW_INT",
    "GPS2_RAW",
    "RC_CHANNELS",
    "GLOBAL_POSITION_INT",
    "LOCAL_POSITION_NED",
    "ATTITUDE",
    "EKF_STATUS_REPORT",
    "ESTIMATOR_STATUS",
    "POSITION_TARGET_GLOBAL_INT",
    "STATUSTEXT",
)
"""Messages that `VehicleState.update` reads."""

_STALE_S = 1.0
_EKF_POSITION = 0x218
"""ArduPilot: horizontal position relative, absolute and predicted absolute."""
_EKF_CONSTANT_POSITION = 0x80
"""ArduPilot: EKF_CONST_POS_MODE, the position is only held."""
_ESTIMATOR_POSITION = mavlink.ESTIMATOR_POS_HORIZ_ABS
_UNKNOWN_HEADING = 65535
_HOME_SAMPLES = 100
_FOLLOWS_NO_POINT = 0x7
_FOLLOWS_NO_VELOCITY = 0x38
"""type_mask bits of a target without a position or a velocity."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalState:
    """LOCAL_POSITION_NED: position (3,) m and velocity (3,) m/s in the autopilot's local north-east-down frame."""

    t_s: float
    position_ned_m: Vector
    velocity_ned_m_s: Vector
    boot_s: float | None = None
    """When it was measured, by the autopilot's own clock; None where there is none."""


@dataclass(frozen=True, slots=True)
class HeadingState:
    """ATTITUDE: heading and its rate, radians clockwise, by the autopilot's own clock."""

    boot_s: float
    yaw_rad: float
    yaw_rate_rad_s: float


@dataclass(frozen=True, slots=True)
class PositionTarget:
    """POSITION_TARGET_GLOBAL_INT with a position: where the autopilot itself is going."""

    t_s: float
    lat_deg: float
    lon_deg: float
    alone: bool
    """Without a velocity: a point to go to, not a setpoint that moves."""


_HEARTBEAT_S = 3.5
_HEARTBEAT_AT_MOST_S = 6.5
"""While other telemetry comes; in ArduPilot's heartbeat alone is its mode, so not for longer."""
_OVERTAKEN_S = 0.3
"""How late a packet may be whose number says that a newer one was faster; the numbers come round after some seconds."""
_HEARD_S = 1.0
_REBOOT_MS = 1000
_MOVES_M_S = 0.2
_STANDING_S = 0.5


class VehicleState:
    """The newest of what one vehicle reports. `update` is called in the link's thread, the rest from any.

    Args:
        system: the vehicle's system id; 0 takes the first autopilot that is heard.
    """

    def __init__(self, system: int = 0) -> None:
        self.system = system
        self.autopilot: Autopilot = "other"
        self.vehicle_type = 0
        self.heartbeat_s: float | None = None
        self.heard_s: float | None = None
        """When anything was last heard of it."""
        self.mode = FlightMode("unknown", "unknown")
        self.mode_s: float | None = None
        self.mode_changes: deque[tuple[float, FlightMode]] = deque(maxlen=50)
        """Each mode that followed another one, oldest first."""
        self.armed = False
        self.critical = False
        self.landed_state = mavlink.MAV_LANDED_STATE_UNDEFINED
        self.battery_fraction: float | None = None
        self.prearm_ok: bool | None = None
        self.fence_active: bool | None = None
        """Whether the autopilot enforces a geofence now; None where it does not say."""
        self.sticks = Sticks()
        self.gps_fix = 0
        """The best one of its receivers."""
        self.gps_accuracy_m: float | None = None
        self.geoid_separation_m: float | None = None
        self.ekf_flags: int | None = None
        self.estimator_flags: int | None = None
        self.estimator_accuracy_m: float | None = None
        self.local: LocalState | None = None
        self.yaw_rad = 0.0
        self.yaw_rate_rad_s = 0.0
        self.attitude_s: float | None = None
        self.heading: HeadingState | None = None
        self.standing_s: float | None = None
        """When a report last came that was no new one: its clock, or what it says of a moving vehicle, stood still."""
        self.lat_deg = 0.0
        self.lon_deg = 0.0
        self.alt_amsl_m = 0.0
        self.relative_alt_m = 0.0
        self.global_s: float | None = None
        self.heading_known = False
        self.position_target: PositionTarget | None = None
        self.texts: deque[tuple[float, int, str]] = deque(maxlen=50)
        """STATUSTEXT: time, severity, text."""
        self.ground_down_m: float | None = None
        """Down coordinate of the ground under the take-off point, in the local frame."""
        self._relative: list[float] = []
        self._seen_grounded = False
        self._mode_number = 0
        """Sequence number of the newest packet that told the mode."""
        self._identity: tuple[int, int] | None = None
        self._boot_ms: dict[str, int] = {}
        self._receivers = GpsReceivers()
        self._lock = threading.Lock()

    def update(self, message: Any, now_s: float) -> None:
        """Take in a message; those of other systems and components are passed over."""
        name = message.get_type()
        if message.get_srcComponent() != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return
        if self.system == 0 and name == "HEARTBEAT" and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            self.system = message.get_srcSystem()
        if message.get_srcSystem() != self.system:
            return
        with self._lock:
            self.heard_s = now_s
            _UPDATES[name](self, message, now_s)

    def connected(self, now_s: float) -> bool:
        """Whether the autopilot is heard: by a young heartbeat, or by an older one while other telemetry comes.

        Heartbeats come once a second: at 20 % loss three in a row are lost within every other minute.
        """
        if self.heartbeat_s is None or self.heard_s is None:
            return False
        silent_s = now_s - self.heartbeat_s
        return silent_s < _HEARTBEAT_S or (silent_s < _HEARTBEAT_AT_MOST_S and now_s - self.heard_s < _HEARD_S)

    @property
    def in_air(self) -> bool:
        """Armed and not on the ground."""
        return self.armed and self.landed_state in (
            mavlink.MAV_LANDED_STATE_IN_AIR,
            mavlink.MAV_LANDED_STATE_TAKEOFF,
            mavlink.MAV_LANDED_STATE_LANDING,
        )

    @property
    def multicopter(self) -> bool:
        """Whether it can hover."""
        return self.vehicle_type in MULTICOPTERS

    @property
    def height_m(self) -> float | None:
        """Above the take-off point: from the local frame, whose zero does not move as PX4's home altitude does."""
        if self.local is None or self.ground_down_m is None:
            return None
        return self.ground_down_m - float(self.local.position_ned_m[2])

    @property
    def told(self) -> bool:
        """Whether all that says how healthy position and heading are was heard at least once, good or bad."""
        vouched = self.ekf_flags is not None or self.estimator_flags is not None
        poses = self.global_s is not None and self.local is not None and self.attitude_s is not None
        return poses and vouched and self.gps_fix != mavlink.GPS_FIX_TYPE_NO_GPS

    def local_of(self, lat_deg: float, lon_deg: float) -> Vector | None:
        """North and east of a place in the local frame, (2,) m; None before it is known where the vehicle is."""
        if self.local is None or self.global_s is None:
            return None
        east, north, _ = geodetic_to_enu(lat_deg, lon_deg, 0.0, GeodeticOrigin(self.lat_deg, self.lon_deg, 0.0))
        place: Vector = self.local.position_ned_m[:2] + np.array([north, east])
        return place

    def position_ok(self, now_s: float) -> bool:
        """Whether the estimator vouches for a horizontal position and both positions are fresh."""
        fresh = self._fresh(self.global_s, now_s) and self.local is not None and self._fresh(self.local.t_s, now_s)
        if self.ekf_flags is not None:
            vouched = self.ekf_flags & _EKF_POSITION == _EKF_POSITION
        else:
            vouched = self.estimator_flags is not None and bool(self.estimator_flags & _ESTIMATOR_POSITION)
        return fresh and vouched and self.gps_fix >= mavlink.GPS_FIX_TYPE_3D_FIX

    def heading_ok(self, now_s: float) -> bool:
        """Whether a heading is known and fresh."""
        return self.heading_known and self._fresh(self.attitude_s, now_s)

    def stands_still(self, now_s: float) -> bool:
        """Whether reports come that tell nothing new."""
        return self.standing_s is not None and now_s - self.standing_s < _STANDING_S

    def fault(self, now_s: float) -> str | None:
        """Why the reported pose is not to be flown by, as far as the autopilot itself says so; None when it may."""
        if self.gps_fix < mavlink.GPS_FIX_TYPE_3D_FIX:
            return "the GPS fix is lost"
        if not self._fresh(self.global_s, now_s):
            return "the autopilot tells no place on earth any more"
        if not self.position_ok(now_s):
            return "the autopilot's estimator does not vouch for the position any more"
        if self.ekf_flags is not None and self.ekf_flags & _EKF_CONSTANT_POSITION:
            return "the autopilot's estimator has lost the position"
        return None if self.heading_ok(now_s) else "the autopilot's heading is not known any more"

    def take_texts(self) -> list[tuple[float, int, str]]:
        """STATUSTEXTs since the last call."""
        with self._lock:
            texts = list(self.texts)
            self.texts.clear()
        return texts

    def take_mode_changes(self) -> list[tuple[float, FlightMode]]:
        """Mode changes since the last call."""
        with self._lock:
            changes = list(self.mode_changes)
            self.mode_changes.clear()
        return changes

    @staticmethod
    def _fresh(t_s: float | None, now_s: float) -> bool:
        return t_s is not None and now_s - t_s < _STALE_S

    def _set_mode(self, m: Any, now_s: float) -> None:
        # On a link that reorders, an old mode that comes after a newer one is no take-over.
        if self.mode_s is not None and now_s - self.mode_s < _OVERTAKEN_S and overtaken(m.get_seq(), self._mode_number):
            return
        self._mode_number = m.get_seq()
        mode = flight_mode(self.autopilot, m.custom_mode)
        if self.mode_s is not None and mode != self.mode:
            self.mode_changes.append((now_s, mode))
        self.mode, self.mode_s = mode, now_s

    def _on_heartbeat(self, m: Any, now_s: float) -> None:
        if m.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
            return
        if not self._known(m, now_s):
            return
        self.autopilot = autopilot_of(m.autopilot)
        self.vehicle_type = m.type
        self.armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        self.critical = m.system_status in (mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY)
        self.heartbeat_s = now_s
        self._set_mode(m, now_s)

    def _known(self, m: Any, now_s: float) -> bool:
        """Whether a heartbeat is of the autopilot that is known; another one is believed when that one is silent."""
        identity = m.autopilot, m.type
        silent = self.heartbeat_s is None or now_s - self.heartbeat_s > _HEARTBEAT_S
        if self._identity is None or silent:
            self._identity = identity
        return identity == self._identity

    def _advances(self, m: Any, now_s: float) -> bool:
        """Whether a report is newer than the last of its kind, by the autopilot's own clock."""
        name, boot_ms = m.get_type(), m.time_boot_ms
        last_ms = self._boot_ms.get(name)
        if last_ms is not None and last_ms - _REBOOT_MS < boot_ms <= last_ms:
            if boot_ms == last_ms:
                self.standing_s = now_s
            return False
        self._boot_ms[name] = boot_ms
        return True

    def _on_current_mode(self, m: Any, now_s: float) -> None:
        if self.heartbeat_s is not None:
            self._set_mode(m, now_s)

    def _on_sys_status(self, m: Any, now_s: float) -> None:
        del now_s
        self.battery_fraction = m.battery_remaining / 100.0 if 0 <= m.battery_remaining <= 100 else None
        self.prearm_ok = bool(m.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        rc = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
        self.sticks.heard = bool(m.onboard_control_sensors_enabled & m.onboard_control_sensors_health & rc)
        enabled = bool(m.onboard_control_sensors_enabled & mavlink.MAV_SYS_STATUS_GEOFENCE)
        # ArduPilot (AC_Fence::sys_status_present): present with a fence that is set up, also while it is switched off.
        present = bool(m.onboard_control_sensors_present & mavlink.MAV_SYS_STATUS_GEOFENCE)
        self.fence_active = True if enabled else False if present else None

    def _on_rc_channels(self, m: Any, now_s: float) -> None:
        self.sticks.take(m, now_s)

    def _on_extended_sys_state(self, m: Any, now_s: float) -> None:
        del now_s
        self.landed_state = m.landed_state

    def _on_gps(self, m: Any, now_s: float) -> None:
        gps = self._receivers
        gps.take(m, now_s)
        self.gps_fix, self.gps_accuracy_m, self.geoid_separation_m = gps.fix, gps.accuracy_m, gps.geoid_separation_m

    def _on_global_position_int(self, m: Any, now_s: float) -> None:
        if not on_earth(m.lat, m.lon) or not self._advances(m, now_s):
            return
        self.lat_deg, self.lon_deg = m.lat * 1e-7, m.lon * 1e-7
        self.alt_amsl_m, self.relative_alt_m = m.alt * 1e-3, m.relative_alt * 1e-3
        self.heading_known = m.hdg != _UNKNOWN_HEADING
        self.global_s = now_s

    def _on_local_position_ned(self, m: Any, now_s: float) -> None:
        position, velocity = np.array([m.x, m.y, m.z]), np.array([m.vx, m.vy, m.vz])
        finite = np.isfinite(position).all() and np.isfinite(velocity).all()
        if not finite or not self._advances(m, now_s):
            return
        if self._is_frozen(position, velocity):
            self.standing_s = now_s
            return
        self.local = LocalState(now_s, position, velocity, m.time_boot_ms * 1e-3)
        grounded = self.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
        if self.heartbeat_s is not None and not self.armed and grounded:
            self.ground_down_m = m.z
            self._seen_grounded = True
        elif not self._seen_grounded and self.global_s is not None and len(self._relative) < _HOME_SAMPLES:
            # First met in the air: home's height is all there is. PX4 moves it, so that the median of some is taken.
            self._relative.append(m.z + self.relative_alt_m)
            self.ground_down_m = float(np.median(self._relative))

    def _is_frozen(self, position_ned_m: Vector, velocity_ned_m_s: Vector) -> bool:
        """Whether a vehicle that is said to move is said to be where it was."""
        last = self.local
        if last is None or float(np.linalg.norm(velocity_ned_m_s)) < _MOVES_M_S:
            return False
        same = np.array_equal(position_ned_m, last.position_ned_m)
        return same and np.array_equal(velocity_ned_m_s, last.velocity_ned_m_s)

    def _on_attitude(self, m: Any, now_s: float) -> None:
        if math.isfinite(m.yaw) and math.isfinite(m.yawspeed) and self._advances(m, now_s):
            self.heading = HeadingState(m.time_boot_ms * 1e-3, m.yaw, m.yawspeed)
            self.yaw_rad, self.yaw_rate_rad_s, self.attitude_s = m.yaw, m.yawspeed, now_s

    def _on_ekf_status_report(self, m: Any, now_s: float) -> None:
        del now_s
        self.ekf_flags = m.flags

    def _on_estimator_status(self, m: Any, now_s: float) -> None:
        del now_s
        self.estimator_flags = m.flags
        accuracy = m.pos_horiz_accuracy
        self.estimator_accuracy_m = accuracy if math.isfinite(accuracy) and accuracy > 0.0 else None

    def _on_position_target_global_int(self, m: Any, now_s: float) -> None:
        if m.type_mask & _FOLLOWS_NO_POINT == 0 and (m.lat_int or m.lon_int):
            alone = m.type_mask & _FOLLOWS_NO_VELOCITY == _FOLLOWS_NO_VELOCITY
            self.position_target = PositionTarget(now_s, m.lat_int * 1e-7, m.lon_int * 1e-7, alone)

    def _on_statustext(self, m: Any, now_s: float) -> None:
        self.texts.append((now_s, m.severity, m.text.strip("\x00 \t")))


def on_earth(lat_e7: int, lon_e7: int) -> bool:
    """Whether these are a place, in degrees times 1e7; both 0 means that it is not known."""
    return (lat_e7 != 0 or lon_e7 != 0) and abs(lat_e7) <= 900_000_000 and abs(lon_e7) <= 1_800_000_000


_UPDATES = {
    "HEARTBEAT": VehicleState._on_heartbeat,
    "CURRENT_MODE": VehicleState._on_current_mode,
    "SYS_STATUS": VehicleState._on_sys_status,
    "EXTENDED_SYS_STATE": VehicleState._on_extended_sys_state,
    "GPS_RAW_INT": VehicleState._on_gps,
    "RC_CHANNELS": VehicleState._on_rc_channels,
    "GPS2_RAW": VehicleState._on_gps,
    "GLOBAL_POSITION_INT": VehicleState._on_global_position_int,
    "LOCAL_POSITION_NED": VehicleState._on_local_position_ned,
    "ATTITUDE": VehicleState._on_attitude,
    "EKF_STATUS_REPORT": VehicleState._on_ekf_status_report,
    "ESTIMATOR_STATUS": VehicleState._on_estimator_status,
    "POSITION_TARGET_GLOBAL_INT": VehicleState._on_position_target_global_int,
    "STATUSTEXT": VehicleState._on_statustext,
}
