"""`ARDrone`: the Parrot AR.Drone 2.0 as `Drone`. A pilot process of its own flies it; here is what it tells."""

from __future__ import annotations

import itertools
import math
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath

from mission.clock import ClockMap
from mission.drones.ardrone.config import FlightConfig, Session
from mission.drones.ardrone.link import relayed
from mission.drones.ardrone.navdata import Navdata
from mission.drones.ardrone.pilot_config import ArdronePilotConfig
from mission.drones.ardrone.pose_quality import attitude_covariance, noise_model, position_covariance
from mission.drones.ardrone.reckoning import Reckoning
from mission.drones.ardrone.url import ardrone_address
from mission.drones.ardrone.vehicle import ArdroneVehicle
from mission.drones.drone import Bounds, Capabilities, DroneEvent, Order, OrderState, Path, Telemetry
from mission.drones.limits import FlightSettings
from mission.drones.loopback import drain, loopback_socket
from mission.drones.pilot_process import PilotProcess, WatchedOrder
from mission.drones.pilot_protocol import Aim, Begin, FlyOrder, OrderKind
from mission.errors import LinkError
from mission.pose import Pose, PoseBuffer
from mission.records import GeodeticOrigin, NoiseModel

PILOT_MODULE = "mission.drones.ardrone.pilot"
MAX_SPEED_M_S = 5.0
_RATE_WINDOW_S = 1.0


