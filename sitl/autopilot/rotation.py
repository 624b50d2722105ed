"""Quaternions (w, x, y, z) and vectors as plain tuples: a control loop at 200 Hz has no time for small arrays."""

from __future__ import annotations

import math

Vec = tuple[float, float, float]
Quat = tuple[float, float, float, float]

_HALF = math.sqrt(0.5)
NED_FROM_ENU: Quat = (0.0, _HALF, _HALF, 0.0)
"""Half a turn about the (north-east) diagonal: swaps east and north, and turns up to down."""
FLU_FROM_FRD: Quat = (0.0, 1.0, 0.0, 0.0)
"""Half a turn about forward; its own inverse."""


def multiply(a: Quat, b: Quat) -> Quat:
    """Hamilton product a b: first b, then a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(q: Quat) -> Quat:
    """The inverse of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


def from_euler(roll: float, pitch: float, yaw: float) -> Quat:
    """Yaw, then pitch, then roll (aerospace order); radians."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def to_euler(q: Quat) -> Vec:
    """(roll, pitch, yaw), radians, of the aerospace order."""
    w, x, y, z = q
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def from_thrust_and_yaw(direction: Vec, yaw: float) -> Quat:
    """World from body (z up), with the body's z along `direction` and its x turned to `yaw` about the world's z."""
    n = math.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
    x, y, z = direction[0] / n, direction[1] / n, direction[2] / n
    tilt = (1.0 + z, -y, x, 0.0)  # the shortest turn from (0, 0, 1) to the direction
    k = math.sqrt(sum(c * c for c in tilt))
    level = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
    return multiply((tilt[0] / k, tilt[1] / k, tilt[2] / k, 0.0), level)


def wrap(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return math.remainder(angle, 2 * math.pi)


def ned(v: Vec) -> Vec:
    """East-north-up to north-east-down, and back: it is its own inverse."""
    return v[1], v[0], -v[2]
