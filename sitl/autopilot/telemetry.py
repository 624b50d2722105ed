"""What the autopilot reports: one function for each message, from the estimated state only (never from the truth)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.flavour import Mode, base_mode
from sitl.autopilot.flight_stack import FlightStack
from sitl.autopilot.rotation import Vec, ned

_NAN = math.nan
_CELLS_V = (3.5, 4.2)
_A_PLACE_ONLY = 0xFDF8


def heartbeat(a: FlightStack) -> Any:
    """HEARTBEAT."""
    c = a.commander
    standby, active = mavlink.MAV_STATE_STANDBY, mavlink.MAV_STATE_ACTIVE
    state = active if c.armed and (not c.landed or c.flavour.name == "px4") else standby
    if c.failsafe:
        state = mavlink.MAV_STATE_CRITICAL
    mode = base_mode(c.flavour, c.mode, c.armed)
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, c.flavour.autopilot, mode, c.flavour.modes[c.mode], state, 3
    )


def autopilot_version(a: FlightStack) -> Any:
    """AUTOPILOT_VERSION: PX4 1.17.0 or ArduCopter 4.8.0, both as development versions."""
    version = (1 << 24 | 17 << 16) if a.flavour.name == "px4" else (4 << 24 | 8 << 16)
    zeros = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        *(a.flavour.capabilities, version, version, 0, 0, zeros, zeros, zeros),
        *(0, 0, a.config.seed & 0xFFFF, [0] * 18),
    )


def attitude(a: FlightStack) -> Any:
    """ATTITUDE."""
    p, q, r = a.vehicle.estimate.rates_flu
    return mavlink.MAVLink_attitude_message(a.boot_ms, *a.vehicle.euler, p, -q, -r)


def attitude_quaternion(a: FlightStack) -> Any:
    """ATTITUDE_QUATERNION."""
    p, q, r = a.vehicle.estimate.rates_flu
    return mavlink.MAVLink_attitude_quaternion_message(a.boot_ms, *a.vehicle.ned_from_frd, p, -q, -r)


def global_position_int(a: FlightStack) -> Any:
    """GLOBAL_POSITION_INT."""
    lat, lon, alt = a.place.geodetic(a.vehicle.estimate.position)
    north, east, down = ned(a.vehicle.estimate.velocity)
    relative = a.vehicle.estimate.position[2] - a.home_up
    heading = round(math.degrees(a.vehicle.euler[2]) * 100) % 36000
    return mavlink.MAVLink_global_position_int_message(
        *(a.boot_ms, round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), round(relative * 1e3)),
        *(_int16(north * 100), _int16(east * 100), _int16(down * 100), heading),
    )


def local_position_ned(a: FlightStack) -> Any:
    """LOCAL_POSITION_NED, around the scenario's home."""
    state = a.vehicle.estimate
    return mavlink.MAVLink_local_position_ned_message(a.boot_ms, *ned(state.position), *ned(state.velocity))


def position_target_local_ned(a: FlightStack) -> Any:
    """POSITION_TARGET_LOCAL_NED: what is followed now."""
    if not a.commander.armed or a.commander.landed:
        nans = (_NAN,) * 6
        return mavlink.MAVLink_position_target_local_ned_message(a.boot_ms, 1, 63, *nans, 0.0, 0.0, 0.0, 0.0, 0.0)
    position, velocity, yaw = a.navigator.target
    return mavlink.MAVLink_position_target_local_ned_message(
        a.boot_ms, 1, 0, *ned(position), *ned(velocity), 0.0, 0.0, 0.0, yaw, 0.0
    )


def position_target_global_int(a: FlightStack) -> Any:
    """POSITION_TARGET_GLOBAL_INT: what is followed now; on ArduPilot the place it goes to (GCS_MAVLink_Copter.cpp)."""
    position, velocity, yaw = a.navigator.target
    goal = a.navigator.destination
    if a.flavour.name == "ardupilot":
        lat, lon, alt = a.place.geodetic(position if goal is None else goal)
        where = (round(lat * 1e7), round(lon * 1e7), alt)
        return mavlink.MAVLink_position_target_global_int_message(
            a.boot_ms, mavlink.MAV_FRAME_GLOBAL, _A_PLACE_ONLY, *where, *(0.0,) * 8
        )
    lat, lon, alt = a.place.geodetic(position)
    where = (round(lat * 1e7), round(lon * 1e7), alt)
    return mavlink.MAVLink_position_target_global_int_message(
        a.boot_ms, mavlink.MAV_FRAME_GLOBAL_INT, 0, *where, *ned(velocity), 0.0, 0.0, 0.0, yaw, 0.0
    )


