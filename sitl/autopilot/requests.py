"""Messages that ask the autopilot for something: setpoints, parameters, missions, time, and `commands`."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot import commands
from sitl.autopilot.flavour import Mode
from sitl.autopilot.flight_stack import FlightStack
from sitl.autopilot.link import Link
from sitl.autopilot.parameters import decode_name
from sitl.autopilot.peers import Peers
from sitl.autopilot.setpoint import global_setpoint, local_setpoint

_STREAM_GROUPS = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: ("GPS_RAW_INT",),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: ("SYS_STATUS", "MISSION_CURRENT", "GPS_RAW_INT"),
    mavlink.MAV_DATA_STREAM_POSITION: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    mavlink.MAV_DATA_STREAM_EXTRA1: ("ATTITUDE",),
    mavlink.MAV_DATA_STREAM_EXTRA2: ("VFR_HUD",),
    mavlink.MAV_DATA_STREAM_EXTRA3: ("BATTERY_STATUS", "SYSTEM_TIME", "EKF_STATUS_REPORT"),
}


class Requests:
    """Answers every message that a peer may send; what makes no sense is ignored."""

    def __init__(self, stack: FlightStack, peers: Peers) -> None:
        self._a, self._peers = stack, peers

    def handle(self, link: Link, message: Any) -> None:
        """Act on one message that is for us."""
        kind = message.get_type()
        if kind in ("COMMAND_LONG", "COMMAND_INT"):
            order = commands.from_message(message)
            result = commands.execute(self._a, link, order)
            source = (message.get_srcSystem(), message.get_srcComponent())
            link.send(mavlink.MAVLink_command_ack_message(order.command, result, 0, 0, *source))
        elif kind == "SET_POSITION_TARGET_LOCAL_NED":
            demand = local_setpoint(message, self._a.flavour, self._a.vehicle.estimate)
            if demand is not None:
                self._a.commander.set_setpoint(demand, self._a.now)
        elif kind == "SET_POSITION_TARGET_GLOBAL_INT":
            demand = global_setpoint(message, self._a.flavour, self._a.place, self._home_alt)
            if demand is not None:
                self._a.commander.set_setpoint(demand, self._a.now)
        elif kind == "GIMBAL_MANAGER_SET_PITCHYAW":
            if self._a.gimbal is not None:
                self._a.gimbal.set_pitch_yaw((message.get_srcSystem(), message.get_srcComponent()), message)
        elif kind.startswith("MISSION_"):
            self._plan(link, message)
        elif kind.startswith("PARAM_"):
            self._parameter(link, message)
        elif kind == "TIMESYNC" and message.tc1 == 0:
            link.send(mavlink.MAVLink_timesync_message(round(self._a.boot_s * 1e9), message.ts1))
        elif kind == "SET_MODE":
            mode = self._a.flavour.mode_of(message.custom_mode)
            if mode is not None:
                self._a.commander.request_mode(mode, self._a.now)
        elif kind == "REQUEST_DATA_STREAM":
            self._streams(link, message)
        elif kind == "PING" and message.target_system == 0:
            source = (message.get_srcSystem(), message.get_srcComponent())
            link.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *source))

    @property
    def _home_alt(self) -> float:
        return self._a.place.alt_amsl_m + self._a.home_up

    def _plan(self, link: Link, message: Any) -> None:
        a, kind = self._a, message.get_type()
        if kind == "MISSION_SET_CURRENT":
            if a.plan.select(message.seq):
                self._peers.send_all(mavlink.MAVLink_mission_current_message(a.plan.current))
        elif kind in ("MISSION_ITEM", "MISSION_ITEM_INT") and message.current == 2 and a.flavour.name == "ardupilot":
            self._fly_here(link, message)
        else:
            self._peers.plan_message(link, message)

    def _fly_here(self, link: Link, message: Any) -> None:
        """ArduPilot's old way to order a guided waypoint."""
        a, scale = self._a, 1.0 if message.get_type() == "MISSION_ITEM" else 1e7
        alt = message.z + (0.0 if message.frame == mavlink.MAV_FRAME_GLOBAL else self._home_alt)
        source = (message.get_srcSystem(), message.get_srcComponent())
        sane = all(map(math.isfinite, (message.x, message.y, message.z)))
        if a.commander.mode is Mode.OFFBOARD and a.commander.armed and sane:
            a.commander.setpoint, a.commander.taking_off = None, False
            a.navigator.reposition = (a.place.enu(message.x / scale, message.y / scale, alt), None)
            link.send(mavlink.MAVLink_mission_ack_message(*source, mavlink.MAV_MISSION_ACCEPTED))
        else:
            link.send(mavlink.MAVLink_mission_ack_message(*source, mavlink.MAV_MISSION_ERROR))

    def _parameter(self, link: Link, message: Any) -> None:
        parameters, kind = self._a.parameters, message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._peers.dump_parameters(link)
        elif kind == "PARAM_REQUEST_READ":
            index = message.param_index
            name = decode_name(message.param_id) if index < 0 else parameters.name_at(index)
            if name is not None and parameters.known(name):
                link.send(parameters.value_message(name))
        elif kind == "PARAM_SET":
            name = decode_name(message.param_id)
            if not parameters.known(name):
                return
            value = parameters.decode(name, message.param_value, message.param_type)
            if value is not None:
                parameters.set_number(name, value)
            self._peers.send_all(parameters.value_message(name))

    def _streams(self, link: Link, message: Any) -> None:
        """REQUEST_DATA_STREAM, the old way, which ground stations still use with ArduPilot."""
        if self._a.flavour.name != "ardupilot":
            return
        every = message.req_stream_id == mavlink.MAV_DATA_STREAM_ALL
        groups = _STREAM_GROUPS.values() if every else [_STREAM_GROUPS.get(message.req_stream_id, ())]
        wanted = message.start_stop and message.req_message_rate > 0
        for name in {name for group in groups for name in group}:
            message_id = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
            link.set_interval(message_id, 1.0 / message.req_message_rate if wanted else None)
