"""Telemetry logs of QGroundControl, Mission Planner and MAVProxy: 8-byte big-endian UNIX microseconds, then a frame."""

from __future__ import annotations

import math
import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import all as mavlink
from scipy.spatial.transform import Rotation

from mission.errors import LogError
from mission.logs.pose_log import Attitudes, PoseLog
from mission.logs.series import attitudes, enu_from_ned, median_or_none, pose_noise, positions, utc_at_zero
from mission.pose.buffer import heading, world_from_body
from mission.records import Matrix
from mission.vehicle.state.vehicle_state import VEHICLE_MESSAGES, VehicleState, on_earth

_V1, _V2 = mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2
_NAMES: Final = (*VEHICLE_MESSAGES, "SYSTEM_TIME", "GIMBAL_DEVICE_ATTITUDE_STATUS")
_WANTED: Final = frozenset(
    number for number, kind in mavlink.mavlink_map.items() if kind.msgname in _NAMES and number >= 0
)
_EARLIEST_US, _LATEST_US = 946_684_800_000_000, 4_102_444_800_000_000
"""2000 and 2100: times of frames are between."""
_EARLIEST_UTC_S = 1e9
_YAW_FROM_VEHICLE = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
_YAW_FROM_NORTH = mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME
_YAW_LOCK = mavlink.GIMBAL_DEVICE_FLAGS_YAW_LOCK


