"""The simulated AR.Drone 2.0 without sockets and without a clock of its own: datagrams in, packets out.

Everything that happens follows from the configuration, the times passed in and the bytes received.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

import numpy as np

from sitl.aircraft.truth import VehicleTruth
from sitl.ardrone import navdata
from sitl.ardrone.aircraft import Aircraft
from sitl.ardrone.at import (
    ACKNOWLEDGE,
    CONFIGURATION_GET,
    CUSTOM_CONFIGURATION_GET,
    Command,
    Comwdg,
    Config,
    ConfigIds,
    Ctrl,
    Ftrim,
    Pcmd,
    Ref,
    parse_datagram,
)
from sitl.ardrone.commander import Commander
from sitl.ardrone.config import ArdroneConfig
from sitl.ardrone.configuration import Configuration
from sitl.ardrone.link import PilotLink
from sitl.ardrone.sensors import PRESETS
from sitl.ardrone.state import StateBit
from sitl.autopilot.local_frame import LocalFrame

TICK_S = 0.005
FULL_PERIOD_S = 0.005
DEMO_PERIOD_S = 1.0 / 15.0
BOOTSTRAP_PERIOD_S = 1.0 / 15.0

_FIELD_MG = (210.0, 430.0)
"""Horizontal and downward parts of the earth's field."""
_ALWAYS = (
    StateBit.VISION
    | StateBit.ALTITUDE_CONTROL
    | StateBit.CAMERA_READY
    | StateBit.PIC_VERSION_OK
    | StateBit.ATCODEC_THREAD
    | StateBit.NAVDATA_THREAD
    | StateBit.VIDEO_THREAD
    | StateBit.ACQUISITION_THREAD
)
_log = logging.getLogger(__name__)


