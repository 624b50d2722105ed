"""Pointing a gimbal by its manager (https://mavlink.io/en/services/gimbal_v2.html), and giving it back.

Control is asked for by DO_GIMBAL_MANAGER_CONFIGURE, without which PX4 denies what follows and ArduPilot does not mind;
then angles are streamed by GIMBAL_MANAGER_SET_PITCHYAW with YAW_LOCK, which both take for a yaw from north (PX4 loses
the flag for the earth's frame). Whoever takes the gimbal by the same command is never fought.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import all as mavlink

from mission.errors import LinkError

_LOG = logging.getLogger(__name__)
_EVERY_S: Final = 0.05
"""Between two angles that are sent."""
_MANAGER_RATE_HZ: Final = 5.0
_RELEASE: Final = -3.0
_LEAVE: Final = -1.0
_FLAGS: Final = int(
    mavlink.GIMBAL_MANAGER_FLAGS_ROLL_LOCK
    | mavlink.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
    | mavlink.GIMBAL_MANAGER_FLAGS_YAW_LOCK
)


class GimbalLink(Protocol):
    """What it takes to command a gimbal (`mission.vehicle.mavlink.link.MavlinkLink`)."""

    source_system: int
    source_component: int
    target_system: int
    target_component: int

    def send(self, message: Any) -> None:
        """Send a message."""
        ...

    def command(self, command: int, params: Sequence[float], *, timeout_s: float = ..., retries: int = ...) -> int:
        """Order something; its MAV_RESULT."""
        ...


class GimbalControl:
    """One gimbal's manager, as a companion uses it.

    Args:
        link: to the autopilot.
        clock: monotonic seconds.
    """

    def __init__(self, link: GimbalLink, clock: Callable[[], float]) -> None:
        self._link = link
        self._clock = clock
        self._lock = threading.Lock()
        self._ours = False
        self._confirmed = False
        self._lost = ""
        self._device = 0
        self._next_s = -math.inf

    @property
    def ours(self) -> bool:
        """Whether we point it."""
        return self._ours

    @property
    def lost(self) -> str:
        """Who took it from us, in words for the operator; empty while nobody did."""
        return self._lost

    def take(self) -> str:
        """Ask for control and wait for the answer, some seconds at most; not in the thread that keeps a flight alive.

        Returns:
            Why we cannot point it; empty when we can.
        """
        link = self._link
        params = (float(link.source_system), float(link.source_component), _LEAVE, _LEAVE, 0.0, 0.0, 0.0)
        try:
            result = link.command(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, params, timeout_s=0.5, retries=2)
        except LinkError as error:
            return error.cause
        if result != mavlink.MAV_RESULT_ACCEPTED:
            return f"the autopilot lets nobody point the gimbal (MAV_RESULT {result})"
        with self._lock:
            self._ours, self._confirmed, self._lost = True, False, ""
        status = mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS
        interval = (float(status), 1e6 / _MANAGER_RATE_HZ, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._send(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, interval)
        return ""

    def point(self, azimuth_rad: float, elevation_rad: float) -> None:
        """Look there: clockwise from north, up; call it often. Nothing where the gimbal is not ours."""
        now = self._clock()
        if not self._ours or now < self._next_s or not math.isfinite(azimuth_rad + elevation_rad):
            return
        self._next_s = now + _EVERY_S
        link, unused = self._link, math.nan
        link.send(
            mavlink.MAVLink_gimbal_manager_set_pitchyaw_message(
                *(link.target_system, link.target_component, _FLAGS, self._device),
                *(elevation_rad, math.remainder(azimuth_rad, 2.0 * math.pi), unused, unused),
            )
        )

    def release(self) -> None:
        """Give control back, unless somebody has it already; waits for nothing, and may be called twice."""
        with self._lock:
            ours, self._ours = self._ours, False
        if ours:
            self._send(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, (_RELEASE, _RELEASE, _LEAVE, _LEAVE, 0.0, 0.0, 0.0))

    def heard(self, message: Any) -> None:
        """GIMBAL_MANAGER_STATUS of the vehicle, in the link's thread: who points the gimbal."""
        who = int(message.primary_control_sysid), int(message.primary_control_compid)
        us = self._link.source_system, self._link.source_component
        with self._lock:
            if who == us:
                self._confirmed = True
                self._device = int(message.gimbal_device_id)
                return
            # Before it has heard of us, the status is of the time before; nobody at all counts only after us.
            if not self._ours or not self._confirmed:
                return
            self._ours = False
            self._lost = (
                f"component {who[1]} of system {who[0]} took the gimbal"
                if who != (0, 0)
                else "control of the gimbal was taken from us"
            )
        _LOG.warning("%s", self._lost)

    def _send(self, command: int, params: Sequence[float]) -> None:
        link = self._link
        link.send(mavlink.MAVLink_command_long_message(link.target_system, link.target_component, command, 0, *params))