def gps_raw_int(a: FlightStack) -> Any:
    """GPS_RAW_INT: the receiver's own noisy fix."""
    lat, lon, alt = a.place.geodetic(a.gnss_position)
    h, v, s = (round(accuracy * 1e3) for accuracy in a.config.preset.gnss_accuracy_m)
    north, east, _ = ned(a.vehicle.estimate.velocity)
    course = round(math.degrees(math.atan2(east, north)) * 100) % 36000
    fix = mavlink.GPS_FIX_TYPE_3D_FIX if a.flavour.name == "px4" else mavlink.GPS_FIX_TYPE_RTK_FIXED
    return mavlink.MAVLink_gps_raw_int_message(
        *(a.boot_ms * 1000, fix, round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), 70, 110),
        *(round(math.hypot(north, east) * 100), course, 10),
        *(round((alt + (a.place.geoid_separation_m if a.flavour.tells_geoid else 0.0)) * 1e3), h, v, s, 0, 0),
    )


def sys_status(a: FlightStack) -> Any:
    """SYS_STATUS; the PREARM bit (and on PX4 the GPS bit) is healthy when it is ready to arm."""
    sensors = a.flavour.sensors | mavlink.MAV_SYS_STATUS_PREARM_CHECK
    ready = a.commander.ready(a.now)
    unready = mavlink.MAV_SYS_STATUS_PREARM_CHECK | mavlink.MAV_SYS_STATUS_SENSOR_GPS | mavlink.MAV_SYS_STATUS_AHRS
    healthy = sensors if ready else sensors & ~unready
    remaining = round(a.commander.battery_fraction * 100)
    return mavlink.MAVLink_sys_status_message(
        *(sensors, sensors, healthy, 98, round(_volts(a) * 1e3), -1, remaining), *([0] * 6)
    )


def extended_sys_state(a: FlightStack) -> Any:
    """EXTENDED_SYS_STATE."""
    vtol = mavlink.MAV_VTOL_STATE_UNDEFINED if a.flavour.name == "px4" else mavlink.MAV_VTOL_STATE_MC
    return mavlink.MAVLink_extended_sys_state_message(vtol, int(a.commander.landed_state))


def battery_status(a: FlightStack) -> Any:
    """BATTERY_STATUS."""
    cells = [round(_volts(a) * 1e3)] + [65535] * 9
    remaining = round(a.commander.battery_fraction * 100)
    return mavlink.MAVLink_battery_status_message(0, 1, 1, 32767, cells, -1, -1, -1, remaining, 0, 1)


def home_position(a: FlightStack) -> Any:
    """HOME_POSITION."""
    home: Vec = (a.commander.home[0], a.commander.home[1], a.home_up)
    lat, lon, alt = a.place.geodetic(home)
    where = (round(lat * 1e7), round(lon * 1e7), round(alt * 1e3), *ned(home))
    nans = [_NAN] * 4
    return mavlink.MAVLink_home_position_message(*where, nans, 0.0, 0.0, 0.0, a.boot_ms * 1000)


def gps_global_origin(a: FlightStack) -> Any:
    """GPS_GLOBAL_ORIGIN: of LOCAL_POSITION_NED."""
    place = a.place
    where = (round(place.lat_deg * 1e7), round(place.lon_deg * 1e7), round(place.alt_amsl_m * 1e3))
    return mavlink.MAVLink_gps_global_origin_message(*where, a.boot_ms * 1000)


def vfr_hud(a: FlightStack) -> Any:
    """VFR_HUD."""
    east, north, up = a.vehicle.estimate.velocity
    heading = round(math.degrees(a.vehicle.euler[2])) % 360
    alt = a.place.geodetic(a.vehicle.estimate.position)[2]
    throttle = 50 if a.commander.armed and not a.commander.landed else 0
    return mavlink.MAVLink_vfr_hud_message(0.0, math.hypot(east, north), heading, throttle, alt, up)


def altitude(a: FlightStack) -> Any:
    """ALTITUDE."""
    up = a.vehicle.estimate.position[2]
    amsl = a.place.alt_amsl_m + up
    return mavlink.MAVLink_altitude_message(a.boot_ms * 1000, amsl, amsl, up, up - a.home_up, _NAN, _NAN)


