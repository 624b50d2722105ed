"""`MavlinkDrone`: a PX4 or ArduPilot multicopter. MAVSDK in the pilot process flies it, pymavlink gives the pose."""

from __future__ import annotations

import itertools
import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.clock import ClockMap
from mission.drones.drone import Bounds, Capabilities, DroneEvent, Order, OrderState, Path, Telemetry
from mission.drones.limits import FlightSettings
from mission.drones.link import MavlinkLink
from mission.drones.loopback import drain, loopback_socket
from mission.drones.pilot_config import PROGRAM_COMPONENT, PilotConfig
from mission.drones.pilot_process import PilotProcess, WatchedOrder
from mission.drones.pilot_protocol import Aim, Begin, FlyOrder, OrderKind
from mission.drones.pose_quality import attitude_covariance, noise_model, position_covariance
from mission.drones.rates import MessageRates
from mission.drones.url import mavsdk_url
from mission.drones.vehicle import VEHICLE_MESSAGES, VehicleState, on_earth
from mission.errors import LinkError
from mission.geodesy import geodetic_to_enu
from mission.pose import Pose, PoseBuffer, world_from_body
from mission.records import GeodeticOrigin, NoiseModel

_LOG = logging.getLogger(__name__)
_REBOOT_S = 1.0


class MavlinkDrone:
    """`mission.drones.drone.Drone` over MAVLink.

    While we fly it, the program must call one of the methods (or `keep_alive`) at 10 Hz or more from its own loop:
    after 0.5 s of silence the pilot process puts the vehicle into hold. No thread does that in its place, since it
    would outlive a loop that hangs.

    Args:
        url: the vehicle's address, see `mission.drones.url`.
        target_system: the vehicle's system id; 0 takes the first autopilot that is heard.
        pose_rate_hz: rate asked for positions and attitudes.
        min_pose_rate_hz: the rate without which `connect` fails.
        flight: limits of the pilot process.
        pilot_log: file for the pilot process's and MAVSDK's own log.
        clock: monotonic seconds.

    Raises:
        SettingsError: the address is none.
    """

    def __init__(
        self,
        url: str,
        *,
        target_system: int = 0,
        pose_rate_hz: float = 50.0,
        min_pose_rate_hz: float = 20.0,
        flight: FlightSettings | None = None,
        pilot_log: FilePath | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._url = mavsdk_url(url)
        self._target_system = target_system
        self._pose_rate_hz = pose_rate_hz
        self._min_pose_rate_hz = min_pose_rate_hz
        self._flight = flight or FlightSettings()
        self._pilot_log = pilot_log
        self._clock = clock
        self._lock = threading.Lock()
        self._pilot: PilotProcess | None = None
        self._link: MavlinkLink | None = None
        self._rates: MessageRates | None = None
        self._ids = itertools.count(1)
        self._reset()

    def _reset(self) -> None:
        self._state = VehicleState(self._target_system)
        self._boot = ClockMap()
        self._poses = PoseBuffer()
        self._origin: GeodeticOrigin | None = None
        self._newest_boot_s = 0.0

    @property
    def name(self) -> str:
        """Autopilot and system id."""
        return f"{self._state.autopilot}-{self._state.system}"

    @property
    def capabilities(self) -> Capabilities:
        """Position setpoints and global positions."""
        return Capabilities(position_setpoints=True, global_position=True, max_speed_m_s=10.0)

    @property
    def link(self) -> MavlinkLink:
        """The program's pymavlink side.

        Raises:
            LinkError: not connected.
        """
        if self._link is None:
            raise LinkError("the drone is not connected", "Connect first")
        return self._link

    @property
    def pilot_pid(self) -> int | None:
        """Process id of the pilot process."""
        return None if self._pilot is None else self._pilot.pid

    @property
    def origin(self) -> GeodeticOrigin | None:
        """Fixed at the first healthy position; ellipsoid height where the autopilot tells it, else AMSL."""
        return self._origin

    def connect(self, timeout_s: float) -> None:
        """Start the pilot process, wait for the autopilot and for positions and attitudes at the wanted rate.

        Raises:
            LinkError: the address cannot be opened, no autopilot is heard, or poses come too slowly.
        """
        self.close()
        self._reset()
        deadline = self._clock() + timeout_s
        sock = loopback_socket()
        config = PilotConfig(
            url=self._url,
            program_port=sock.getsockname()[1],
            target_system=self._target_system,
            connect_timeout_s=timeout_s,
            flight=self._flight,
        )
        self._pilot = PilotProcess(config, self._pilot_log, self._clock)
        try:
            system = self._pilot.wait_ready(timeout_s + 2.0)
        except LinkError:
            sock.close()
            self.close()
            raise
        drain(sock)
        self._state = VehicleState(system)
        self._link = MavlinkLink(
            sock,
            source_system=system,
            source_component=PROGRAM_COMPONENT,
            target_system=system,
            handler=self._take,
            handled=VEHICLE_MESSAGES,
            clock=self._clock,
        )
        wanted = {"GLOBAL_POSITION_INT": self._pose_rate_hz, "ATTITUDE": self._pose_rate_hz}
        self._rates = MessageRates(self._link, wanted, self._clock())
        try:
            self._wait_for_poses(deadline)
        except LinkError:
            self.close()
            raise

    def _wait_for_poses(self, deadline_s: float) -> None:
        while True:
            self.keep_alive()
            now = self._clock()
            told = self._state.landed_state != mavlink.MAV_LANDED_STATE_UNDEFINED
            if self._pose_rate() >= self._min_pose_rate_hz and self._state.connected(now) and told:
                return
            if self._pilot is None or not self._pilot.alive:
                raise LinkError("the pilot process ended while connecting", "Its log may say why")
            if now > deadline_s:
                if not self._state.connected(now):
                    raise LinkError(f"no heartbeat on {self._url}", "Check that the vehicle is on and in range")
                raise LinkError(
                    f"positions and attitudes come at {self._pose_rate():.0f} Hz,"
                    f" {self._min_pose_rate_hz:.0f} Hz are needed",
                    "Check that the link is fast enough and that the autopilot has a position",
                )
            time.sleep(0.05)  # looks again until the deadline

    def close(self) -> None:
        """Give control back if it is ours (the pilot process orders hold and ends), and close the link."""
        if self._pilot is not None:
            self._pilot.close()
            self._pilot = None
        if self._link is not None:
            self._link.close()
            self._link = None
        self._rates = None

    def keep_alive(self) -> None:
        """Tell the pilot process that the program's loop is alive. Every other method does so, too."""
        if self._pilot is not None:
            self._pilot.keep_alive()
        if self._rates is not None:
            self._rates.keep(self._clock())

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
        )

    def pose_at(self, t_s: float) -> Pose | None:
        """Pose at a program time; None across gaps of more than 0.3 s, beyond the newest message, or before the origin.

        The position's covariance is the absolute one that the autopilot reports; what changes within a pattern is in
        `noise`.
        """
        self.keep_alive()
        with self._lock:
            if not self._boot.ready:
                return None
            boot_s = self._boot.to_remote(t_s)
        pose = self._poses.at(boot_s, position_covariance(self._state), attitude_covariance(self._state))
        return None if pose is None else replace(pose, t_s=t_s)

    def noise(self) -> NoiseModel:
        """How good the reported pose is within a pattern, see `mission.drones.pose_quality`."""
        return noise_model(self._state)

    def begin(self, bounds: Bounds) -> None:
        """A new order by the operator: control may be taken once, within `bounds`.

        Raises:
            LinkError: not connected, or the pilot process is gone.
        """
        if self._pilot is None or not self._pilot.send(Begin(bounds=bounds)):
            raise LinkError("the drone is not connected", "Connect first")

    def take_off(self, height_m: float) -> Order:
        """Arm and climb to a height above the ground."""
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
            self._pilot.send(Aim(heading_rad=heading_rad))

    def hold(self) -> Order:
        """Stop and give control back to the autopilot's hold mode."""
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

    def _pose_rate(self) -> float:
        return 0.0 if self._rates is None else min(self._rates.hz("GLOBAL_POSITION_INT"), self._rates.hz("ATTITUDE"))

    def _take(self, message: Any, arrived_s: float) -> None:
        """In the link's thread."""
        self._state.update(message, arrived_s)
        name = message.get_type()
        if name not in ("GLOBAL_POSITION_INT", "ATTITUDE") or message.get_srcSystem() != self._state.system:
            return
        boot_s = message.time_boot_ms * 1e-3
        with self._lock:
            if boot_s < self._newest_boot_s - _REBOOT_S:
                _LOG.warning("the autopilot's clock went back from %.1f to %.1f s", self._newest_boot_s, boot_s)
                self._poses.clear()
                self._newest_boot_s = boot_s
            self._newest_boot_s = max(self._newest_boot_s, boot_s)
            self._boot.observe(boot_s, arrived_s)
        if name == "ATTITUDE":
            if not all(map(math.isfinite, (message.roll, message.pitch, message.yaw))):
                return
            self._poses.add_attitude(boot_s, world_from_body(message.roll, message.pitch, message.yaw))
        elif on_earth(message.lat, message.lon):
            self._take_position(message, boot_s, arrived_s)

    def _take_position(self, message: Any, boot_s: float, arrived_s: float) -> None:
        # AMSL altitude, not relative_alt: PX4 moves its home altitude by metres after take-off.
        state = self._state
        if self._origin is None:
            if not state.position_ok(arrived_s):
                return
            separation = state.geoid_separation_m
            alt_m = message.alt * 1e-3 + (separation or 0.0)
            datum: Any = "amsl" if separation is None else "ellipsoid"
            self._origin = GeodeticOrigin(message.lat * 1e-7, message.lon * 1e-7, alt_m, datum)
            self._geoid_m = separation or 0.0
        alt_m = message.alt * 1e-3 + self._geoid_m
        place = geodetic_to_enu(message.lat * 1e-7, message.lon * 1e-7, alt_m, self._origin)
        self._poses.add_position(boot_s, place, np.array([message.vy, message.vx, -message.vz]) * 0.01)


def _not_a_number(*values: float | None) -> str:
    return (
        "the order has a value that is not a number"
        if any(v is not None and not math.isfinite(v) for v in values)
        else ""
    )