def frames(path: Path) -> Iterator[tuple[float, bytes]]:
    """Arrival time (UNIX seconds) and bytes of each frame; what is no frame is passed over.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        if path.stat().st_size == 0:
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            at, size = 0, len(data)
            while at + 8 + 8 <= size:
                (microseconds,) = struct.unpack_from(">Q", data, at)
                marker = data[at + 8]
                if marker == _V2 and at + 20 <= size:
                    signed = 13 if data[at + 10] & mavlink.MAVLINK_IFLAG_SIGNED else 0
                    length = 12 + data[at + 9] + signed
                elif marker == _V1:
                    length = 8 + data[at + 9]
                else:
                    length = 0
                if not length or not _EARLIEST_US < microseconds < _LATEST_US or at + 8 + length > size:
                    at += 1
                    continue
                yield microseconds * 1e-6, data[at + 8 : at + 8 + length]
                at += 8 + length


def message_id(frame: bytes) -> int:
    """Of a frame of MAVLink 1 or 2."""
    return frame[5] if frame[0] == _V1 else int.from_bytes(frame[7:10], "little")


def messages(path: Path) -> Iterator[tuple[float, Any]]:
    """Arrival time and message of each whole frame that says something of a pose."""
    decoder = mavlink.MAVLink(None)
    for arrived_s, frame in frames(path):
        if message_id(frame) in _WANTED:
            try:
                yield arrived_s, decoder.decode(bytearray(frame))
            except (mavlink.MAVError, struct.error, UnicodeDecodeError, IndexError):
                continue


def read_tlog(path: Path, system: int = 0) -> PoseLog:
    """The flight of one vehicle in a telemetry log.

    Args:
        path: the log.
        system: the vehicle's system id; 0 takes the first autopilot that is heard.

    Raises:
        LogError: it holds no flight.
        OSError: it cannot be read.
    """
    vehicle, rows, number = VehicleState(system), _Rows(), 0
    for arrived_s, message in messages(path):
        number += 1
        name = message.get_type()
        if name in VEHICLE_MESSAGES:
            vehicle.update(message, arrived_s)
        if message.get_srcSystem() == vehicle.system:
            rows.take(name, message, arrived_s)
    if number == 0:
        raise LogError(f"{path.name} holds no MAVLink telemetry", "Give the log that the ground station wrote.")
    if not rows.place:
        raise LogError(
            f"{path.name} holds no positions (GLOBAL_POSITION_INT)", "Give the log of a flight that had a GPS fix."
        )
    separation = vehicle.geoid_separation_m
    place = np.array(rows.place)
    place[:, 2] += separation or 0.0
    origin, series = positions(rows.place_s, place, rows.speed, "amsl" if separation is None else "ellipsoid")
    aircraft = attitudes(rows.turned_s, rows.turned)
    gimbal = None if aircraft is None else rows.gimbal(aircraft)
    accuracy = median_or_none(rows.accuracy)
    pointing = aircraft if gimbal is None else gimbal
    height = np.array(rows.height)
    take_off = None if not len(height) else float(np.median(place[: len(height), 2] - height)) - origin.alt_m
    return PoseLog(
        "tlog",
        "vehicle",
        origin,
        series,
        aircraft,
        gimbal,
        pose_noise(accuracy, pointing, gimbal=gimbal is not None),
        utc_at_zero_s=utc_at_zero(rows.utc or rows.arrived),
        accuracy_m=accuracy,
        take_off_up_m=take_off,
        geoid_separation_m=separation,
    )


class _Rows:
    """What the messages of one vehicle tell, in the order of the file; times are its boot's."""

    def __init__(self) -> None:
        self.place_s: list[float] = []
        self.place: list[tuple[float, float, float]] = []
        self.speed: list[tuple[float, float, float]] = []
        self.height: list[float] = []
        self.turned_s: list[float] = []
        self.turned: list[Any] = []
        self.held_s: list[float] = []
        self.held: list[tuple[float, float, float, float, int, float]] = []
        self.accuracy: list[float] = []
        self.utc: list[tuple[float, float]] = []
        self.arrived: list[tuple[float, float]] = []

    def take(self, name: str, message: Any, arrived_s: float) -> None:
        """Of a message."""
        if name == "GIMBAL_DEVICE_ATTITUDE_STATUS":
            self.held_s.append(message.time_boot_ms * 1e-3)
            w, x, y, z = (float(part) for part in message.q)
            self.held.append((w, x, y, z, int(message.flags), float(message.delta_yaw)))
            return
        if message.get_srcComponent() != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return
        if name == "GLOBAL_POSITION_INT" and on_earth(message.lat, message.lon):
            self.place_s.append(message.time_boot_ms * 1e-3)
            self.place.append((message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3))
            self.speed.append((message.vy * 0.01, message.vx * 0.01, -message.vz * 0.01))
            self.height.append(message.relative_alt * 1e-3)
            self.arrived.append((message.time_boot_ms * 1e-3, arrived_s))
        elif name == "ATTITUDE" and all(map(math.isfinite, (message.roll, message.pitch, message.yaw))):
            self.turned_s.append(message.time_boot_ms * 1e-3)
            self.turned.append(world_from_body(message.roll, message.pitch, message.yaw))
        elif name == "SYSTEM_TIME" and message.time_unix_usec * 1e-6 > _EARLIEST_UTC_S:
            self.utc.append((message.time_boot_ms * 1e-3, message.time_unix_usec * 1e-6))
        elif name in ("GPS_RAW_INT", "GPS2_RAW") and message.h_acc:
            self.accuracy.append(message.h_acc * 1e-3)

    def gimbal(self, aircraft: Attitudes) -> Attitudes | None:
        """The camera's attitude: q turns the horizon's frame into the camera, its yaw from north or from the nose.

        GIMBAL_DEVICE_ATTITUDE_STATUS, https://mavlink.io/en/services/gimbal_v2.html; where the flags name no frame, the
        yaw is from north when it is locked.
        """
        if len(self.held) < 2:
            return None
        t_s, told = np.array(self.held_s), np.array(self.held)
        flags, delta = told[:, 4].astype(int), told[:, 5]
        named = (flags & (_YAW_FROM_VEHICLE | _YAW_FROM_NORTH)) != 0
        from_nose = np.where(named, (flags & _YAW_FROM_VEHICLE) != 0, (flags & _YAW_LOCK) == 0)
        nose = nose_at(aircraft, t_s)
        # With a frame named, delta_yaw is the gimbal's own idea of the vehicle's heading; 0 where it has none.
        nose = np.where(named & np.isfinite(delta) & (delta != 0.0), delta, nose)
        inside = (t_s >= aircraft.t_s[0]) & (t_s <= aircraft.t_s[-1]) & (np.abs(told[:, :4]).sum(axis=1) > 0.5)
        inside &= np.isfinite(told[:, :4]).all(axis=1)
        if np.count_nonzero(inside) < 2:
            return None
        turned = turned_by(told[inside, :4], np.where(from_nose, nose, 0.0)[inside])
        return attitudes(t_s[inside], enu_from_ned(turned))


def nose_at(aircraft: Attitudes, t_s: Matrix) -> Matrix:
    """(n,) heading of the nose at some times, radians."""
    told = np.unwrap([heading(wxyz) for wxyz in aircraft.world_from_body_wxyz])
    return np.asarray(np.interp(t_s, aircraft.t_s, told))


def turned_by(wxyz: Matrix, yaw_rad: Matrix) -> Matrix:
    """Quaternions (n, 4) turned further about the vertical, clockwise from above."""
    turn = Rotation.from_euler("z", np.asarray(yaw_rad))
    return np.asarray((turn * Rotation.from_quat(wxyz, scalar_first=True)).as_quat(scalar_first=True))
