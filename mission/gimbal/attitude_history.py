"""The last seconds of a gimbal's reports, and the attitude of its lens at any time between them.

Each report is first made an attitude in the world, with the aircraft's own attitude at the report's time where it is
measured from that; then the arc between two neighbours is followed. A stabilised camera is smooth in the world and not
against the airframe, so the other order would put the airframe's wander between two reports into the answer.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mission.gimbal.reading import GimbalReading
from mission.records import Vector

MAX_GAP_S: Final = 0.3
"""Between two reports across which an attitude is still interpolated: 3.3 Hz."""
_KEEP_S: Final = 30.0
_MOST: Final = 20000
_ENU_FROM_NED: Final = Rotation.from_quat([0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0], scalar_first=True)
_RATES_AGREE: Final = 0.5
"""A told rate is used where it explains the arc between two reports to this fraction of it."""
_RATES_FLOOR_RAD: Final = math.radians(0.2)

AttitudeAt = Callable[[float], Vector | None]
"""The aircraft's world_from_body (4,) at a time of the reports' clock; None where it is not known."""


class GimbalHistory:
    """Readings in rising order of time; not safe to use from several threads.

    Args:
        age_s: how much older the angles are than their time stamps.
    """

    def __init__(self, age_s: float = 0.0) -> None:
        self.age_s = age_s
        self._times: list[float] = []
        self._readings: list[GimbalReading] = []
        self._keep_s = _KEEP_S

    def add(self, t_s: float, reading: GimbalReading) -> bool:
        """Add a reading of a time stamp; False when it is not newer than the last one."""
        if not math.isfinite(t_s) or (self._times and t_s <= self._times[-1]):
            return False
        self._times.append(t_s)
        self._readings.append(reading)
        if len(self._times) > _MOST or t_s - self._times[0] > 1.25 * self._keep_s:
            first = max(bisect_right(self._times, t_s - self._keep_s), len(self._times) - 3 * _MOST // 4)
            del self._times[:first], self._readings[:first]
        return True

    def keep_for(self, keep_s: float) -> None:
        """Keep more of the past from now on."""
        self._keep_s = max(self._keep_s, keep_s)

    def copy(self) -> GimbalHistory:
        """A copy that nothing is added to any more."""
        copy = GimbalHistory(self.age_s)
        copy._times, copy._readings = self._times.copy(), self._readings.copy()
        return copy

    def clear(self) -> None:
        """Forget everything."""
        self._times.clear()
        self._readings.clear()

    def newest(self) -> GimbalReading | None:
        """The newest reading."""
        return self._readings[-1] if self._readings else None

    @property
    def newest_s(self) -> float:
        """Its time stamp; minus infinity without one."""
        return self._times[-1] if self._times else -math.inf

    def since(self, t_s: float) -> list[GimbalReading]:
        """The readings from a time stamp on."""
        return self._readings[bisect_right(self._times, t_s) :]

    def at(self, t_s: float, attitude_at: AttitudeAt, hold_s: float = 0.0) -> Vector | None:
        """World_from_gimbal (4,) at a time; None across a gap, outside of what was received, or without the aircraft's.

        Args:
            t_s: on the reports' clock, at which the lens really was so.
            attitude_at: of the aircraft.
            hold_s: for so long after the newest report the lens is taken to look where it looked then.
        """
        stamp_s = t_s + self.age_s
        if not self._times or not self._times[0] <= stamp_s <= self._times[-1] + hold_s:
            return None
        stamp_s = min(stamp_s, self._times[-1])
        i = bisect_right(self._times, stamp_s) - 1
        begun = self._in_world(i, attitude_at)
        if begun is None or self._times[i] == stamp_s:
            return None if begun is None else _wxyz(begun)
        span_s = self._times[i + 1] - self._times[i]
        ended = self._in_world(i + 1, attitude_at)
        if ended is None or span_s > MAX_GAP_S:
            return None
        rates = self._readings[i].rate_rad_s, self._readings[i + 1].rate_rad_s
        return _wxyz(begun * _part((stamp_s - self._times[i]) / span_s, begun.inv() * ended, rates, span_s))

    def _in_world(self, i: int, attitude_at: AttitudeAt) -> Rotation | None:
        reading = self._readings[i]
        body = None if reading.reference == "north" else attitude_at(self._times[i] - self.age_s)
        return in_world(reading, body)


def in_world(reading: GimbalReading, world_from_body_wxyz: Vector | None) -> Rotation | None:
    """World_from_gimbal of one reading; None where it is measured from an aircraft whose attitude is not known.

    Args:
        reading: of the gimbal.
        world_from_body_wxyz: (4,) of the aircraft at that time, ENU.
    """
    turned = Rotation.from_quat(reading.turned_wxyz, scalar_first=True)
    if reading.reference == "north":
        return _ENU_FROM_NED * turned
    if world_from_body_wxyz is None:
        return None
    body = Rotation.from_quat(world_from_body_wxyz, scalar_first=True)
    if reading.reference == "airframe":
        return body * turned
    east, north, _ = body.apply([1.0, 0.0, 0.0])
    return _ENU_FROM_NED * Rotation.from_rotvec([0.0, 0.0, math.atan2(east, north)]) * turned


def _part(part: float, arc: Rotation, rates: tuple[Vector | None, Vector | None], span_s: float) -> Rotation:
    """The first part of an arc: with the rates at its ends where they explain it, else at an even rate (slerp)."""
    whole = arc.as_rotvec()
    begun, ended = rates
    if begun is None or ended is None or not _explained(whole, 0.5 * span_s * (begun + ended)):
        return Rotation.from_rotvec(part * whole)
    u2, u3 = part * part, part**3
    # Cubic Hermite in the tangent space of the first: arcs between reports are of some degrees.
    way = (u3 - 2.0 * u2 + part) * span_s * begun + (3.0 * u2 - 2.0 * u3) * whole + (u3 - u2) * span_s * ended
    return Rotation.from_rotvec(way)


def _explained(whole: Vector, told: Vector) -> bool:
    # A gimbal that fills rates with zeros, or tells them against the airframe, must not bend the arc.
    return float(np.linalg.norm(told - whole)) <= _RATES_AGREE * float(np.linalg.norm(whole)) + _RATES_FLOOR_RAD


def _wxyz(turned: Rotation) -> Vector:
    return np.asarray(turned.as_quat(scalar_first=True), dtype=np.float64)
