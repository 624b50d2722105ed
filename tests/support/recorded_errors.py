"""The two recorded flights (tests/data/tlogs): reported pose minus truth, for comparison with the simulated one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.records import Vector
from sitl.autopilot.rotation import to_euler

_LOGS = Path(__file__).parents[1] / "data" / "tlogs"
_WANTED = {33, 30, 108, 115}
_EARTH_M = 6378137.0


@dataclass(frozen=True, eq=False)
class Errors:
    """Sampled at `t`, (n,): position error ENU (n, 3), velocity error ENU (n, 3), roll, pitch, heading error (n, 3)."""

    t: Vector
    position_m: Vector
    velocity_m_s: Vector
    attitude_rad: Vector


def messages(path: Path) -> list[tuple[float, Any]]:
    """(seconds since the start, message) of the types that are needed: 8 bytes of big-endian microseconds, a frame."""
    data, at, found = path.read_bytes(), 0, []
    parser = mavlink.MAVLink(None)
    start: int | None = None
    while at + 20 < len(data):
        stamp = int.from_bytes(data[at : at + 8], "big")
        start = stamp if start is None else start
        frame = data[at + 8 :]
        size = 12 + frame[1] + (13 if frame[2] & 1 else 0)
        if int.from_bytes(frame[7:10], "little") in _WANTED:
            found.append(((stamp - start) * 1e-6, parser.decode(bytearray(frame[:size]))))
        at += 8 + size
    return found


@cache
def recorded_errors(name: str, start_s: float, end_s: float) -> Errors:
    """The errors of one recorded flight between two times, at 50 Hz."""
    position, attitude, truth = [], [], []
    for t, m in messages(_LOGS / f"{name}-out-and-back.tlog"):
        kind = m.get_type()
        if kind == "GLOBAL_POSITION_INT":
            velocity = (m.vy / 100, m.vx / 100, -m.vz / 100)
            position.append((t, *_enu(m.lat / 1e7, m.lon / 1e7, m.alt / 1e3), *velocity))
        elif kind == "ATTITUDE":
            attitude.append((t, m.roll, m.pitch, m.yaw))
        elif kind == "SIM_STATE":
            place = _enu(m.lat_int / 1e7, m.lon_int / 1e7, m.alt)
            truth.append((t, *place, m.ve, m.vn, -m.vd, m.roll, m.pitch, m.yaw))
        elif kind == "HIL_STATE_QUATERNION":
            place, velocity = _enu(m.lat / 1e7, m.lon / 1e7, m.alt / 1e3), (m.vy / 100, m.vx / 100, -m.vz / 100)
            w, x, y, z = m.attitude_quaternion
            truth.append((t, *place, *velocity, *to_euler((w, x, y, z))))
    p, a, true = np.array(position), np.array(attitude), np.array(truth)
    grid = np.arange(start_s, end_s, 0.02)
    true[:, 7:] = np.unwrap(true[:, 7:], axis=0)
    a[:, 1:] = np.unwrap(a[:, 1:], axis=0)
    at = np.stack([np.interp(grid, true[:, 0], true[:, k]) for k in range(1, 10)], axis=1)
    told = np.stack([np.interp(grid, p[:, 0], p[:, k]) for k in range(1, 7)], axis=1)
    turned = np.stack([np.interp(grid, a[:, 0], a[:, k]) for k in range(1, 4)], axis=1)
    difference = np.remainder(turned - at[:, 6:9] + math.pi, 2 * math.pi) - math.pi
    return Errors(grid, told[:, 0:3] - at[:, 0:3], told[:, 3:6] - at[:, 3:6], difference)


def drift(t: Vector, error: Vector, lag_s: float) -> float:
    """Root-mean-square change of an error (n,) or (n, axes) over a lag; axes are added in quadrature."""
    k = round(lag_s / (t[1] - t[0]))
    change = error[k:] - error[:-k]
    return float(np.sqrt(np.mean(change**2, axis=0).sum()))


def _enu(lat: float, lon: float, alt: float) -> tuple[float, float, float]:
    north = math.radians(lat - 37.2276) * _EARTH_M
    return math.radians(lon - 126.8405) * _EARTH_M * math.cos(math.radians(37.2276)), north, alt
