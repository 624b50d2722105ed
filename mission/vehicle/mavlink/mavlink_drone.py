"""`MavlinkDrone`: a PX4 or ArduPilot multicopter. MAVSDK in the pilot process flies it, pymavlink gives the pose."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.clock import ClockMap
from mission.errors import LinkError
from mission.geodesy import geodetic_to_enu
from mission.gimbal.control import GimbalControl
from mission.gimbal.listener import ATTITUDE_MESSAGES, GimbalListener
from mission.pose.buffer import Pose, PoseAt, PoseBuffer, heading_rate, world_from_body
from mission.pose.history import PoseHistory
from mission.pose.steps import Steps
from mission.records import GeodeticOrigin, Matrix, NoiseModel
from mission.vehicle.drone import Bounds, Capabilities, DroneEvent, Telemetry
from mission.vehicle.limits import FlightSettings
from mission.vehicle.mavlink.decode_throttle import DecodeThrottle
from mission.vehicle.mavlink.gimbal_signs import GIMBAL_MESSAGES, GimbalSigns
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.pilot_config import PROGRAM_COMPONENT, PilotConfig
from mission.vehicle.mavlink.pose_quality import attitude_covariance, noise_model, position_covariance
from mission.vehicle.mavlink.rates import MessageRates
from mission.vehicle.mavlink.url import mavsdk_url
from mission.vehicle.pilot.loopback import loopback_socket
from mission.vehicle.pilot.piloted_drone import KEPT_BEFORE_S, PilotedDrone
from mission.vehicle.state.packet_loss import PacketLoss
from mission.vehicle.state.vehicle_state import VEHICLE_MESSAGES, VehicleState, on_earth

PILOT_MODULE = "mission.vehicle.mavlink.pilot"
_LOG = logging.getLogger(__name__)
_REBOOT_S = 1.0
GIMBAL_RATE_HZ = 20.0
"""Asked for; serial gimbals are polled at 10 to 20 Hz."""
GIMBAL_HOLD_S = 0.25
"""Beyond its newest report a gimbal's lens is taken to look where it looked then, while it is being pointed."""


