"""`ARDrone`: the Parrot AR.Drone 2.0 as `Drone`. A pilot process of its own flies it; here is what it tells."""

from __future__ import annotations

import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path as FilePath

from mission.clock import ClockMap
from mission.errors import LinkError
from mission.pose.buffer import Pose, PoseAt, PoseBuffer
from mission.pose.history import PoseHistory
from mission.records import GeodeticOrigin, NoiseModel
from mission.vehicle.ardrone.config import ConfigSession, FlightConfig
from mission.vehicle.ardrone.link import relayed
from mission.vehicle.ardrone.navdata import Navdata
from mission.vehicle.ardrone.pilot_config import ArdronePilotConfig
from mission.vehicle.ardrone.pose_quality import attitude_covariance, noise_model, position_covariance
from mission.vehicle.ardrone.reckoning import Reckoning
from mission.vehicle.ardrone.url import ardrone_address
from mission.vehicle.ardrone.vehicle import ArdroneVehicle
from mission.vehicle.drone import Bounds, Capabilities
from mission.vehicle.limits import FlightSettings
from mission.vehicle.pilot.loopback import loopback_socket
from mission.vehicle.pilot.piloted_drone import KEPT_BEFORE_S, PilotedDrone

PILOT_MODULE = "mission.vehicle.ardrone.pilot"
MAX_SPEED_M_S = 5.0
_RATE_WINDOW_S = 1.0


class ARDrone(PilotedDrone):
    """`mission.vehicle.drone.Drone` for an AR.Drone 2.0.

    Positions are dead reckoned from its velocity, and anchored to GPS where it has a fix; else there is no origin and
    answers are local. See `PilotedDrone` for what it asks of the program while it flies.

    Args:
        url: ``ardrone://HOST?...``, see `mission.vehicle.ardrone.url`.
        min_pose_rate_hz: the rate without which `connect` fails.
        flight: limits of the pilot process.
        pilot_log: file for the pilot process's own log.
        clock: monotonic seconds.

    Raises:
        SettingsError: the address is none.
    """

    _state: ArdroneVehicle

    def __init__(
        self,
        url: str,
        *,
        min_pose_rate_hz: float = 20.0,
        flight: FlightSettings | None = None,
        pilot_log: FilePath | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(min_pose_rate_hz=min_pose_rate_hz, flight=flight, pilot_log=pilot_log, clock=clock)
        self.address = ardrone_address(url)
        self._socket: socket.socket | None = None
        self._reader: threading.Thread | None = None
        self._closing = threading.Event()
        self._reset()

    def _reset(self) -> None:
        self._state = ArdroneVehicle()
        self._reckoning = Reckoning(self.address.declination_rad or 0.0, self.address.velocity_scale)
        self._drone_clock = ClockMap()
        self._poses = PoseBuffer()
        self._arrivals: deque[float] = deque(maxlen=600)

    def begin(self, bounds: Bounds) -> None:
        """See `Drone.begin`; poses are kept for as long as the flight may take."""
        super().begin(bounds)
        self._poses.keep_for(bounds.max_duration_s + KEPT_BEFORE_S)

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
            session=ConfigSession(*(secrets.token_hex(4) for _ in range(3))),
            program_port=sock.getsockname()[1],
            connect_timeout_s=timeout_s,
            flight=self._flight,
            drone=FlightConfig(codec=self.address.codec),
        )
        self._start_pilot(config, sock, timeout_s, PILOT_MODULE)
        sock.settimeout(0.2)
        self._socket = sock
        self._closing.clear()
        self._reader = threading.Thread(target=self._read, args=(sock,), name="navdata", daemon=True)
        self._reader.start()
        self._wait_for_poses(deadline)

    def _too_few_poses(self) -> LinkError:
        return LinkError(
            f"navdata comes at {self._pose_rate():.0f} Hz, {self._min_pose_rate_hz:.0f} Hz are needed",
            "Go nearer to the drone, or to a free Wi-Fi channel",
        )

    def close(self) -> None:
        """Give control back if it is ours (the drone hovers), and close the link."""
        super().close()
        self._closing.set()
        if self._reader is not None:
            self._reader.join(2.0)
            self._reader = None
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def pose_at(self, t_s: float) -> Pose | None:
        """Pose at a program time; None across gaps of more than 0.3 s or beyond the newest packet."""
        with self._lock:
            if not self._drone_clock.ready:
                return None
            drone_s = self._drone_clock.to_remote(t_s)
            place = position_covariance(self._reckoning)
        pose = self._poses.at(drone_s, place, attitude_covariance(self.noise()))
        return None if pose is None else replace(pose, t_s=t_s)

    def poses(self) -> PoseAt:
        """`pose_at` as of now, for work in other threads."""
        with self._lock:
            clock, place = deepcopy(self._drone_clock), position_covariance(self._reckoning)
            poses = self._poses.snapshot()
        return PoseHistory(poses, clock, place, attitude_covariance(self.noise())).at

    def noise(self) -> NoiseModel:
        """How good the reckoned pose is within a pattern, see `mission.vehicle.ardrone.pose_quality`."""
        return noise_model(self._reckoning, declination_known=self.address.declination_rad is not None)

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
            self._state.take(navdata, reckoned, arrived_s)
            if reckoned is None:
                return
            if reckoned.restarted:
                self._poses.clear()
                self._drone_clock = ClockMap()
            self._drone_clock.observe(reckoned.drone_s, arrived_s)
            self._arrivals.append(arrived_s)
        self._poses.add_position(reckoned.drone_s, reckoned.position_enu_m, reckoned.velocity_enu_m_s)
        self._poses.add_attitude(reckoned.drone_s, reckoned.world_from_body_wxyz)
