"""The simulated autopilot without sockets and without a clock of its own: `step(now)` and bytes on `Link`s.

Everything that happens follows from the configuration, the times passed in and the bytes received.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot import telemetry
from sitl.autopilot.commander import Commander
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.estimate_errors import PRESETS
from sitl.autopilot.flavour import FLAVOURS
from sitl.autopilot.link import Link
from sitl.autopilot.local_frame import LocalFrame
from sitl.autopilot.navigator import Navigator
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.plan import MISSION, Plan, PlanItem, PlanTransfer
from sitl.autopilot.requests import Requests
from sitl.autopilot.rotation import Vec
from sitl.autopilot.vehicle import Vehicle
from sitl.truth import VehicleTruth

TICK_S = 0.005
"""One step of the simulation."""
_GNSS_PERIOD_S = 0.2
_HOME_UNSETTLED_S = 120.0
_HOME_STEP_S = 1.0
_PARAMETERS_PER_TICK = 2


class Autopilot:
    """One aircraft with its software.

    Args:
        config: what to simulate.
        now: monotonic seconds of the first step.
        unix_s: UTC seconds at `now`, for SYSTEM_TIME.
    """

    def __init__(self, config: AutopilotConfig, now: float, unix_s: float) -> None:
        self.config, self.flavour = config, FLAVOURS[config.flavour]
        seeds = np.random.SeedSequence(config.seed).spawn(3)
        self._rng = np.random.default_rng(seeds[0])
        self._radio = np.random.default_rng(seeds[2])
        self.now = now
        self._boot_at = now - float(self._rng.uniform(20.0, 300.0))
        self._unix_at_0 = unix_s - now
        home = config.home
        self.place = LocalFrame(home.lat_deg, home.lon_deg, config.home_alt_amsl_m, config.geoid_separation_m)
        self.parameters = Parameters(
            self.flavour.parameters, dict(config.parameters), bytewise=self.flavour.name == "px4"
        )
        self.vehicle = Vehicle(config, self.flavour, TICK_S, np.random.default_rng(seeds[1]))
        self.commander = Commander(config, self.flavour, self.parameters, now)
        self.commander.home = self.vehicle.estimate.position
        self.plan = Plan(self.flavour)
        self.navigator = Navigator(self.commander, self.plan, self.place, self.vehicle.estimate)
        self.links: list[Link] = []
        self._transfers: dict[int, PlanTransfer] = {}
        self._requests = Requests(self)
        self._home_jump = 0.0
        self._gnss_at = self._home_at = now
        self.gnss_position: Vec = self.vehicle.estimate.position
        self._dumps: dict[int, int] = {}
        self._shown = (self.commander.mode, False)

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
        return self.vehicle.truth(self.now)

    def add_link(self, write: Callable[[bytes], None]) -> Link:
        """A new peer; `write` gets every packet for it."""
        link = Link(write, self.config.system_id, self.flavour.default_rates, self._radio)
        self.links.append(link)
        self._transfers[id(link)] = PlanTransfer(self.plan)
        return link

    def remove_link(self, link: Link) -> None:
        """The peer is gone."""
        self.links.remove(link)
        self._transfers.pop(id(link), None)
        self._dumps.pop(id(link), None)

    def receive(self, link: Link, data: bytes) -> None:
        """Bytes from a peer; anything at all."""
        for message in link.feed(data):
            if self._route(link, message):
                self._requests.handle(link, message)

    def step(self, now: float) -> None:
        """Advance the aircraft by one tick and send what is due."""
        self.now = now
        vehicle, commander = self.vehicle, self.commander
        commander.has_mission = self.plan.flyable
        grounded = vehicle.airframe.grounded
        demand, limit = self.navigator.step(now, TICK_S, vehicle.estimate, grounded, vehicle.hover_thrust_n)
        vehicle.step(demand, limit)
        commander.step(now, TICK_S, vehicle.estimate, vehicle.airframe.grounded, demand)
        self._measure()
        self._transmit()

    def send_all(self, message: Any) -> None:
        """To every peer."""
        for link in self.links:
            link.send(message)

    def build(self, message_id: int) -> Any | None:
        """A message as of now; None if this autopilot does not have it."""
        builder = telemetry.BUILDERS[self.flavour.name].get(message_id)
        return None if builder is None else builder(self)

    def plan_message(self, link: Link, message: Any) -> None:
        """A message of the mission protocol."""
        for answer in self._transfers[id(link)].handle(message, self.now, self.home_item()):
            link.send(answer)

    def dump_parameters(self, link: Link) -> None:
        """Start sending all parameters, a few each tick."""
        self._dumps[id(link)] = 0

    def _route(self, link: Link, message: Any) -> bool:
        """Forward between peers as the MAVLink routing rules say; whether the message is also for us."""
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        ours = self.config.system_id
        source = (message.get_srcSystem(), message.get_srcComponent())
        for other in self.links:
            if other is link or source in other.seen:
                continue
            known = any(s == system and component in (0, c) for s, c in other.seen)
            if system == 0 or known:
                other.forward(message.get_msgbuf())
        if system not in (0, ours):
            return False
        elsewhere = any((ours, component) in other.seen for other in self.links)
        return component in (0, mavlink.MAV_COMP_ID_AUTOPILOT1) or not elsewhere

    def _measure(self) -> None:
        """The GNSS receiver's fix, and on PX4 a home altitude that follows it for the first two minutes in the air."""
        preset = PRESETS[self.config.noise]
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

    def _transmit(self) -> None:
        while self.commander.texts:
            severity, text = self.commander.texts.popleft()
            self.send_all(mavlink.MAVLink_statustext_message(severity, text[:50].encode()))
        shown = (self.commander.mode, self.commander.armed)
        if shown != self._shown and self.flavour.name == "ardupilot":
            self.send_all(telemetry.heartbeat(self))  # PX4 leaves it at 1 Hz: a take-over is seen late there
        self._shown = shown
        reached, self.plan.reached = self.plan.reached, None
        if reached is not None:
            self.send_all(mavlink.MAVLink_mission_item_reached_message(reached))
        for link in self.links:
            for message_id in link.due(self.now):
                message = None if telemetry.silent(self, message_id) else self.build(message_id)
                if message is not None:
                    link.send(message)
            for answer in self._transfers[id(link)].step(self.now):
                link.send(answer)
            self._dump(link)

    def _dump(self, link: Link) -> None:
        index = self._dumps.get(id(link))
        if index is None:
            return
        for at in range(index, min(index + _PARAMETERS_PER_TICK, len(self.parameters))):
            name = self.parameters.name_at(at)
            if name is not None:
                link.send(self.parameters.value_message(name, at))
        self._dumps[id(link)] = index + _PARAMETERS_PER_TICK
        if index + _PARAMETERS_PER_TICK >= len(self.parameters):
            del self._dumps[id(link)]

    def home_item(self) -> PlanItem:
        """Home as ArduPilot shows it in its missions."""
        lat, lon, alt = self.place.geodetic((*self.commander.home[:2], self.home_up))
        zeros = (0.0, 0.0, 0.0, 0.0)
        where = (round(lat * 1e7), round(lon * 1e7), alt)
        return PlanItem(mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, 1, zeros, *where)


__all__ = ["MISSION", "TICK_S", "Autopilot"]