class ARDrone:
    """`mission.drones.drone.Drone` for an AR.Drone 2.0.

    Positions are dead reckoned from its velocity, and anchored to GPS where it has a fix; else there is no origin and
    answers are local. While we fly it, the program must call one of the methods (or `keep_alive`) at 10 Hz or more.

    Args:
        url: ``ardrone://HOST?...``, see `mission.drones.ardrone.url`.
        min_pose_rate_hz: the rate without which `connect` fails.
        flight: limits of the pilot process.
        pilot_log: file for the pilot process's own log.
        clock: monotonic seconds.

    Raises:
        SettingsError: the address is none.
    """

    def __init__(
        self,
        url: str,
        *,
        min_pose_rate_hz: float = 20.0,
        flight: FlightSettings | None = None,
        pilot_log: FilePath | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.address = ardrone_address(url)
        self._min_pose_rate_hz = min_pose_rate_hz
        self._flight = flight or FlightSettings()
        self._pilot_log = pilot_log
        self._clock = clock
        self._lock = threading.Lock()
        self._pilot: PilotProcess | None = None
        self._socket: socket.socket | None = None
        self._reader: threading.Thread | None = None
        self._closing = threading.Event()
        self._ids = itertools.count(1)
        self._reset()

    def _reset(self) -> None:
        self._vehicle = ArdroneVehicle()
        self._reckoning = Reckoning(self.address.declination_rad or 0.0, self.address.velocity_scale)
        self._drone_clock = ClockMap()
        self._poses = PoseBuffer()
        self._arrivals: deque[float] = deque(maxlen=600)

    @property
    def name(self) -> str:
        """Its address."""
        return f"ardrone-{self.address.host}"

    @property
    def capabilities(self) -> Capabilities:
        """No position setpoints; a place on earth as soon as GPS has a fix."""
        return Capabilities(
            position_setpoints=False, global_position=self.origin is not None, max_speed_m_s=MAX_SPEED_M_S
        )

    @property
    def pilot_pid(self) -> int | None:
        """Process id of the pilot process."""
        return None if self._pilot is None else self._pilot.pid

    @property
    def origin(self) -> GeodeticOrigin | None:
        """Fixed at the first GPS fix (altitude above mean sea level); None without one."""
        return self._reckoning.origin

    def connect(self, timeout_s: float) -> None:
        """Start the pilot process, wait until it has configured the drone and poses come.

        Raises:
            LinkError: the drone is not heard, does not take its configuration, or poses come too slowly.
        """
        self.close()
        self._reset()
        deadline = self._clock() + timeout_s
        sock = loopback_socket()
        config = ArdronePilotConfig(
            address=self.address,
            session=Session(*(secrets.token_hex(4) for _ in range(3))),
            program_port=sock.getsockname()[1],
            connect_timeout_s=timeout_s,
            flight=self._flight,
            drone=FlightConfig(codec=self.address.codec),
        )
        self._pilot = PilotProcess(config, self._pilot_log, self._clock, PILOT_MODULE)
        try:
            self._pilot.wait_ready(timeout_s + 2.0)
        except LinkError:
            sock.close()
            self.close()
            raise
        drain(sock)
        sock.settimeout(0.2)
        self._socket = sock
        self._closing.clear()
        self._reader = threading.Thread(target=self._read, args=(sock,), name="navdata", daemon=True)
        self._reader.start()
        try:
            self._wait_for_poses(deadline)
        except LinkError:
            self.close()
            raise

    def _wait_for_poses(self, deadline_s: float) -> None:
        while True:
            self.keep_alive()
            now = self._clock()
            if self._pose_rate() >= self._min_pose_rate_hz and self._vehicle.connected(now):
                return
            if self._pilot is None or not self._pilot.alive:
                raise LinkError("the pilot process ended while connecting", "Its log may say why")
            if now > deadline_s:
                raise LinkError(
                    f"navdata comes at {self._pose_rate():.0f} Hz, {self._min_pose_rate_hz:.0f} Hz are needed",
                    "Go nearer to the drone, or to a free Wi-Fi channel",
                )
            time.sleep(0.05)  # looks again until the deadline

    def close(self) -> None:
        """Give control back if it is ours (the drone hovers), and close the link."""
        if self._pilot is not None:
            self._pilot.close()
            self._pilot = None
        self._closing.set()
        if self._reader is not None:
            self._reader.join(2.0)
            self._reader = None
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def keep_alive(self) -> None:
        """Tell the pilot process that the program's loop is alive. Every other method does so, too."""
        if self._pilot is not None:
            self._pilot.keep_alive()

    def telemetry(self) -> Telemetry:
        """The newest report."""
        self.keep_alive()
        now, vehicle = self._clock(), self._vehicle
        alive = self._pilot is not None and self._pilot.alive
        return Telemetry(
            t_s=now,
            connected=alive and vehicle.connected(now),
            armed=vehicle.armed,
            in_air=vehicle.in_air,
            mode=vehicle.mode.name,
            battery_fraction=vehicle.battery_fraction,
            height_m=vehicle.height_m,
            heading_rad=vehicle.yaw_rad if vehicle.attitude_s is not None else None,
            position_ok=vehicle.position_ok(now),
            heading_ok=vehicle.heading_ok(now),
            pose_rate_hz=self._pose_rate(),
        )

    def pose_at(self, t_s: float) -> Pose | None:
        """Pose at a program time; None across gaps of more than 0.3 s or beyond the newest packet."""
        self.keep_alive()
        with self._lock:
            if not self._drone_clock.ready:
                return None
            drone_s = self._drone_clock.to_remote(t_s)
            place = position_covariance(self._reckoning)
        pose = self._poses.at(drone_s, place, attitude_covariance(self.noise()))
        return None if pose is None else replace(pose, t_s=t_s)

    def noise(self) -> NoiseModel:
        """How good the reckoned pose is within a pattern, see `mission.drones.ardrone.pose_quality`."""
        return noise_model(self._reckoning, declination_known=self.address.declination_rad is not None)

    def begin(self, bounds: Bounds) -> None:
        """A new order by the operator: control may be taken once, within `bounds`.

        Raises:
            LinkError: not connected, or the pilot process is gone.
        """
        if self._pilot is None or not self._pilot.send(Begin(bounds=bounds)):
            raise LinkError("the drone is not connected", "Connect first")

    def take_off(self, height_m: float) -> Order:
        """Take off and climb to a height above the ground."""
        return self._order("take-off", height_m=height_m)

    def hover(self) -> Order:
        """Take control and stay here."""
        return self._order("hover")

    def turn_to(self, heading_rad: float) -> Order:
        """Turn on the spot."""
        return self._order("turn", heading_rad=heading_rad)

    def fly(self, path: Path) -> Order:
        """Fly a path from here, by tilt, on dead reckoning."""
        return self._order("path", path=path)

    def aim(self, heading_rad: float) -> None:
        """The heading to keep from now on."""
        if self._pilot is not None and math.isfinite(heading_rad):
            self._pilot.send(Aim(heading_rad=heading_rad))

    def hold(self) -> Order:
        """Stop and let the drone hover by itself."""
        return self._order("hold")

    def land(self) -> Order:
        """Land here."""
        return self._order("land")

    def events(self) -> list[DroneEvent]:
        """What happened since the last call, oldest first."""
        self.keep_alive()
        events = [DroneEvent(t_s, "statustext", text) for t_s, _, text in self._vehicle.take_texts()]
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
        finite = all(v is None or math.isfinite(v) for v in (height_m, heading_rad))
        if self._pilot is None or not finite:
            order = WatchedOrder(kind)
            reason = "the drone is not connected" if finite else "the order has a value that is not a number"
            order.move_on(OrderState.REFUSED, reason, self._clock())
            return order
        return self._pilot.order(
            FlyOrder(id=next(self._ids), kind=kind, height_m=height_m, heading_rad=heading_rad, path=path)
        )

    def _pose_rate(self) -> float:
        now = self._clock()
        with self._lock:
            return sum(1 for arrived in self._arrivals if now - arrived <= _RATE_WINDOW_S) / _RATE_WINDOW_S

    def _read(self, sock: socket.socket) -> None:
        while not self._closing.is_set():
            try:
                datagram = sock.recv(65535)
            except TimeoutError:
                continue
            except OSError:
                return
            packet = relayed(datagram)
            if packet is not None:
                self._take(*packet)

    def _take(self, navdata: Navdata, arrived_s: float) -> None:
        """In the reader's thread."""
        with self._lock:
            reckoned = self._reckoning.add(navdata, arrived_s)
            self._vehicle.take(navdata, reckoned, arrived_s)
            if reckoned is None:
                return
            if reckoned.restarted:
                self._poses.clear()
                self._drone_clock = ClockMap()
            self._drone_clock.observe(reckoned.drone_s, arrived_s)
            self._arrivals.append(arrived_s)
        self._poses.add_position(reckoned.drone_s, reckoned.position_enu_m, reckoned.velocity_enu_m_s)
        self._poses.add_attitude(reckoned.drone_s, reckoned.world_from_body_wxyz)
