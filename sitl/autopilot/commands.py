"""MAV_CMD_*: what the autopilot does with COMMAND_LONG and COMMAND_INT, and what it answers (MAV_RESULT).

A command that is sent again (its ack was lost) is done again: all of them are safe to repeat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.commander import ACCEPTED, DENIED, FAILED, REJECTED, UNSUPPORTED
from sitl.autopilot.flavour import Mode, px4_mode
from sitl.autopilot.flight_stack import FlightStack
from sitl.autopilot.link import Link
from sitl.autopilot.rotation import Vec, wrap
from sitl.autopilot.telemetry import build, sends

_FORCE = 21196
_RELATIVE = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)


@dataclass(frozen=True, slots=True)
class CommandOrder:
    """A command with its seven parameters; latitude and longitude in degrees."""

    command: int
    params: tuple[float, float, float, float]
    lat_deg: float
    lon_deg: float
    alt_m: float
    relative: bool
    """Whether the altitude counts from home instead of mean sea level."""
    source: tuple[int, int] = (0, 0)
    """System and component of who gives it."""


def from_message(message: Any) -> CommandOrder:
    """The order in a COMMAND_LONG (altitudes above mean sea level, frame 0) or a COMMAND_INT."""
    params = (message.param1, message.param2, message.param3, message.param4)
    source = (message.get_srcSystem(), message.get_srcComponent())
    if message.get_type() == "COMMAND_INT":
        unset = message.x == 0x7FFFFFFF
        lat, lon = (math.nan, math.nan) if unset else (message.x / 1e7, message.y / 1e7)
        return CommandOrder(message.command, params, lat, lon, message.z, message.frame in _RELATIVE, source)
    return CommandOrder(message.command, params, message.param5, message.param6, message.param7, False, source)


def execute(a: FlightStack, link: Link, order: CommandOrder) -> int:
    """Do it; the MAV_RESULT."""
    action = _ACTIONS.get(order.command)
    return UNSUPPORTED if action is None else action(a, link, order)


def _refusal(a: FlightStack) -> int:
    return FAILED if a.flavour.name == "ardupilot" else DENIED


def _position(a: FlightStack, order: CommandOrder, above_home: bool) -> Vec | None:
    """ENU of an order's place, None if it has none."""
    if not all(map(math.isfinite, (order.lat_deg, order.lon_deg))) or abs(order.lat_deg) > 90.0:
        return None
    if abs(order.lon_deg) > 180.0:
        return None
    up = a.vehicle.estimate.position[2]
    if math.isfinite(order.alt_m):
        up = order.alt_m + a.home_up if above_home else order.alt_m - a.place.alt_amsl_m
    east, north, _ = a.place.enu(order.lat_deg, order.lon_deg, 0.0)
    return east, north, up


