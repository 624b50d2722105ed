"""Where the aircraft was and how it was turned at a given time, with its covariance."""

from __future__ import annotations

import math
import threading
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mission.pose.steps import Steps, level_headings, level_positions
from mission.records import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """The aircraft's pose at `t_s` as it reports it."""

    t_s: float
    position_enu_m: Vector
    """(3,), relative to the drone's `origin`."""
    velocity_enu_m_s: Vector
    """(3,)."""
    world_from_body_wxyz: Vector
    """(4,), unit quaternion; body is forward-right-down."""
    position_covariance_m2: Matrix
    """(3, 3)."""
    attitude_covariance_rad2: Matrix
    """(3, 3), about the body's forward, right and down axes."""
    world_from_gimbal_wxyz: Vector | None = None
    """(4,), where the camera is on a gimbal: of the gimbal's own forward-right-down axes, as it reports them."""


_UPRIGHT = 0.1
"""Cosine of a pitch at which a heading says nothing."""

PoseAt = Callable[[float], Pose | None]
"""The pose at a program time; None where it is not known."""


class PoseBuffer:
    """The last seconds of two streams, position and attitude, each with its own times, interpolated between them.

    The position comes from a cubic Hermite segment between the two neighbouring positions, the velocity from the line
    between the two reported ones, attitude from the arc on the sphere between the two neighbouring attitudes (slerp;
    Shoemake 1985). There is no pose across a gap of
    more than `max_gap_s` in either stream, nor before the oldest or after the newest message: a stale pose is worse
    than none.

    Times may be of any one clock, as long as both streams share it. Safe to use from several threads.

    Args:
        max_gap_s: the largest time between two neighbouring messages across which a pose is still interpolated.
        keep_s: how much of the past is kept.
        max_messages: bound on each stream, whatever its rate.
    """

    def __init__(self, max_gap_s: float = 0.3, keep_s: float = 30.0, max_messages: int = 8000) -> None:
        self._max_gap_s = max_gap_s
        self._rate_hz = max_messages / keep_s
        self._positions = _Stream(keep_s, max_messages)
        self._attitudes = _Stream(keep_s, max_messages)
        self._lock = threading.Lock()

    def add_position(self, t_s: float, position_enu_m: Vector, velocity_enu_m_s: Vector) -> bool:
        """Add a position (3,) m and velocity (3,) m/s; False when it is not finite or not newer than the last one."""
        values = np.concatenate([position_enu_m, velocity_enu_m_s]).astype(np.float64)
        if not bool(np.isfinite(values).all()):
            return False
        with self._lock:
            return self._positions.add(t_s, values)

    def add_attitude(self, t_s: float, world_from_body_wxyz: Vector, heading_rate_rad_s: float = math.nan) -> bool:
        """Add a unit quaternion (4,); False when it is not finite or not newer than the last one.

        Args:
            t_s: time.
            world_from_body_wxyz: attitude.
            heading_rate_rad_s: as measured, clockwise from above; NaN where it is not known.
        """
        norm = float(np.linalg.norm(world_from_body_wxyz))
        if not 0.5 < norm < 2.0:
            return False
        with self._lock:
            return self._attitudes.add(t_s, np.append(np.asarray(world_from_body_wxyz) / norm, heading_rate_rad_s))

    def keep_for(self, keep_s: float) -> None:
        """Keep more of the past from now on: a flight's poses are wanted until its end."""
        with self._lock:
            for stream in (self._positions, self._attitudes):
                stream.keep_for(keep_s, round(self._rate_hz * keep_s))

    def snapshot(self) -> PoseBuffer:
        """A copy that nothing is added to any more."""
        copy = PoseBuffer(self._max_gap_s)
        with self._lock:
            copy._positions = self._positions.copy()
            copy._attitudes = self._attitudes.copy()
        return copy

    def level(self, since_s: float) -> Steps:
        """Undo the steps of the reported pose (`mission.pose.steps`), in place; to be used on a snapshot.

        Args:
            since_s: nothing is looked at before this time.
        """
        with self._lock:
            lengths = self._positions.levelled(since_s, level_positions)
            turns = self._attitudes.levelled(since_s, level_headings)
        largest = [float(steps.max(initial=0.0)) for steps in (lengths, turns)]
        return Steps(largest[0], largest[1], len(lengths) + len(turns))

    def rows(self) -> tuple[Matrix, Matrix]:
        """All that is stored, a row a message: time and value of the positions (n, 7), and of the attitudes (m, 6)."""
        with self._lock:
            return self._positions.rows(6), self._attitudes.rows(5)

    @classmethod
    def of_rows(cls, positions: Matrix, attitudes: Matrix, max_gap_s: float = 0.3) -> PoseBuffer:
        """A buffer that stores just these `rows`, bit for bit."""
        made = cls(max_gap_s)
        made._positions.set_rows(positions)
        made._attitudes.set_rows(attitudes)
        return made

    def clear(self) -> None:
        """Forget everything, for example after the remote clock was restarted."""
        with self._lock:
            self._positions.clear()
            self._attitudes.clear()

    def at(self, t_s: float, position_covariance_m2: Matrix, attitude_covariance_rad2: Matrix) -> Pose | None:
        """The pose at a time, or None across a gap or outside what was received.

        Args:
            t_s: on the clock of the two streams.
            position_covariance_m2: (3, 3), handed through.
            attitude_covariance_rad2: (3, 3), handed through.
        """
        with self._lock:
            position = self._positions.around(t_s, self._max_gap_s)
            attitude = self._attitudes.around(t_s, self._max_gap_s)
        if position is None or attitude is None:
            return None
        t0, t1, before, after = position
        part = (t_s - t0) / (t1 - t0) if t1 > t0 else 0.0
        place, _ = hermite(part, t1 - t0, before[:3], before[3:], after[:3], after[3:])
        # Not the segment's own derivative, which would be that of positions rounded to a centimetre.
        velocity = (1.0 - part) * before[3:] + part * after[3:]
        a0, a1, q0, q1 = attitude
        turned = slerp((t_s - a0) / (a1 - a0) if a1 > a0 else 0.0, q0[:4], q1[:4])
        return Pose(t_s, place, velocity, turned, position_covariance_m2, attitude_covariance_rad2)

    def attitude_at(self, t_s: float) -> Vector | None:
        """World_from_body (4,) at a time, or None across a gap or outside what was received."""
        with self._lock:
            attitude = self._attitudes.around(t_s, self._max_gap_s)
        if attitude is None:
            return None
        t0, t1, before, after = attitude
        return slerp((t_s - t0) / (t1 - t0) if t1 > t0 else 0.0, before[:4], after[:4])


