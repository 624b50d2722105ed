"""What is heard of one vehicle's gimbal: its attitude at any time, and whether that is to be trusted."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from copy import deepcopy
from typing import Any, Final

import numpy as np

from mission.clock import ClockMap
from mission.gimbal.attitude_history import AttitudeAt, GimbalHistory
from mission.gimbal.noise import gimbal_noise
from mission.gimbal.reading import (
    GimbalReading,
    from_device_status,
    from_mount_orientation,
    from_mount_status,
)
from mission.records import NoiseModel, Vector

ATTITUDE_MESSAGES: Final = ("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION", "MOUNT_STATUS")
"""The best first: a worse one is read only while no better one comes."""
SILENT_S: Final = 1.0
"""Without a report for so long, nothing is known of where the lens looks."""
_STILL_S: Final = 2.0
"""What is measured is not the same to the last bit for so long."""
_LEAST_READINGS: Final = 8

ToBoot = Callable[[float], float]
"""The autopilot's time of a program time."""
GimbalAt = Callable[[float, ToBoot, AttitudeAt], Vector | None]
"""World_from_gimbal (4,) at a program time, see `GimbalListener.at`."""


class GimbalListener:
    """Reads one gimbal's reports in the link's thread; all else may be called from any.

    The first device that is heard is the camera's; further gimbals are not read.

    Args:
        age_s: how much older the angles are than their time stamps.
    """

    def __init__(self, age_s: float) -> None:
        self._history = GimbalHistory(age_s)
        self._clock: ClockMap | None = None
        """Of a gimbal that is a component of its own; None where the stamps are the autopilot's."""
        self._by_arrival = False
        self._source: tuple[str, int, int] | None = None
        self._heard_s = -math.inf
        self._lock = threading.Lock()
        self.servo = False
        """Whether the mount is of plain servos (MNT1_TYPE = 1)."""

    def clear(self) -> None:
        """The autopilot was restarted."""
        with self._lock:
            self._history.clear()

    def keep_for(self, keep_s: float) -> None:
        """Keep more of the past from now on."""
        with self._lock:
            self._history.keep_for(keep_s)

    def take(self, message: Any, arrived_s: float) -> None:
        """Take in one of `ATTITUDE_MESSAGES` of the vehicle."""
        name, component = message.get_type(), message.get_srcComponent()
        source = (name, component, int(getattr(message, "gimbal_device_id", 0)))
        with self._lock:
            if not self._ours(source, arrived_s):
                return
            reading = self._read(message)
            if reading is None:
                return
            if source != self._source:
                self._source = source
                self._history.clear()
                self._by_arrival = reading.boot_s is None
                self._clock = None if component == 1 or self._by_arrival else ClockMap()
            stamp_s = arrived_s if self._by_arrival or reading.boot_s is None else reading.boot_s
            if self._clock is not None:
                self._clock.observe(stamp_s, arrived_s)
            if self._history.add(stamp_s, reading):
                self._heard_s = arrived_s

    def _ours(self, source: tuple[str, int, int], arrived_s: float) -> bool:
        if self._source is None or source == self._source:
            return True
        if arrived_s - self._heard_s > SILENT_S:
            return source[1:] == self._source[1:] or source[0] != self._source[0]
        return ATTITUDE_MESSAGES.index(source[0]) < ATTITUDE_MESSAGES.index(self._source[0])

    def _read(self, message: Any) -> GimbalReading | None:
        name = message.get_type()
        if name == "GIMBAL_DEVICE_ATTITUDE_STATUS":
            return from_device_status(message, servo=self.servo)
        return from_mount_orientation(message) if name == "MOUNT_ORIENTATION" else from_mount_status(message)

    def at(self, t_s: float, to_boot: ToBoot, body_at: AttitudeAt, hold_s: float = 0.0) -> Vector | None:
        """World_from_gimbal (4,) at a program time, see `GimbalHistory.at`.

        Args:
            t_s: program time.
            to_boot: the autopilot's time of a program time.
            body_at: the aircraft's attitude at one of the autopilot's times.
            hold_s: how long the newest report stands.
        """
        with self._lock:
            return _at(self._history, self._clock, self._by_arrival, t_s, to_boot, body_at, hold_s)

    def snapshot(self) -> GimbalAt:
        """`at` as of now, for work in other threads."""
        with self._lock:
            history, clock, by_arrival = self._history.copy(), deepcopy(self._clock), self._by_arrival
        return lambda t_s, to_boot, body_at: _at(history, clock, by_arrival, t_s, to_boot, body_at, 0.0)

    def trouble(self, now_s: float) -> str:
        """Why the lens's attitude is not known, in words for the operator; empty where it is."""
        with self._lock:
            if self._source is None:
                return "the camera is told to be on a gimbal, and no gimbal tells its attitude"
            silent_s = now_s - self._heard_s
        if silent_s > SILENT_S:
            return f"the gimbal has told no attitude for {min(silent_s, 999.0):.0f} s"
        return ""

    def measured(self, now_s: float) -> bool:
        """Whether the attitude of the last seconds is measured: what is only commanded is the same to the last bit."""
        with self._lock:
            to_now = now_s if self._by_arrival else self._history.newest_s
            recent = self._history.since(to_now - _STILL_S)
        if len(recent) < _LEAST_READINGS:
            return False
        turned = np.array([one.turned_wxyz for one in recent])
        return bool(np.ptp(turned, axis=0).max() > 0.0) and not self.servo

    def noise(self, aircraft: NoiseModel, now_s: float) -> NoiseModel:
        """Of the lens's pose, see `mission.gimbal.noise`."""
        newest = self._newest()
        reference = "heading" if newest is None else newest.reference
        return gimbal_noise(aircraft, reference, measured=self.measured(now_s))

    def note(self) -> str:
        """What the operator should know of the last report; empty where nothing."""
        newest = self._newest()
        return f"the gimbal is at its stop in {newest.at_stop}" if newest is not None and newest.at_stop else ""

    def doubt(self, now_s: float) -> str:
        """Why the attitude is only to be believed when the pictures confirm it; empty where it is measured."""
        newest = self._newest()
        if newest is not None and not newest.explicit:
            return "the gimbal does not say whether its yaw is from north or from the nose"
        if not self.measured(now_s):
            return "the gimbal's angles do not change at all: they are what it was told to do, or frozen"
        return ""

    def _newest(self) -> GimbalReading | None:
        with self._lock:
            return self._history.newest()


def _at(
    history: GimbalHistory,
    clock: ClockMap | None,
    by_arrival: bool,
    t_s: float,
    to_boot: ToBoot,
    body_at: AttitudeAt,
    hold_s: float,
) -> Vector | None:
    if by_arrival:
        return history.at(t_s, lambda own_s: body_at(to_boot(own_s)), hold_s)
    if clock is None:
        return history.at(to_boot(t_s), body_at, hold_s)
    if not clock.ready:
        return None
    return history.at(clock.to_remote(t_s), lambda own_s: body_at(to_boot(clock.to_local(own_s))), hold_s)