def _arm(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    force = order.params[1] == _FORCE
    if order.params[0] == 1.0:
        return a.commander.arm(a.now, a.vehicle.estimate, force)
    return a.commander.disarm(force) if order.params[0] == 0.0 else _refusal(a)


def _take_off(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    """NAV_TAKEOFF: the altitude is above home on ArduPilot, above mean sea level on PX4."""
    if a.flavour.name == "ardupilot":
        sane = math.isfinite(order.alt_m) and 0.0 < order.alt_m < 1000.0
        return a.commander.take_off(a.commander.home[2] + order.alt_m) if sane else FAILED
    if not a.commander.ready(a.now):
        return REJECTED
    if math.isfinite(order.alt_m):
        height = order.alt_m - a.place.alt_amsl_m
    else:
        wanted = a.parameters.number("MIS_TAKEOFF_ALT")
        a.commander.say(f"Using default takeoff altitude: {wanted:.1f} m")
        height = a.vehicle.estimate.position[2] + wanted
    return a.commander.take_off(height)


def _mode_command(mode: Mode) -> Callable[[FlightStack, Link, CommandOrder], int]:
    def change(a: FlightStack, _link: Link, _order: CommandOrder) -> int:
        return a.commander.request_mode(mode, a.now)

    return change


def _set_mode(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    """DO_SET_MODE: param1 = 1 (custom); param2 is the number, on PX4 the main mode with the sub mode in param3."""
    main, sub = order.params[1], order.params[2]
    if not int(_number(order.params[0])) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED or not math.isfinite(main):
        return _refusal(a)
    number = int(main)
    if a.flavour.name == "px4":
        number = px4_mode(int(main) & 0xFF, int(_number(sub)) & 0xFF)
    mode = a.flavour.mode_of(number)
    return _refusal(a) if mode is None else a.commander.request_mode(mode, a.now)


def _reposition(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    """DO_REPOSITION: an operator's "fly here". PX4 goes to Hold, ArduPilot does it in GUIDED (or changes if asked)."""
    c = a.commander
    place = _position(a, order, order.relative)
    if place is None or c.landed or not c.armed:
        return _refusal(a)
    if a.flavour.name == "px4":
        yaw = order.params[3] if math.isfinite(order.params[3]) else None
        result = c.request_mode(Mode.HOLD, a.now)
    else:
        yaw = None
        if c.mode is not Mode.OFFBOARD:
            if not int(_number(order.params[1])) & 1:
                return DENIED
            c.request_mode(Mode.OFFBOARD, a.now)
        c.setpoint, c.taking_off = None, False
        c.mode_changes += 1
        result = ACCEPTED
    a.navigator.reposition = (place, yaw)
    return result


def _roi(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    place = _position(a, order, order.relative)
    if place is None:
        return _refusal(a)
    a.commander.roi = place
    return ACCEPTED


def _roi_none(a: FlightStack, _link: Link, _order: CommandOrder) -> int:
    a.commander.roi = None
    return ACCEPTED


def _gimbal_configure(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    return UNSUPPORTED if a.gimbal is None else a.gimbal.configure(order.source, order.params)


def _gimbal_pitch_yaw(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    """DO_GIMBAL_MANAGER_PITCHYAW: param5, where other commands have a latitude, holds the flags."""
    flags = int(_number(order.lat_deg))
    return UNSUPPORTED if a.gimbal is None else a.gimbal.pitch_yaw(order.source, order.params, flags)


def _set_interval(a: FlightStack, link: Link, order: CommandOrder) -> int:
    """SET_MESSAGE_INTERVAL: microseconds; 0 the default rate, -1 off; for the link on which it came."""
    wanted, microseconds = _number(order.params[0]), _number(order.params[1])
    message_id = int(wanted)
    if not sends(a, message_id):
        if a.flavour.name == "ardupilot":
            a.commander.say(f"No ap_message for mavlink id ({message_id})")
            return DENIED
        return FAILED
    if microseconds == 0.0:
        rate = link.defaults.get(message_id, 0.0)
        link.set_interval(message_id, 1.0 / rate if rate > 0.0 else None)
    elif microseconds < 0.0:
        link.set_interval(message_id, None)
    else:
        most_hz = a.flavour.slow_hz.get(message_id, a.flavour.fastest_hz)
        link.set_interval(message_id, max(1.0 / most_hz, microseconds * 1e-6))
    return ACCEPTED


def _get_interval(a: FlightStack, link: Link, order: CommandOrder) -> int:
    message_id = int(_number(order.params[0]))
    if not sends(a, message_id):
        link.send(mavlink.MAVLink_message_interval_message(message_id & 0xFFFF, 0))
        return _refusal(a)
    interval = link.intervals.get(message_id)
    microseconds = -1 if interval is None else round(interval * 1e6)
    link.send(mavlink.MAVLink_message_interval_message(message_id, microseconds))
    return ACCEPTED


def _send_message(message_id: int | None = None) -> Callable[[FlightStack, Link, CommandOrder], int]:
    def send(a: FlightStack, link: Link, order: CommandOrder) -> int:
        message = build(a, int(_number(order.params[0])) if message_id is None else message_id)
        if message is None:
            return _refusal(a)
        link.send(message)
        return ACCEPTED

    return send


def _start_mission(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    if a.flavour.name == "ardupilot" and not a.commander.armed:
        return FAILED
    first = _number(order.params[0])
    a.plan.select(int(first))
    return a.commander.request_mode(Mode.MISSION, a.now)


def _mission_item(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    return ACCEPTED if a.plan.select(int(_number(order.params[0]))) else _refusal(a)


def _pause(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    if order.params[0] == 0.0:
        return a.commander.request_mode(Mode.HOLD, a.now)
    return a.commander.request_mode(Mode.MISSION, a.now)


def _turn(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    """CONDITION_YAW: ArduPilot in GUIDED only."""
    if a.flavour.name == "px4":
        return UNSUPPORTED
    angle = math.radians(_number(order.params[0]))
    if a.commander.mode is not Mode.OFFBOARD:
        return FAILED
    if order.params[3] == 1.0:
        angle = a.vehicle.estimate.heading + math.copysign(angle, _number(order.params[2]) or 1.0)
    a.navigator.condition_yaw = wrap(angle)
    return ACCEPTED


def _set_home(a: FlightStack, _link: Link, order: CommandOrder) -> int:
    place = a.vehicle.estimate.position if order.params[0] == 1.0 else _position(a, order, order.relative)
    if place is None:
        return _refusal(a)
    a.commander.home = place
    return ACCEPTED


def _accept(_a: FlightStack, _link: Link, _order: CommandOrder) -> int:
    return ACCEPTED


def _number(value: float) -> float:
    """A parameter of which NaN means "not given"."""
    return value if math.isfinite(value) else 0.0


_ACTIONS: Mapping[int, Callable[[FlightStack, Link, CommandOrder], int]] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    mavlink.MAV_CMD_NAV_TAKEOFF: _take_off,
    mavlink.MAV_CMD_NAV_LAND: _mode_command(Mode.LAND),
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: _mode_command(Mode.RTL),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: _mode_command(Mode.HOLD),
    mavlink.MAV_CMD_DO_SET_MODE: _set_mode,
    mavlink.MAV_CMD_DO_REPOSITION: _reposition,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: _pause,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _accept,
    mavlink.MAV_CMD_DO_SET_HOME: _set_home,
    mavlink.MAV_CMD_DO_SET_ROI: _roi,
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION: _roi,
    mavlink.MAV_CMD_DO_SET_ROI_NONE: _roi_none,
    mavlink.MAV_CMD_CONDITION_YAW: _turn,
    mavlink.MAV_CMD_MISSION_START: _start_mission,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: _mission_item,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: _accept,
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: _gimbal_configure,
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: _gimbal_pitch_yaw,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: _send_message(),
    mavlink.MAV_CMD_GET_HOME_POSITION: _send_message(mavlink.MAVLINK_MSG_ID_HOME_POSITION),
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _send_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
}