class _Stream:
    """Times in rising order and what was reported at them."""

    def __init__(self, keep_s: float, max_messages: int) -> None:
        self.times: list[float] = []
        self.values: list[Vector] = []
        self._keep_s = keep_s
        self._max = max_messages

    def add(self, t_s: float, value: Vector) -> bool:
        if not math.isfinite(t_s) or (self.times and t_s <= self.times[-1]):
            return False
        self.times.append(t_s)
        self.values.append(value)
        # Trimmed in blocks: deleting one from the front on every message would move the whole list each time.
        if len(self.times) > self._max or t_s - self.times[0] > 1.25 * self._keep_s:
            first = max(bisect_right(self.times, t_s - self._keep_s), len(self.times) - (3 * self._max) // 4)
            del self.times[:first]
            del self.values[:first]
        return True

    def rows(self, columns: int) -> Matrix:
        if not self.times:
            return np.zeros((0, 1 + columns))
        return np.column_stack([np.array(self.times), np.array(self.values)])

    def set_rows(self, rows: Matrix) -> None:
        self.times, self.values = rows[:, 0].tolist(), list(rows[:, 1:])

    def keep_for(self, keep_s: float, max_messages: int) -> None:
        self._keep_s, self._max = max(self._keep_s, keep_s), max(self._max, max_messages)

    def levelled(self, since_s: float, level: Callable[[Vector, Matrix], tuple[Matrix, Vector]]) -> Vector:
        first = bisect_right(self.times, since_s)
        if len(self.times) - first < 3:
            return np.zeros(0)
        before = np.array(self.values[first:])
        values, steps = level(np.array(self.times[first:]), before)
        if len(steps):
            self.values[first:] = list(values)
        return steps

    def copy(self) -> _Stream:
        copy = _Stream(self._keep_s, self._max)
        copy.times, copy.values = list(self.times), list(self.values)
        return copy

    def clear(self) -> None:
        self.times.clear()
        self.values.clear()

    def around(self, t_s: float, max_gap_s: float) -> tuple[float, float, Vector, Vector] | None:
        """The neighbours of a time; a time that is exactly that of a message is its own neighbour."""
        if not self.times or not self.times[0] <= t_s <= self.times[-1]:
            return None
        i = bisect_right(self.times, t_s) - 1
        if self.times[i] == t_s:
            return t_s, t_s, self.values[i], self.values[i]
        if self.times[i + 1] - self.times[i] > max_gap_s:
            return None
        return self.times[i], self.times[i + 1], self.values[i], self.values[i + 1]


def hermite(u: float, dt_s: float, p0: Vector, v0: Vector, p1: Vector, v1: Vector) -> tuple[Vector, Vector]:
    """Cubic Hermite segment: position and velocity at the fraction `u` (0 to 1) of a segment of `dt_s` seconds.

    Args:
        u: fraction of the segment.
        dt_s: its duration; 0 returns the first point.
        p0: (n,) position at its start, m.
        v0: (n,) velocity there, m/s.
        p1: (n,) position at its end, m.
        v1: (n,) velocity there, m/s.
    """
    if dt_s <= 0.0:
        return p0.copy(), v0.copy()
    u2, u3 = u * u, u * u * u
    place = (2 * u3 - 3 * u2 + 1) * p0 + (u3 - 2 * u2 + u) * dt_s * v0 + (-2 * u3 + 3 * u2) * p1 + (u3 - u2) * dt_s * v1
    velocity = (6 * u2 - 6 * u) * (p0 - p1) / dt_s + (3 * u2 - 4 * u + 1) * v0 + (3 * u2 - 2 * u) * v1
    return place, velocity


def slerp(u: float, q0: Vector, q1: Vector) -> Vector:
    """Attitude at the fraction `u` of the shorter arc from one unit quaternion (4,) to another (Shoemake 1985)."""
    dot = float(q0 @ q1)
    if dot < 0.0:
        q1, dot = -q1, -dot
    if dot > 1.0 - 1e-9:
        mixed: Vector = (1.0 - u) * q0 + u * q1
    else:
        angle = math.acos(dot)
        mixed = (math.sin((1.0 - u) * angle) * q0 + math.sin(u * angle) * q1) / math.sin(angle)
    return mixed / np.linalg.norm(mixed)


def world_from_body(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vector:
    """Unit quaternion (4,) from ENU to forward-right-down for MAVLink's ATTITUDE angles.

    ATTITUDE turns NED into the body by yaw, pitch, roll (Z-Y-X); NED in ENU is half a turn about the axis between
    north and east: the quaternion (0, 1, 1, 0) / sqrt 2.
    """
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    w = cr * cp * cy + sr * sp * sy
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    s = math.sqrt(0.5)
    return np.array([-s * (x + y), s * (w + z), s * (w - z), s * (y - x)])


def heading_rate(roll_rad: float, pitch_rad: float, rates_rad_s: tuple[float, float]) -> float:
    """How fast the heading turns by ATTITUDE's `pitchspeed` and `yawspeed` (about the body's axes), rad/s; NaN upright.

    The kinematics of Z-Y-X angles (Diebel, Representing Attitude, 2006).
    """
    level = math.cos(pitch_rad)
    about_right, about_down = rates_rad_s
    turn = about_right * math.sin(roll_rad) + about_down * math.cos(roll_rad)
    return turn / level if abs(level) > _UPRIGHT and math.isfinite(turn) else math.nan


def heading(world_from_body_wxyz: Vector) -> float:
    """Heading of the nose, radians clockwise from true north, -pi to pi."""
    w, x, y, z = (float(c) for c in world_from_body_wxyz)
    east, north = w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z)
    return math.atan2(east, north)
