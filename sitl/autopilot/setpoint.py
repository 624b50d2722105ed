"""SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT, with their masks and frames, to an ENU demand.

The two autopilots read the masks differently: PX4 takes each axis by itself (its mavlink_receiver.cpp), ArduPilot only
all three axes of position, velocity or acceleration together (its GCS_MAVLink_Copter.cpp).
"""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot.flavour import Flavour
from sitl.autopilot.flight_controller import Demand, EstimatedState, MaybeVec
from sitl.autopilot.local_frame import LocalFrame
from sitl.autopilot.rotation import Vec, ned, wrap

_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED)
_OFFSET_FRAMES = (*_BODY_FRAMES, mavlink.MAV_FRAME_LOCAL_OFFSET_NED)
_AMSL_FRAMES = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE_FRAMES = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)


def local_setpoint(message: Any, flavour: Flavour, state: EstimatedState) -> Demand | None:
    """The demand in a SET_POSITION_TARGET_LOCAL_NED; None if this autopilot does not take it."""
    frame = message.coordinate_frame
    position = ned((message.x, message.y, message.z))
    velocity = ned((message.vx, message.vy, message.vz))
    acceleration = ned((message.afx, message.afy, message.afz))
    if frame in _BODY_FRAMES:
        velocity, acceleration = _turned(velocity, state.heading), _turned(acceleration, state.heading)
        position = _turned(position, state.heading)
    elif frame not in (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED):
        return None
    mask = message.type_mask
    if flavour.name == "px4":
        if frame == mavlink.MAV_FRAME_BODY_NED:
            mask |= 0b111  # positions in the body frame are ignored
        elif frame != mavlink.MAV_FRAME_LOCAL_NED:
            return None
    elif frame in _OFFSET_FRAMES:
        e, n, u = state.position
        position = (position[0] + e, position[1] + n, position[2] + u)
    yaw = message.yaw + state.heading if frame in _BODY_FRAMES and flavour.name == "ardupilot" else message.yaw
    return _masked(flavour, mask, position, velocity, acceleration, yaw, message.yaw_rate)


def global_setpoint(message: Any, flavour: Flavour, place: LocalFrame, home_alt_amsl_m: float) -> Demand | None:
    """The demand in a SET_POSITION_TARGET_GLOBAL_INT; None if this autopilot does not take it."""
    if message.coordinate_frame in _AMSL_FRAMES:
        alt = message.alt
    elif message.coordinate_frame in _RELATIVE_FRAMES:
        alt = message.alt + home_alt_amsl_m
    else:
        return None
    position = place.enu(message.lat_int / 1e7, message.lon_int / 1e7, alt)
    velocity = ned((message.vx, message.vy, message.vz))
    acceleration = ned((message.afx, message.afy, message.afz))
    return _masked(flavour, message.type_mask, position, velocity, acceleration, message.yaw, message.yaw_rate)


def _turned(v: Vec, heading: float) -> Vec:
    """ENU of what was given as forward and right instead of north and east."""
    right, forward, up = v
    c, s = math.cos(heading), math.sin(heading)
    return forward * s + right * c, forward * c - right * s, up


def _masked(
    flavour: Flavour, mask: int, position: Vec, velocity: Vec, acceleration: Vec, yaw: float, yaw_rate: float
) -> Demand | None:
    if mask & mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET:
        return None
    places = _chosen(position, mask & 0b111, flavour)
    speeds = _chosen(velocity, mask >> 3 & 0b111, flavour)
    pushes = _chosen(acceleration, mask >> 6 & 0b111, flavour)
    if all(a is None for a in (*places, *speeds, *pushes)):
        return None
    east, north, up = pushes
    return Demand(
        places,
        speeds,
        (east or 0.0, north or 0.0, up or 0.0),
        None if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE or not math.isfinite(yaw) else wrap(yaw),
        None if mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE or not math.isfinite(yaw_rate) else yaw_rate,
    )


def _chosen(v: Vec, ned_ignore: int, flavour: Flavour) -> MaybeVec:
    """The axes that the mask leaves in (bit 0 is north) and that are numbers; ENU."""
    if flavour.name == "ardupilot" and ned_ignore:
        return None, None, None
    ignored = (ned_ignore >> 1 & 1, ned_ignore & 1, ned_ignore >> 2 & 1)
    if flavour.name == "ardupilot" and not all(map(math.isfinite, v)):
        return None, None, None
    east, north, up = (None if skip or not math.isfinite(a) else a for a, skip in zip(v, ignored, strict=True))
    return east, north, up
