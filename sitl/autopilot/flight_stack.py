"""The autopilot's flight stack on its simulated airframe, without any link: what it knows and does by itself.

Everything that happens follows from the configuration, the times passed in and the orders given to its parts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from sitl.aircraft.truth import VehicleTruth
from sitl.autopilot.commander import Commander
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flavour import FLAVOURS
from sitl.autopilot.gimbal import Gimbal, ned_from_frd
from sitl.autopilot.gimbal_manager import GimbalManager
from sitl.autopilot.local_frame import LocalFrame
from sitl.autopilot.navigator import Navigator
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.plan import Plan, PlanItem
from sitl.autopilot.rotation import Vec
from sitl.autopilot.vehicle import Vehicle

TICK_S = 0.005
"""One step of the simulation."""
_GNSS_PERIOD_S = 0.2
_HOME_UNSETTLED_S = 120.0
_HOME_STEP_S = 1.0


class FlightStack:
    """One aircraft with its software.

    Args:
        config: what to simulate.
        now: monotonic seconds of the first step.
        unix_s: UTC seconds at `now`, for SYSTEM_TIME.
    """

    def __init__(self, config: AutopilotConfig, now: float, unix_s: float) -> None:
        self.config, self.flavour = config, FLAVOURS[config.flavour]
        seeds = np.random.SeedSequence(config.seed).spawn(2)
        self._rng = np.random.default_rng(seeds[0])
        self.now = now
        self._boot_at = now - float(self._rng.uniform(20.0, 300.0))
        self._unix_at_0 = unix_s - now
        home = config.home
        self.place = LocalFrame(home.lat_deg, home.lon_deg, config.home_alt_amsl_m, config.geoid_separation_m)
        self.parameters = Parameters(
            {**self.flavour.parameters, **_mount(config)}, dict(config.parameters), bytewise=self.flavour.name == "px4"
        )
        self.vehicle = Vehicle(config, self.flavour, TICK_S, np.random.default_rng(seeds[1]))
        self.commander = Commander(config, self.flavour, self.parameters, now)
        self.commander.home = self.vehicle.estimate.position
        self.plan = Plan(self.flavour)
        self.navigator = Navigator(self.commander, self.plan, self.place, self.vehicle.estimate)
        self.gimbal: GimbalManager | None = None
        if config.gimbal is not None:
            lens = Gimbal(config.gimbal, TICK_S, config.seed, config.heading_rad)
            self.gimbal = GimbalManager(lens, self.flavour.name)
        self._home_jump = 0.0
        self._gnss_at = self._home_at = now
        self.gnss_position: Vec = self.vehicle.estimate.position

    @property
    def boot_s(self) -> float:
        """Seconds since the autopilot booted."""
        return self.now - self._boot_at

    @property
    def boot_ms(self) -> int:
        """Milliseconds since the autopilot booted."""
        return int(self.boot_s * 1e3)

    @property
    def unix_s(self) -> float:
        """UTC."""
        return self.now + self._unix_at_0

    @property
    def home_up(self) -> float:
        """ENU height of the home that relative altitudes count from."""
        return self.commander.home[2] + self._home_jump

    @property
    def truth(self) -> VehicleTruth:
        """Where it really is."""
        truth = self.vehicle.truth(self.now)
        if self.gimbal is None:
            return truth
        return replace(truth, world_from_gimbal_wxyz=np.array(self.gimbal.gimbal.world_from_gimbal))

    def home_item(self) -> PlanItem:
        """Home as ArduPilot shows it in its missions."""
        lat, lon, alt = self.place.geodetic((*self.commander.home[:2], self.home_up))
        zeros = (0.0, 0.0, 0.0, 0.0)
        where = (round(lat * 1e7), round(lon * 1e7), alt)
        return PlanItem(mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, 1, zeros, *where)

    def step(self, now: float) -> None:
        """Advance the aircraft by one tick."""
        self.now = now
        vehicle, commander = self.vehicle, self.commander
        commander.has_mission = self.plan.flyable
        grounded = vehicle.airframe.grounded
        demand, limit = self.navigator.step(now, TICK_S, vehicle.estimate, grounded, vehicle.hover_thrust_n)
        vehicle.step(demand, limit)
        commander.step(now, TICK_S, vehicle.estimate, vehicle.airframe.grounded, demand)
        if self.gimbal is not None:
            true = ned_from_frd(vehicle.airframe.world_from_flu)
            self.gimbal.gimbal.step(now, true, vehicle.ned_from_frd)
        self._measure()

    def _measure(self) -> None:
        """The GNSS receiver's fix, and on PX4 a home altitude that follows it for the first two minutes in the air."""
        preset = self.config.preset
        if self.now >= self._gnss_at:
            self._gnss_at += _GNSS_PERIOD_S
            x, y, z = self.vehicle.airframe.position
            de, dn, du = (preset.gnss_sigma_m * self._rng.standard_normal(3)).tolist()
            self.gnss_position = (x + de, y + dn, z + du)
        air_at = self.commander.air_at
        if self.flavour.name != "px4" or air_at is None or self.now < self._home_at:
            return
        self._home_at = self.now + _HOME_STEP_S
        if self.now - air_at < _HOME_UNSETTLED_S and self.commander.armed:
            self._home_jump = preset.home_altitude_sigma_m * float(self._rng.standard_normal())


def _mount(config: AutopilotConfig) -> dict[str, int | float]:
    """The parameters of a mount, where there is one."""
    if config.gimbal is None:
        return {}
    if config.flavour == "px4":
        return {"MNT_MODE_IN": 4, "MNT_MODE_OUT": 0 if config.gimbal.kind == "servo" else 2}
    return {"MNT1_TYPE": 1 if config.gimbal.kind == "servo" else 6}
