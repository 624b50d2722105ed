"""From the rows of a log to series that can be interpolated: in order of time, on earth, without what cannot be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mission.errors import LogError
from mission.geodesy import geodetic_to_enu
from mission.logs.pose_log import Attitudes, Positions, interpolation_sigma_rad
from mission.pose.buffer import world_from_body
from mission.records import Datum, GeodeticOrigin, Matrix, NoiseModel, Vector
from mission.vehicle.mavlink.pose_quality import noise_model
from mission.vehicle.state.vehicle_state import VehicleState

GIMBAL_YAW_BIAS_RAD = math.radians(5.0)
"""A gimbal's yaw against the aircraft's heading (DJI Onboard-SDK 844, Mobile-SDK-V5 225): constant over a flight."""
GIMBAL_TILT_BIAS_RAD = math.radians(0.5)
_NED_IN_ENU = math.sqrt(0.5)
_RESTART_S = 1.0
_SHORTEST_S = 1.0
_LEAP_S = 18.0
_GPS_EPOCH_S = 315964800.0
_WEEK_S = 604800.0


def one_run(t_s: Vector) -> NDArray[np.intp]:
    """The rows of the longest run of one clock, in ascending time.

    A row whose time stands alone far ahead is left out; where a clock was restarted, the longer part is taken.

    Args:
        t_s: (n,) in the order of the file; not finite ones are left out.
    """
    rows = np.flatnonzero(np.isfinite(t_s))
    for _ in range(2):
        t = t_s[rows]
        if len(t) < 3:
            break
        before, after = t[:-2], t[2:]
        alone = (t[1:-1] > after + _RESTART_S) & (before <= after)
        rows = rows[np.concatenate([[True], ~alone, [True]])]
    if len(rows) == 0:
        return rows.astype(np.intp)
    t = t_s[rows]
    begins = np.concatenate([[0], np.flatnonzero(np.diff(t) < -_RESTART_S) + 1, [len(t)]])
    longest = int(np.argmax(np.diff(begins)))
    rows = rows[begins[longest] : begins[longest + 1]]
    t = t_s[rows]
    highest = np.maximum.accumulate(t)
    return np.asarray(rows[np.concatenate([[True], t[1:] > highest[:-1]])], dtype=np.intp)


def attitudes(t_s: Sequence[float] | Vector, wxyz: Sequence[Vector] | Matrix) -> Attitudes | None:
    """A series from reports in the order of the file, without those that are no rotation.

    Args:
        t_s: (n,).
        wxyz: (n, 4), from forward-right-down to ENU.

    Returns:
        None when fewer than two are left.
    """
    t, q = np.asarray(t_s, dtype=float), np.asarray(wxyz, dtype=float).reshape(-1, 4)
    norm = np.linalg.norm(q, axis=1)
    good = (norm > 0.5) & (norm < 2.0)
    t, q = t[good], q[good] / norm[good, None]
    kept = one_run(t)
    return None if len(kept) < 2 else Attitudes(t[kept], q[kept])


def from_euler(
    t_s: Sequence[float] | Vector, roll_pitch_yaw_deg: Sequence[Sequence[float]] | Matrix
) -> Attitudes | None:
    """The same from roll, pitch, yaw in degrees (n, 3), turned Z-Y-X from north-east-down."""
    angles = np.radians(np.asarray(roll_pitch_yaw_deg, dtype=float).reshape(-1, 3))
    wxyz = [
        world_from_body(*row) if all(map(math.isfinite, row)) else np.full(4, math.nan)
        for row in map(tuple, angles.tolist())
    ]
    return attitudes(t_s, np.array(wxyz).reshape(-1, 4))


def enu_from_ned(ned_from_body_wxyz: Matrix) -> Matrix:
    """Quaternions (n, 4) from a body to ENU, given those to NED: half a turn about the axis between north and east."""
    w, x, y, z = np.asarray(ned_from_body_wxyz, dtype=float).reshape(-1, 4).T
    return np.asarray(_NED_IN_ENU * np.column_stack([-(x + y), w + z, w - z, y - x]))


def positions(
    t_s: Sequence[float] | Vector,
    geodetic: Sequence[Sequence[float]] | Matrix,
    velocity_m_s: Sequence[Sequence[float]] | Matrix | None = None,
    datum: Datum = "amsl",
) -> tuple[GeodeticOrigin, Positions]:
    """A series from reports in the order of the file; the first one is the origin of the local frame.

    Args:
        t_s: (n,).
        geodetic: (n, 3) latitude and longitude (degrees), altitude (m).
        velocity_m_s: (n, 3) ENU; the slope of the positions where it is not told.
        datum: of the altitudes.

    Raises:
        LogError: there are too few positions on earth.
    """
    t, place = np.asarray(t_s, dtype=float), np.asarray(geodetic, dtype=float).reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        good = np.isfinite(place).all(axis=1) & (np.abs(place[:, 0]) < 90.0) & (np.abs(place[:, 1]) <= 180.0)
        good &= (np.abs(place[:, :2]) > 1e-6).any(axis=1) & (np.abs(place[:, 2]) < 2e4)
    on_earth = np.flatnonzero(good)
    kept = on_earth[one_run(t[on_earth])]
    if len(kept) < 2 or t[kept[-1]] - t[kept[0]] < _SHORTEST_S:
        raise LogError(
            f"the log holds {len(kept)} positions on earth in order of time: no flight can be placed with so few",
            "Give the log of a flight that had a GPS fix.",
        )
    lat, lon, alt = place[kept[0]].tolist()
    origin = GeodeticOrigin(lat, lon, alt, datum)
    enu = np.array([geodetic_to_enu(row[0], row[1], row[2], origin) for row in place[kept].tolist()])
    velocity = slopes(t[kept], enu)
    if velocity_m_s is not None:
        told = np.asarray(velocity_m_s, dtype=float).reshape(-1, 3)[kept]
        velocity = np.where(np.isfinite(told).all(axis=1, keepdims=True), told, velocity)
    return origin, Positions(t[kept], enu, velocity)


def slopes(t_s: Vector, enu_m: Matrix, over_s: float = 0.5) -> Matrix:
    """(n, 3): velocity from positions (n, 3), from about this long before to this long after."""
    first = np.searchsorted(t_s, t_s - over_s, side="left")
    last = np.minimum(np.searchsorted(t_s, t_s + over_s, side="right") - 1, len(t_s) - 1)
    return np.asarray((enu_m[last] - enu_m[first]) / np.maximum(t_s[last] - t_s[first], 1e-3)[:, None])


def pose_noise(accuracy_m: float | None, pointing: Attitudes | None, *, gimbal: bool) -> NoiseModel:
    """What a log's poses are taken to err by within a few seconds.

    Args:
        accuracy_m: horizontal, of the GPS, where the log tells.
        pointing: what the camera's attitude is taken from, for the gaps between its reports.
        gimbal: whether that is a gimbal: level to tenths of a degree, its yaw wrong by degrees.
    """
    vehicle = VehicleState()
    vehicle.gps_accuracy_m = accuracy_m
    noise = noise_model(vehicle)
    between = 0.0 if pointing is None else interpolation_sigma_rad(pointing.t_s)
    noise = replace(
        noise,
        heading_sigma_rad=math.hypot(noise.heading_sigma_rad, between),
        tilt_sigma_rad=math.hypot(noise.tilt_sigma_rad, between),
    )
    if gimbal:
        noise = replace(
            noise,
            heading_bias_sigma_rad=math.hypot(noise.heading_bias_sigma_rad, GIMBAL_YAW_BIAS_RAD),
            tilt_bias_sigma_rad=GIMBAL_TILT_BIAS_RAD,
        )
    return noise


def gps_time_utc_s(week: float, milliseconds: float) -> float:
    """Seconds since 1970, UTC, of a GPS week and time of week (18 leap seconds since 2017)."""
    return _GPS_EPOCH_S + _WEEK_S * week + 1e-3 * milliseconds - _LEAP_S


def median_or_none(values: Sequence[float]) -> float | None:
    """The median of what is finite and above zero."""
    good = [value for value in values if math.isfinite(value) and value > 0.0]
    return float(np.median(good)) if good else None


def utc_at_zero(pairs: Sequence[tuple[float, float]]) -> float | None:
    """UTC at a clock's zero from pairs of its time and UTC seconds; None without any.

    The median: a receiver's first words, before its fix, may be years off.
    """
    return float(np.median([utc - t for t, utc in pairs])) if pairs else None