class Ardrone:
    """One aircraft with its software.

    Args:
        config: what to simulate.
        now_s: monotonic seconds of the first step.
        booted_s: when it was switched on; `now_s`, when not given.
    """

    def __init__(self, config: ArdroneConfig, now_s: float, booted_s: float | None = None) -> None:
        self.config = config
        self.booted_s = now_s if booted_s is None else booted_s
        """Zero of its own clock: of navdata's time option and of the video's timestamps."""
        self.now_s = now_s
        self.configuration = Configuration()
        self.link = PilotLink()
        self.aircraft = Aircraft(
            PRESETS[config.noise], config.wind, config.heading_rad, TICK_S, np.random.default_rng(config.seed)
        )
        self.commander = Commander(
            self.aircraft, self.configuration, config.battery_percent, config.battery_endurance_s
        )
        self.bootstrap = True
        """Only the header is sent until a client chooses what it wants (`general:navdata_demo`)."""
        self._command_mask = False
        self._options_chosen = False
        self._sequence = 0
        self._wanted_listings: list[bytes] = []
        self._place = LocalFrame(config.home.lat_deg, config.home.lon_deg, config.home.alt_m, 0.0)
        self.configuration.changed.append(self._configured)

    def receive(self, data: bytes, now_s: float) -> None:
        """A datagram at the AT port. Never raises."""
        self.link.heard(now_s)
        for command in parse_datagram(data):
            if self.link.accepts(command.sequence):
                self._obey(command)

    def step(self, now_s: float) -> None:
        """Let one tick pass."""
        self.now_s = now_s
        if self.link.step(now_s):
            self.commander.pilot_lost()
            self.bootstrap = True
        self.commander.step()

    def take_listing(self) -> bytes | None:
        """What the control port has to send now (an answer to CTRL 4 or 6)."""
        return self._wanted_listings.pop(0) if self._wanted_listings else None

    @property
    def navdata_period_s(self) -> float:
        """Seconds between two navdata packets: 200 a second in full mode, 15 otherwise."""
        if self.bootstrap:
            return BOOTSTRAP_PERIOD_S
        return DEMO_PERIOD_S if self.configuration.flag("general:navdata_demo") else FULL_PERIOD_S

    @property
    def state_bits(self) -> StateBit:
        """The header's second word."""
        c = self.commander
        bits = _ALWAYS
        for condition, bit in (
            (c.state.in_the_air, StateBit.FLYING),
            (self.configuration.flag("general:video_enable"), StateBit.VIDEO),
            (c.wants_air, StateBit.USER_FEEDBACK),
            (self._command_mask, StateBit.COMMAND),
            (self.configuration.flag("general:navdata_demo"), StateBit.NAVDATA_DEMO),
            (self.bootstrap, StateBit.NAVDATA_BOOTSTRAP),
            (self.link.lost, StateBit.COM_LOST),
            (c.battery_low, StateBit.BATTERY_LOW),
            (c.user_emergency, StateBit.USER_EMERGENCY),
            (c.angles_out_of_range, StateBit.ANGLES_OUT_OF_RANGE),
            (self.link.watchdog, StateBit.COM_WATCHDOG),
            (c.emergency, StateBit.EMERGENCY),
        ):
            if condition:
                bits |= bit
        return bits

    def navdata_packet(self, frames: int = 0) -> bytes:
        """The next packet.

        Args:
            frames: pictures sent so far.
        """
        self._sequence += 1
        return navdata.packet(self.state_bits, self._sequence, [] if self.bootstrap else self._options(frames))

    @property
    def truth(self) -> VehicleTruth:
        """The true state now."""
        return self.aircraft.truth(self.now_s)

    def _obey(self, command: Command) -> None:
        match command:
            case Ref():
                self.commander.ref(command)
            case Pcmd():
                self.commander.pcmd(command)
            case Ftrim():
                self.commander.flat_trim()
            case ConfigIds(_, session, user, application):
                self.configuration.announce(session, user, application)
            case Config(_, key, value):
                # The bit says that a command came, not that it was obeyed.
                self._command_mask = True
                if not self.configuration.set(key, value):
                    _log.info("configuration refused: %s = %s", key, value)
            case Comwdg():
                self.link.reset_watchdog()
            case Ctrl(_, mode):
                self._control(mode)

    def _control(self, mode: int) -> None:
        if mode == ACKNOWLEDGE:
            self._command_mask = False
        elif mode in (CONFIGURATION_GET, CUSTOM_CONFIGURATION_GET):
            listing = self.configuration.listing() if mode == CONFIGURATION_GET else self.configuration.custom_listing()
            self._wanted_listings.append(listing)

    def _configured(self, key: str) -> None:
        if key == "general:navdata_demo":
            self.bootstrap = False
        if key == "general:navdata_options":
            self._options_chosen = True

    def _options(self, frames: int) -> list[bytes]:
        demo = self.configuration.flag("general:navdata_demo")
        mask = int(self.configuration.number("general:navdata_options"))
        if not demo and not self._options_chosen:
            mask = 0xFFFFFFFF
        m = self.motion()
        height = self.commander.wanted_height_m
        raw_mm = max(0, m.altitude_mm)
        found: dict[navdata.Tag, Callable[[], bytes]] = {
            navdata.Tag.DEMO: lambda: navdata.demo_option(m, frames),
            navdata.Tag.TIME: lambda: navdata.time_option(self.now_s - self.booted_s),
            navdata.Tag.EULER_ANGLES: lambda: navdata.euler_option(m.theta_mdeg, m.phi_mdeg),
            navdata.Tag.TRIMS: lambda: navdata.trims_option(0.0, 0.0),
            navdata.Tag.ALTITUDE: lambda: navdata.altitude_option(
                m.altitude_mm, -m.vz_mm_s, round(1000.0 * height), raw_mm
            ),
            navdata.Tag.VISION_DETECT: navdata.vision_detect_option,
            navdata.Tag.MAGNETO: lambda: navdata.magneto_option(self._magnetometer()),
            navdata.Tag.WIFI: lambda: navdata.wifi_option(900),
        }
        if self.config.gps:
            found[navdata.Tag.GPS] = lambda: navdata.gps_option(self._gps())
        return [option() for tag, option in found.items() if mask >> tag & 1]

    def motion(self) -> navdata.Motion:
        """What the sensors say now."""
        a = self.aircraft
        roll, pitch, heading = a.euler
        estimate = a.estimate
        magnetic = math.remainder(heading - self.config.declination_rad, 2.0 * math.pi)
        return navdata.Motion(
            state=self.commander.state,
            battery_percent=max(0, math.ceil(self.commander.battery_percent)),
            theta_mdeg=1000.0 * math.degrees(pitch),
            phi_mdeg=1000.0 * math.degrees(roll),
            psi_mdeg=1000.0 * math.degrees(magnetic),
            altitude_mm=0 if a.grounded else max(0, round(1000.0 * estimate.position[2])),
            vx_mm_s=1000.0 * a.flow[0],
            vy_mm_s=1000.0 * a.flow[1],
            vz_mm_s=-1000.0 * estimate.velocity[2],
        )

    def _magnetometer(self) -> navdata.Magnetometer:
        magnetic = self.aircraft.euler[2] - self.config.declination_rad
        level, down = _FIELD_MG
        heading = math.degrees(magnetic)
        field = (level * math.cos(magnetic), -level * math.sin(magnetic), down)
        return navdata.Magnetometer(heading, heading, heading, field, calibrated=True)

    def _gps(self) -> navdata.GpsFix:
        a = self.aircraft
        error = a.errors.gps_enu_m
        east, north, up = (p + e for p, e in zip(a.position_enu_m, error, strict=True))
        lat, lon, alt = self._place.geodetic((east, north, up))
        velocity_east, velocity_north, velocity_up = a.velocity_enu_m_s
        sigma = max(0.5, PRESETS[self.config.noise].gps.sigma)
        return navdata.GpsFix(
            lat_deg=lat,
            lon_deg=lon,
            fused_lat_deg=lat,
            fused_lon_deg=lon,
            elevation_m=alt,
            zero_lat_deg=self.config.home.lat_deg,
            zero_lon_deg=self.config.home.lon_deg,
            hdop=1.1,
            satellites=9,
            speed_m_s=math.hypot(velocity_east, velocity_north),
            course_deg=math.degrees(math.atan2(velocity_east, velocity_north)) % 360.0,
            ned_velocity_m_s=(velocity_north, velocity_east, -velocity_up),
            accuracy_m=(sigma, sigma, 1.5 * sigma),
            time_of_week_s=self.now_s - self.booted_s,
            week=1820,
            fixed=True,
        )
