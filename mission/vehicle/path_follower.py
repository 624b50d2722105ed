"""A bounded path as a function of time: setpoints, and the check that it stays within its bounds."""

from __future__ import annotations

import bisect
import itertools
import math
from dataclasses import dataclass

import numpy as np

from mission.pose.buffer import hermite
from mission.records import Vector
from mission.vehicle.drone import Bounds, Path

_CHECK_STEP_S = 0.02
_TOLERANCE_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Setpoint:
    """Where to be and how fast, north-east-down in the autopilot's local frame, (3,) m and (3,) m/s."""

    position_ned_m: Vector
    velocity_ned_m_s: Vector


def setpoint_at(path: Path, t_s: float, start_ned_m: Vector) -> Setpoint:
    """The setpoint at a time after the path's start; before and after the path its ends, at rest.

    Args:
        path: knots in ENU offsets.
        t_s: since the path's start.
        start_ned_m: (3,) where the path starts.
    """
    knots = path.knots
    if t_s <= 0.0 or t_s >= path.duration_s:
        end = knots[0] if t_s <= 0.0 else knots[-1]
        velocity = _ned(end.velocity_enu_m_s) if t_s == 0.0 else np.zeros(3)
        return Setpoint(start_ned_m + _ned(end.offset_enu_m), velocity)
    i = bisect.bisect_right([k.t_s for k in knots], t_s)
    a, b = knots[i - 1], knots[i]
    dt = b.t_s - a.t_s
    offset, velocity = hermite(
        (t_s - a.t_s) / dt,
        dt,
        _ned(a.offset_enu_m),
        _ned(a.velocity_enu_m_s),
        _ned(b.offset_enu_m),
        _ned(b.velocity_enu_m_s),
    )
    return Setpoint(start_ned_m + offset, velocity)


def check_path(
    path: Path, bounds: Bounds, start_ned_m: Vector, centre_ned_m: Vector, ground_down_m: float, left_s: float
) -> str | None:
    """Why a path may not be flown, in words for the operator, or None.

    Args:
        path: to be checked, at every 20 ms.
        bounds: the room there is.
        start_ned_m: (3,) where it would start.
        centre_ned_m: (3,) where control was taken: the centre of the bounds' circle.
        ground_down_m: down coordinate from which heights count.
        left_s: time left of the bounds' duration.
    """
    malformed = _malformed(path)
    if malformed:
        return malformed
    if path.duration_s > left_s:
        return f"the path takes {path.duration_s:.1f} s, but {max(0.0, left_s):.1f} s are left of the time allowed"
    fastest = 0.0
    for i in range(math.ceil(path.duration_s / _CHECK_STEP_S) + 1):
        setpoint = setpoint_at(path, min(i * _CHECK_STEP_S, path.duration_s), start_ned_m)
        reason = outside(setpoint.position_ned_m, bounds, centre_ned_m, ground_down_m)
        if reason:
            return f"the path would leave its bounds: {reason}"
        fastest = max(fastest, float(np.linalg.norm(setpoint.velocity_ned_m_s)))
    if fastest > bounds.max_speed_m_s * 1.001 + 1e-9:
        return f"the path is flown at {fastest:.2f} m/s, more than the allowed {bounds.max_speed_m_s:.2f} m/s"
    return None


def outside(
    position_ned_m: Vector, bounds: Bounds, centre_ned_m: Vector, ground_down_m: float, margin_m: float = 0.0
) -> str | None:
    """How a position (3,) lies outside the bounds, widened by a margin, or None."""
    away = float(np.hypot(*(position_ned_m - centre_ned_m)[:2]))
    height = ground_down_m - float(position_ned_m[2])
    slack = margin_m + _TOLERANCE_M
    if not away <= bounds.radius_m + slack:
        return f"{away:.1f} m from where control was taken, more than {bounds.radius_m:.1f} m"
    if not height >= bounds.min_height_m - slack:
        return f"height {height:.1f} m, below {bounds.min_height_m:.1f} m"
    if not height <= bounds.max_height_m + slack:
        return f"height {height:.1f} m, above {bounds.max_height_m:.1f} m"
    return None


def _malformed(path: Path) -> str | None:
    knots = path.knots
    if len(knots) < 2:
        return "the path has fewer than two knots"
    values = [v for k in knots for v in (k.t_s, *k.offset_enu_m, *k.velocity_enu_m_s)]
    if not all(math.isfinite(v) for v in values):
        return "the path has a value that is not a number"
    if knots[0].t_s != 0.0 or any(v != 0.0 for v in knots[0].offset_enu_m):
        return "the path does not start at time 0 and offset 0"
    if any(b.t_s <= a.t_s for a, b in itertools.pairwise(knots)):
        return "the times of the path's knots do not rise"
    if any(v != 0.0 for v in knots[-1].velocity_enu_m_s):
        return "the path does not end at rest"
    return None


def _ned(enu: tuple[float, float, float]) -> Vector:
    return np.array([enu[1], enu[0], -enu[2]])
