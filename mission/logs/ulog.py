"""PX4's onboard logs (ULog), read with pyulog."""

from __future__ import annotations

import contextlib
import io
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pyulog import ULog
from pyulog.exceptions import ULogException

from mission.errors import LogError
from mission.logs.pose_log import Attitudes, PoseLog
from mission.logs.series import attitudes, enu_from_ned, median_or_none, pose_noise, positions, utc_at_zero
from mission.logs.tlog import nose_at, turned_by
from mission.records import Matrix, Vector

MAGIC: Final = ULog.HEADER_BYTES
_TOPICS: Final = [
    "vehicle_attitude",
    "vehicle_global_position",
    "vehicle_local_position",
    "vehicle_gps_position",
    "sensor_gps",
    "gimbal_device_attitude_status",
]
_LEAST_FIX = 3
_HEIGHTS: Final = (("altitude_ellipsoid_m", "altitude_msl_m", 1.0), ("alt_ellipsoid", "alt", 1e-3))
"""Fields of both heights, of newer firmware and of older, and what turns them into metres."""
_YAW_FROM_NORTH = 64
_YAW_LOCK = 16
_YAW_FROM_VEHICLE = 32


def read_ulog(path: Path) -> PoseLog:
    """The flight in a ULog file.

    Raises:
        LogError: it is damaged, or holds no flight.
        OSError: it cannot be read.
    """
    with contextlib.redirect_stdout(io.StringIO()):  # pyulog prints what it skips
        try:
            log = ULog(str(path), _TOPICS)
        except (ULogException, ValueError, KeyError, IndexError, TypeError, struct.error, AttributeError) as error:
            raise LogError(
                f"{path.name} is no PX4 log that can be read ({error})", "Copy it from the card again."
            ) from error
    place = _topic(log, "vehicle_global_position", "lat", "lon", "alt")
    if place is None:
        raise LogError(
            f"{path.name} holds no positions (vehicle_global_position)", "Give the log of a flight that had a GPS fix."
        )
    t_s = _seconds(place)
    geodetic = np.column_stack([place["lat"], place["lon"], place["alt"]]).astype(float)
    local = _topic(log, "vehicle_local_position", "vx", "vy", "vz")
    speed = None if local is None or len(local["vx"]) < 2 else _speed(local, t_s)
    origin, series = positions(t_s, geodetic, speed)
    aircraft = _attitudes(_topic(log, "vehicle_attitude", "q[0]", "q[3]"))
    gimbal = _gimbal(_topic(log, "gimbal_device_attitude_status", "q[0]", "q[3]", "device_flags"), aircraft)
    gps = _topic(log, "vehicle_gps_position", "time_utc_usec", "eph") or _topic(
        log, "sensor_gps", "time_utc_usec", "eph"
    )
    accuracy, pairs, separation = None, [], None
    if gps is not None:
        fixed = np.asarray(gps.get("fix_type", np.full(len(gps["eph"]), _LEAST_FIX))) >= _LEAST_FIX
        accuracy = median_or_none(np.asarray(gps["eph"], dtype=float)[fixed].tolist())
        utc = np.asarray(gps["time_utc_usec"], dtype=float) * 1e-6
        good = fixed & (utc > 1e9)
        pairs = list(zip(_seconds(gps)[good].tolist(), utc[good].tolist(), strict=True))
        separation = _separation(gps, fixed)
    ground = _take_off(local)
    return PoseLog(
        "ulog",
        "vehicle",
        origin,
        series,
        aircraft,
        gimbal,
        pose_noise(accuracy, gimbal or aircraft, gimbal=gimbal is not None),
        utc_at_zero_s=utc_at_zero(pairs),
        accuracy_m=accuracy,
        take_off_up_m=None if ground is None else ground - origin.alt_m,
        geoid_separation_m=separation,
        notes=("the log is damaged: what cannot be read is not used",) if log.file_corruption else (),
    )


def _topic(log: Any, name: str, *fields: str) -> dict[str, Any] | None:
    """The first instance of a topic, when it has these fields."""
    for data in log.data_list:
        if data.name == name and data.multi_id == 0 and all(field in data.data for field in fields):
            return dict(data.data)
    return None


def _seconds(topic: dict[str, Any]) -> Vector:
    """When it was sampled; older firmware tells only when it was published."""
    stamps = np.asarray(topic.get("timestamp_sample", topic["timestamp"]), dtype=float)
    published = np.asarray(topic["timestamp"], dtype=float)
    return np.where(stamps > 0.0, stamps, published) * 1e-6


def _speed(local: dict[str, Any], t_s: Vector) -> Matrix:
    at = _seconds(local)
    order = np.argsort(at, kind="stable")
    ned = np.column_stack([np.interp(t_s, at[order], np.asarray(local[axis], dtype=float)[order]) for axis in _AXES])
    return np.column_stack([ned[:, 1], ned[:, 0], -ned[:, 2]])


_AXES: Final = ("vx", "vy", "vz")


def _attitudes(topic: dict[str, Any] | None) -> Attitudes | None:
    return None if topic is None else attitudes(_seconds(topic), enu_from_ned(_quaternions(topic)))


def _quaternions(topic: dict[str, Any]) -> Matrix:
    return np.column_stack([np.asarray(topic[f"q[{part}]"], dtype=float) for part in range(4)])


def _gimbal(topic: dict[str, Any] | None, aircraft: Attitudes | None) -> Attitudes | None:
    """As GIMBAL_DEVICE_ATTITUDE_STATUS: roll and pitch from the horizon, yaw from north or from the nose."""
    if topic is None or aircraft is None:
        return None
    t_s, q, flags = _seconds(topic), _quaternions(topic), np.asarray(topic["device_flags"]).astype(int)
    good = np.isfinite(q).all(axis=1) & (np.abs(q).sum(axis=1) > 0.5)
    named = (flags & (_YAW_FROM_VEHICLE | _YAW_FROM_NORTH)) != 0
    from_nose = np.where(named, (flags & _YAW_FROM_VEHICLE) != 0, (flags & _YAW_LOCK) == 0)
    if np.count_nonzero(good) < 2:
        return None
    yaw = np.where(from_nose, nose_at(aircraft, t_s), 0.0)
    return attitudes(t_s[good], enu_from_ned(turned_by(q[good], yaw[good])))


def _separation(gps: dict[str, Any], fixed: NDArray[np.bool_]) -> float | None:
    for ellipsoid, above_sea, scale in (
        ("altitude_ellipsoid_m", "altitude_msl_m", 1.0),
        ("alt_ellipsoid", "alt", 1e-3),
    ):
        if ellipsoid in gps and above_sea in gps and fixed.any():
            told = (np.asarray(gps[ellipsoid], dtype=float) - np.asarray(gps[above_sea], dtype=float))[fixed] * scale
            return float(np.median(told)) or None
    return None


def _take_off(local: dict[str, Any] | None) -> float | None:
    """Altitude of the local frame's zero, about where the estimator started: on the ground."""
    if local is None or "ref_alt" not in local:
        return None
    told = np.asarray(local["ref_alt"], dtype=float)
    told = told[np.isfinite(told)]
    return float(told[-1]) if len(told) else None