class MavlinkDrone(PilotedDrone):
    """`mission.vehicle.drone.Drone` over MAVLink; see `PilotedDrone` for what it asks of the program while it flies.

    Args:
        url: the vehicle's address, see `mission.vehicle.mavlink.url`.
        target_system: the vehicle's system id; 0 takes the first autopilot that is heard.
        pose_rate_hz: rate asked for positions and attitudes.
        min_pose_rate_hz: the rate without which `connect` fails.
        flight: limits of the pilot process.
        pilot_log: file for the pilot process's and MAVSDK's own log.
        sparing: decode little while nobody looks, see `mission.vehicle.mavlink.decode_throttle`.
        gimbal_age_s: of a camera on the vehicle's gimbal, how much older the gimbal's angles are than their time
            stamps; None where the camera is fixed to the airframe.
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
        sparing: bool = False,
        gimbal_age_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(min_pose_rate_hz=min_pose_rate_hz, flight=flight, pilot_log=pilot_log, clock=clock)
        self._url = mavsdk_url(url)
        self._target_system = target_system
        self._pose_rate_hz = pose_rate_hz
        self._sparing = sparing
        self._gimbal_age_s = gimbal_age_s
        self._link: MavlinkLink | None = None
        self._rates: MessageRates | None = None
        self._tapper: Callable[[bytes, float], None] | None = None
        self._reset()

    def _reset(self) -> None:
        self._state = VehicleState(self._target_system)
        self._boot = ClockMap()
        self._poses = PoseBuffer()
        self._origin: GeodeticOrigin | None = None
        self._newest_boot_s = 0.0
        self._loss = PacketLoss()
        self._gimbal = GimbalSigns()
        self._lens = None if self._gimbal_age_s is None else GimbalListener(self._gimbal_age_s)
        self._lens_lost = False
        self._pointer: GimbalControl | None = None
        self._steps = Steps()
        self._begun_boot_s = 0.0
        self._thinning = DecodeThrottle(self._target_system, self._clock(), sparing=self._sparing)

    def begin(self, bounds: Bounds) -> None:
        """See `Drone.begin`; poses are kept for as long as the flight may take."""
        super().begin(bounds)
        self._poses.keep_for(bounds.max_duration_s + KEPT_BEFORE_S)
        if self._lens is not None:
            self._lens.keep_for(bounds.max_duration_s + KEPT_BEFORE_S)
        self._lens_lost = False
        self._begun_boot_s, self._steps = self._newest_boot_s, Steps()

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
    def gimbal(self) -> GimbalControl | None:
        """What points the camera, where it is on a gimbal."""
        return self._pointer

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
            sparing=self._sparing,
        )
        system = self._start_pilot(config, sock, timeout_s, PILOT_MODULE)
        self._state = VehicleState(system)
        self._thinning = DecodeThrottle(system, self._clock(), sparing=self._sparing)
        self._link = MavlinkLink(
            sock,
            source_system=system,
            source_component=PROGRAM_COMPONENT,
            target_system=system,
            handler=self._take,
            handled=(*VEHICLE_MESSAGES, *GIMBAL_MESSAGES),
            wants=self._look_at,
            at_leisure=self._thinning.at_leisure,
            clock=self._clock,
        )
        wanted = {"GLOBAL_POSITION_INT": self._pose_rate_hz, "ATTITUDE": self._pose_rate_hz}
        if self._lens is not None:
            self._pointer = GimbalControl(self._link, self._clock)
            wanted["GIMBAL_DEVICE_ATTITUDE_STATUS"] = GIMBAL_RATE_HZ
        self._rates = MessageRates(self._link, wanted, self._clock(), self._thinning.passed_over)
        self._gimbal.ask(self._link)
        self._wait_for_poses(deadline)

    def telemetry(self) -> Telemetry:
        """See `Drone.telemetry`."""
        told = super().telemetry()
        if self._lens is None:
            return replace(told, gimbal=self._gimbal.sign)
        return replace(told, gimbal_trouble=self._lens.trouble(told.t_s), gimbal_doubt=self._lens.doubt(told.t_s))

    def _poses_come(self) -> bool:
        told = self._state.landed_state != mavlink.MAV_LANDED_STATE_UNDEFINED
        return super()._poses_come() and told

    def _too_few_poses(self) -> LinkError:
        if not self._state.connected(self._clock()):
            return LinkError(f"no heartbeat on {self._url}", "Check that the vehicle is on and in range")
        return LinkError(
            f"positions and attitudes come at {self._pose_rate():.0f} Hz, {self._min_pose_rate_hz:.0f} Hz are needed",
            "Check that the link is fast enough and that the autopilot has a position",
        )

    def close(self) -> None:
        """Give control back if it is ours (the pilot process orders hold and ends), and close the link."""
        if self._pointer is not None:
            self._pointer.release()
        super().close()
        if self._link is not None:
            self._link.close()
            self._link = None
        self._rates = None

    def tap(self, taker: Callable[[bytes, float], None] | None) -> None:
        """Hand every frame that is received to `taker`, in the link's thread, until another one or None is given."""
        self._tapper = taker

    def keep_alive(self) -> None:
        """Tell the pilot process that the program's loop is alive, and keep the poses coming."""
        super().keep_alive()
        if self._rates is not None:
            self._rates.keep(self._clock())

    def events(self) -> list[DroneEvent]:
        """See `Drone.events`; also, once, what telemetry the link does not give."""
        events = super().events()
        lost = "" if self._lens is None else self._lens.trouble(self._clock())
        if lost and not self._lens_lost:
            events.append(DroneEvent(self._clock(), "gimbal-lost", lost))
        self._lens_lost = bool(lost)
        text = "" if self._rates is None else self._rates.shortfall()
        return [*events, DroneEvent(self._clock(), "slow-link", text)] if text else events

    def pose_at(self, t_s: float) -> Pose | None:
        """Pose at a program time; None across gaps of more than 0.3 s, beyond the newest message, or before the origin.

        The position's covariance is the absolute one that the autopilot reports; what changes within a pattern is in
        `noise`.
        """
        self._thinning.need(self._clock())
        with self._lock:
            if not self._boot.ready:
                return None
            boot_s = self._boot.to_remote(t_s)
            boot = self._boot.to_remote
            turned = None if self._lens is None else self._lens.at(t_s, boot, self._poses.attitude_at, GIMBAL_HOLD_S)
        pose = self._poses.at(boot_s, position_covariance(self._state), self._attitude_covariance())
        if pose is None or (self._lens is not None and turned is None):
            return None
        return replace(pose, t_s=t_s, world_from_gimbal_wxyz=turned)

    def poses(self) -> PoseAt:
        """`pose_at` as of now, for work in other threads; steps of the estimator since the order are undone."""
        with self._lock:
            boot, snapshot = deepcopy(self._boot), self._poses.snapshot()
            lens = None if self._lens is None else self._lens.snapshot()
        self._steps = snapshot.level(self._begun_boot_s)
        return PoseHistory(snapshot, boot, position_covariance(self._state), self._attitude_covariance(), lens).at

    def noise(self) -> NoiseModel:
        """How good the poses of the last `poses` are within a pattern, see `mission.vehicle.mavlink.pose_quality`."""
        stated = self._steps.widened(noise_model(self._state, self._flight.compass_sigma_rad))
        return stated if self._lens is None else self._lens.noise(stated, self._clock())

    def _attitude_covariance(self) -> Matrix:
        return attitude_covariance(self._state, self._flight.compass_sigma_rad)

    def pose_note(self) -> str:
        """See `Drone.pose_note`."""
        notes = self._steps.note(), "" if self._lens is None else self._lens.note()
        return "; ".join(note for note in notes if note)

    def _pose_rate(self) -> float:
        return 0.0 if self._rates is None else min(self._rates.hz("GLOBAL_POSITION_INT"), self._rates.hz("ATTITUDE"))

    def _packet_loss(self, now_s: float) -> float | None:
        return self._loss.fraction(now_s)

    def _look_at(self, message_id: int, frame: bytes, arrived_s: float) -> bool:
        """In the link's thread."""
        self._loss.observe(frame, self._state.system, arrived_s)
        tapper = self._tapper
        if tapper is not None:
            tapper(frame, arrived_s)
        return self._thinning.wants(message_id, frame, arrived_s)

    def _take(self, message: Any, arrived_s: float) -> None:
        """In the link's thread."""
        name = message.get_type()
        if name == "HEARTBEAT" or name in GIMBAL_MESSAGES:
            self._gimbal.take(message, self._state.system, self._state.autopilot)
            if self._lens is not None and message.get_srcSystem() == self._state.system:
                self._lens.servo = self._gimbal.servo
                if name in ATTITUDE_MESSAGES:
                    self._lens.take(message, arrived_s)
                elif name == "GIMBAL_MANAGER_STATUS" and self._pointer is not None:
                    self._pointer.heard(message)
        if name not in GIMBAL_MESSAGES:
            self._state.update(message, arrived_s)
        if name not in ("GLOBAL_POSITION_INT", "ATTITUDE") or message.get_srcSystem() != self._state.system:
            return
        boot_s = message.time_boot_ms * 1e-3
        with self._lock:
            if boot_s < self._newest_boot_s - _REBOOT_S:
                _LOG.warning("the autopilot's clock went back from %.1f to %.1f s", self._newest_boot_s, boot_s)
                self._poses.clear()
                if self._lens is not None:
                    self._lens.clear()
                self._newest_boot_s = boot_s
            self._newest_boot_s = max(self._newest_boot_s, boot_s)
            self._boot.observe(boot_s, arrived_s)
        if name == "ATTITUDE":
            if not all(map(math.isfinite, (message.roll, message.pitch, message.yaw))):
                return
            turn = heading_rate(message.roll, message.pitch, (message.pitchspeed, message.yawspeed))
            self._poses.add_attitude(boot_s, world_from_body(message.roll, message.pitch, message.yaw), turn)
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