def current_mode(a: FlightStack) -> Any:
    """CURRENT_MODE (PX4 only): the mode that is flown, and the one that was meant."""
    number = a.flavour.modes[a.commander.mode]
    return mavlink.MAVLink_current_mode_message(0, number, number)


def estimator_status(a: FlightStack) -> Any:
    """ESTIMATOR_STATUS (PX4 only)."""
    h, v, _ = a.config.preset.gnss_accuracy_m
    flags = 1023 if a.commander.ready(a.now) else 0x1
    return mavlink.MAVLink_estimator_status_message(
        a.boot_ms * 1000, flags, *(0.03, 0.03, 0.02, 0.07, 0.0, _NAN), h / 3, v / 3
    )


def ekf_status_report(a: FlightStack) -> Any:
    """EKF_STATUS_REPORT (ArduPilot only): 0x218 are the position flags that say it is ready."""
    flags = 831 if a.commander.ready(a.now) else 0x127
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.01, 0.01, 0.01, 0.02, 0.0)


def mission_current(a: FlightStack) -> Any:
    """MISSION_CURRENT."""
    return mavlink.MAVLink_mission_current_message(a.plan.current)


def system_time(a: FlightStack) -> Any:
    """SYSTEM_TIME."""
    return mavlink.MAVLink_system_time_message(round(a.unix_s * 1e6), a.boot_ms)


def gimbal_attitude(a: FlightStack) -> Any | None:
    """GIMBAL_DEVICE_ATTITUDE_STATUS, as often as it is asked for: of a slower gimbal the same angles come again."""
    return None if a.gimbal is None else a.gimbal.attitude_status(a.now, a.boot_ms)


def gimbal_manager_status(a: FlightStack) -> Any | None:
    """GIMBAL_MANAGER_STATUS: who commands it."""
    return None if a.gimbal is None else a.gimbal.status(a.boot_ms)


def gimbal_manager_information(a: FlightStack) -> Any | None:
    """GIMBAL_MANAGER_INFORMATION: how far it turns."""
    return None if a.gimbal is None else a.gimbal.information(a.boot_ms)


def timesync(a: FlightStack) -> Any:
    """TIMESYNC: our question to the peer."""
    return mavlink.MAVLink_timesync_message(0, round(a.boot_s * 1e9))


_BOTH: Mapping[int, Callable[[FlightStack], Any]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: mission_current,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: position_target_local_ned,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: position_target_global_int,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: timesync,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: gimbal_attitude,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: gimbal_manager_status,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: gimbal_manager_information,
}
GIMBAL_MESSAGES = (
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS,
    mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION,
)
GIMBAL_HZ: Mapping[str, Mapping[int, float]] = {
    "px4": {
        mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 1.0,
        mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: 0.5,
    },
    "ardupilot": {},
}
"""What an aircraft with a gimbal sends of it unasked."""
BUILDERS: Mapping[str, Mapping[int, Callable[[FlightStack], Any]]] = {
    "px4": {
        **_BOTH,
        mavlink.MAVLINK_MSG_ID_ALTITUDE: altitude,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator_status,
        mavlink.MAVLINK_MSG_ID_CURRENT_MODE: current_mode,
    },
    "ardupilot": {**_BOTH, mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ekf_status_report},
}
"""How each message is made, by id; what is not here this autopilot does not send."""


def build(a: FlightStack, message_id: int) -> Any | None:
    """A message as of now; None if this autopilot does not have it, or has nothing to say."""
    builder = BUILDERS[a.flavour.name].get(message_id)
    return None if builder is None else builder(a)


def sends(a: FlightStack, message_id: int) -> bool:
    """Whether this autopilot has a message at all."""
    if message_id in GIMBAL_MESSAGES and a.gimbal is None:
        return False
    return message_id in BUILDERS[a.flavour.name]


def silent(a: FlightStack, message_id: int) -> bool:
    """Whether a regular message has nothing to say now.

    PX4 has no position target outside of flight. ArduPilot has one only while it goes to a place by itself: in GUIDED
    not while it follows positions with velocities (ModeGuided::get_wp).
    """
    if message_id != mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT:
        return False
    if a.flavour.name == "px4":
        return not a.commander.armed or a.commander.mode is Mode.LAND
    return not a.commander.armed or a.navigator.destination is None


def _volts(a: FlightStack) -> float:
    empty, full = _CELLS_V
    return 4 * (empty + (full - empty) * a.commander.battery_fraction)


def _int16(value: float) -> int:
    return max(-32767, min(32767, round(value)))
