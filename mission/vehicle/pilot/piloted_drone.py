"""`PilotedDrone`: what every `Drone` that is flown by a pilot process has in common: its orders and its telemetry."""

from __future__ import annotations

import itertools
import math
import socket
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Final

from pydantic import BaseModel

from mission.errors import LinkError
from mission.vehicle.drone import Bounds, CameraPointer, DroneEvent, Order, OrderState, Path, Telemetry
from mission.vehicle.limits import FlightSettings
from mission.vehicle.pilot.loopback import drain
from mission.vehicle.pilot.process import PilotProcess, WatchedOrder
from mission.vehicle.pilot.protocol import AimOrder, Begin, FlyOrder, OrderKind
from mission.vehicle.state.vehicle_state import VehicleState

_POSES_S = 5.0


KEPT_BEFORE_S: Final = 30.0
"""Poses from before an order, which the turn towards the target and the time offset are measured with."""


class PilotedDrone(ABC):
    """An aircraft that a process of its own flies; how its messages come and become poses is the subclass's.

    While we fly it, the program must call `keep_alive`, `telemetry` or `events` at 10 Hz or more from its own loop:
    after 0.5 s of silence the pilot process stops the aircraft. That loop is the thread that called `begin`. Calls from
    other threads are no sign of life, since they would outlive a loop that hangs.

    Args:
        min_pose_rate_hz: the rate without which `connect` fails.
        flight: limits of the pilot process.
        pilot_log: file for the pilot process's own log.
        clock: monotonic seconds.
    """

    _state: VehicleState
    """The newest of what the aircraft reports."""

    def __init__(
        self,
        *,
        min_pose_rate_hz: float,
        flight: FlightSettings | None,
        pilot_log: FilePath | None,
        clock: Callable[[], float],
    ) -> None:
        self._min_pose_rate_hz = min_pose_rate_hz
        self._flight = flight or FlightSettings()
        self._pilot_log = pilot_log
        self._clock = clock
        self._lock = threading.Lock()
        self._pilot: PilotProcess | None = None
        self._ids = itertools.count(1)
        self._loop_thread: int | None = None
        """The thread whose silence stops the aircraft; None until it is flown."""

    @property
    def pilot_pid(self) -> int | None:
        """Process id of the pilot process."""
        return None if self._pilot is None else self._pilot.pid

    def close(self) -> None:
        """Give control back if it is ours: the pilot process lets the aircraft hold its place, and ends."""
        if self._pilot is not None:
            self._pilot.close()
            self._pilot = None

    def keep_alive(self) -> None:
        """Tell the pilot process that the program's loop is alive; nothing from a thread that is not that loop."""
        if self._pilot is not None and self._loop_thread in (None, threading.get_ident()):
            self._pilot.keep_alive()

    def telemetry(self) -> Telemetry:
        """The newest report."""
        self.keep_alive()
        now, state = self._clock(), self._state
        alive = self._pilot is not None and self._pilot.alive
        return Telemetry(
            t_s=now,
            connected=alive and state.connected(now),
            armed=state.armed,
            in_air=state.in_air,
            mode=state.mode.name,
            battery_fraction=state.battery_fraction,
            height_m=state.height_m,
            heading_rad=state.yaw_rad if state.attitude_s is not None else None,
            position_ok=state.position_ok(now),
            heading_ok=state.heading_ok(now),
            pose_rate_hz=self._pose_rate(),
            geoid_separation_m=state.geoid_separation_m,
            packet_loss=self._packet_loss(now),
        )

    @property
    def gimbal(self) -> CameraPointer | None:
        """See `Drone.gimbal`: none."""
        return None

    def pose_note(self) -> str:
        """See `Drone.pose_note`: nothing."""
        return ""

    def begin(self, bounds: Bounds) -> None:
        """A new order by the operator: control may be taken once, within `bounds`.

        Raises:
            LinkError: not connected, or the pilot process is gone.
        """
        self._loop_thread = threading.get_ident()
        if self._pilot is None or not self._pilot.send(Begin(bounds=bounds)):
            raise LinkError("the drone is not connected", "Connect first")

    def take_off(self, height_m: float) -> Order:
        """Arm, take off and climb to a height above the ground."""
        return self._order("take-off", height_m=height_m)

    def hover(self) -> Order:
        """Take control and stay here."""
        return self._order("hover")

    def turn_to(self, heading_rad: float) -> Order:
        """Turn on the spot."""
        return self._order("turn", heading_rad=heading_rad)

    def fly(self, path: Path) -> Order:
        """Fly a path from here."""
        return self._order("path", path=path)

    def aim(self, heading_rad: float) -> None:
        """The heading to keep from now on."""
        if self._pilot is not None and math.isfinite(heading_rad):
            self._pilot.send(AimOrder(heading_rad=heading_rad))

    def hold(self) -> Order:
        """Stop and give control back to the autopilot, which holds its place."""
        return self._order("hold")

    def land(self) -> Order:
        """Land here."""
        return self._order("land")

    def events(self) -> list[DroneEvent]:
        """What happened since the last call, oldest first."""
        self.keep_alive()
        events = [DroneEvent(t_s, "statustext", text) for t_s, _, text in self._state.take_texts()]
        if self._pilot is not None:
            events += self._pilot.take_events()
        return sorted(events, key=lambda e: e.t_s)

    def _order(
        self,
        kind: OrderKind,
        *,
        height_m: float | None = None,
        heading_rad: float | None = None,
        path: Path | None = None,
    ) -> Order:
        reason = "the drone is not connected" if self._pilot is None else _not_a_number(height_m, heading_rad)
        if self._pilot is None or reason:
            order = WatchedOrder(kind)
            order.move_on(OrderState.REFUSED, reason, self._clock())
            return order
        return self._pilot.order(
            FlyOrder(id=next(self._ids), kind=kind, height_m=height_m, heading_rad=heading_rad, path=path)
        )

    def _start_pilot(self, config: BaseModel, sock: socket.socket, timeout_s: float, module: str) -> int:
        """Start the pilot process and wait until it hears the vehicle, whose system id is returned.

        What came on `sock`, where it relays the vehicle's messages, is dropped: it is as old as the start.

        Raises:
            LinkError: it does not get ready; `sock` and the drone are closed again.
        """
        self._pilot = PilotProcess(config, self._pilot_log, self._clock, module)
        try:
            system = self._pilot.wait_ready(timeout_s)
        except LinkError:
            sock.close()
            self.close()
            raise
        drain(sock)
        return system

    def _wait_for_poses(self, deadline_s: float) -> None:
        """Wait until poses come at the wanted rate, for some seconds also where it was late that the vehicle was heard.

        Raises:
            LinkError: they do not; the drone is closed again.
        """
        deadline_s = max(deadline_s, self._clock() + _POSES_S)
        try:
            while not self._poses_come():
                if self._pilot is None or not self._pilot.alive:
                    raise LinkError("the pilot process ended while connecting", "Its log may say why")
                if self._clock() > deadline_s:
                    raise self._too_few_poses()
                time.sleep(0.05)  # looks again until the deadline
        except LinkError:
            self.close()
            raise

    def _poses_come(self) -> bool:
        self.keep_alive()
        return self._pose_rate() >= self._min_pose_rate_hz and self._state.connected(self._clock())

    def _packet_loss(self, now_s: float) -> float | None:
        """Fraction of the aircraft's packets that do not arrive; None where that is not known."""
        return None

    @abstractmethod
    def _pose_rate(self) -> float:
        """Rate at which positions and attitudes arrive, Hz (the smaller one)."""

    @abstractmethod
    def _too_few_poses(self) -> LinkError:
        """Why `connect` fails when poses come too slowly."""


def _not_a_number(*values: float | None) -> str:
    wrong = any(v is not None and not math.isfinite(v) for v in values)
    return "the order has a value that is not a number" if wrong else ""
