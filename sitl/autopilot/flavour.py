"""What distinguishes PX4 from ArduPilot Copter where a companion computer can notice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.config import FlavourName
from sitl.autopilot.flight_controller import ARDUPILOT_GAINS, PX4_GAINS, Gains
from sitl.autopilot.trajectory import ARDUPILOT_LIMITS, PX4_LIMITS, Limits


class Mode(Enum):
    """Flight modes, named after what they do; ArduPilot's GUIDED is OFFBOARD, its LOITER is HOLD."""

    STABILIZE = "stabilize"
    OFFBOARD = "offboard"
    HOLD = "hold"
    BRAKE = "brake"
    POSITION = "position"
    MISSION = "mission"
    RTL = "rtl"
    LAND = "land"
    TAKEOFF = "takeoff"


@dataclass(frozen=True, slots=True)
class Flavour:
    """One autopilot's numbers; rates in Hz of what it sends without being asked."""

    name: FlavourName
    autopilot: int
    modes: Mapping[Mode, int]
    """custom_mode of the heartbeat."""
    start_mode: Mode
    base_modes: Mapping[Mode, int]
    """base_mode without the armed flag."""
    capabilities: int
    gains: Gains
    limits: Limits
    drag_n_s_m: float
    default_rates: Mapping[int, float]
    fastest_hz: float
    slow_hz: Mapping[int, float]
    """Messages that come no faster than this whatever is asked for, but at once when they change."""
    tells_geoid: bool
    """Whether GPS_RAW_INT's ellipsoid altitude is one; PX4's SIH repeats the one above mean sea level."""
    takeoff_ramp_s: float
    takeoff_delay_s: float
    landing_wait_s: float
    asks_mission_int: bool
    home_is_item_0: bool
    parameters: Mapping[str, int | float]
    sensors: int
    """MAV_SYS_STATUS_SENSOR present, enabled and healthy when ready."""

    def mode_of(self, custom_mode: int) -> Mode | None:
        """The mode with this number, None if there is none."""
        return next((mode for mode, number in self.modes.items() if number == custom_mode), None)


def px4_mode(main: int, sub: int = 0) -> int:
    """PX4's custom_mode of a main and a sub mode."""
    return main << 16 | sub << 24


_COMMON_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)

PX4 = Flavour(
    name="px4",
    autopilot=mavlink.MAV_AUTOPILOT_PX4,
    modes={
        Mode.POSITION: px4_mode(3),
        Mode.TAKEOFF: px4_mode(4, 2),
        Mode.HOLD: px4_mode(4, 3),
        Mode.MISSION: px4_mode(4, 4),
        Mode.RTL: px4_mode(4, 5),
        Mode.LAND: px4_mode(4, 6),
        Mode.OFFBOARD: px4_mode(6),
    },
    start_mode=Mode.HOLD,
    base_modes={Mode.POSITION: 81, Mode.OFFBOARD: 17},
    capabilities=_COMMON_CAPABILITIES | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE,
    gains=PX4_GAINS,
    limits=PX4_LIMITS,
    drag_n_s_m=1.0,
    default_rates={
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        mavlink.MAVLINK_MSG_ID_ATTITUDE: 20.0,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 10.0,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 10.0,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 2.0,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 1.5,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 5.0,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION: 1.0,
        mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
        mavlink.MAVLINK_MSG_ID_ALTITUDE: 1.0,
        mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 0.5,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.5,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        mavlink.MAVLINK_MSG_ID_TIMESYNC: 1.0,
    },
    fastest_hz=124.0,
    slow_hz={mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 1.8},
    tells_geoid=False,
    takeoff_ramp_s=3.0,
    takeoff_delay_s=1.0,
    landing_wait_s=2.0,
    asks_mission_int=True,
    home_is_item_0=False,
    parameters={
        "COM_OF_LOSS_T": 1.0,
        "COM_OBL_RC_ACT": 0,
        "COM_RC_OVERRIDE": 1,
        "COM_LOW_BAT_ACT": 0,
        "COM_DISARM_PRFLT": 10.0,
        "BAT_LOW_THR": 0.15,
        "GF_ACTION": 2,
        "GF_MAX_HOR_DIST": 0.0,
        "GF_MAX_VER_DIST": 0.0,
        "MIS_TAKEOFF_ALT": 3.0,
        "MPC_XY_CRUISE": 5.0,
        "RTL_RETURN_ALT": 30.0,
        "RTL_DESCEND_ALT": 10.0,
        "SYS_AUTOSTART": 10040,
        "MAV_SYS_ID": 1,
    },
    sensors=0x0300402F,
)

_ARDUPILOT_BASE = 89

ARDUPILOT = Flavour(
    name="ardupilot",
    autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    modes={
        Mode.STABILIZE: 0,
        Mode.MISSION: 3,
        Mode.OFFBOARD: 4,
        Mode.HOLD: 5,
        Mode.RTL: 6,
        Mode.LAND: 9,
        Mode.POSITION: 16,
        Mode.BRAKE: 17,
    },
    start_mode=Mode.STABILIZE,
    base_modes={Mode.STABILIZE: 81},
    capabilities=_COMMON_CAPABILITIES | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
    gains=ARDUPILOT_GAINS,
    limits=ARDUPILOT_LIMITS,
    drag_n_s_m=0.3,
    default_rates={mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0, mavlink.MAVLINK_MSG_ID_TIMESYNC: 0.1},
    fastest_hz=200.0,
    slow_hz={},
    tells_geoid=True,
    takeoff_ramp_s=1.5,
    takeoff_delay_s=0.7,
    landing_wait_s=2.0,
    asks_mission_int=False,
    home_is_item_0=True,
    parameters={
        "GUID_TIMEOUT": 3.0,
        "BATT_FS_LOW_ACT": 0,
        "BATT_LOW_FRACTION": 0.15,
        "DISARM_DELAY": 10.0,
        "FENCE_ENABLE": 0,
        "FENCE_ACTION": 1,
        "FENCE_TYPE": 7,
        "FENCE_RADIUS": 300.0,
        "FENCE_ALT_MAX": 100.0,
        "FENCE_ALT_MIN": -10.0,
        "FENCE_TOTAL": 0,
        "FENCE_AUTOENABLE": 0,
        "FENCE_OPTIONS": 0,
        "RCMAP_THROTTLE": 3,
        "RTL_ALT": 1500.0,
        "WPNAV_SPEED": 500.0,
        "SYSID_THISMAV": 1,
        "FRAME_CLASS": 1,
    },
    sensors=0x5361FC2F,
)

FLAVOURS: Mapping[FlavourName, Flavour] = {"px4": PX4, "ardupilot": ARDUPILOT}


def base_mode(flavour: Flavour, mode: Mode, armed: bool) -> int:
    """The heartbeat's base_mode."""
    usual = 29 if flavour.name == "px4" else _ARDUPILOT_BASE
    return flavour.base_modes.get(mode, usual) | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
