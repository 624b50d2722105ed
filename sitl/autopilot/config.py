"""What a simulated autopilot is told before it starts."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Literal

from mission.records import GeodeticOrigin
from sitl.autopilot.airframe import Wind
from sitl.autopilot.estimate_errors import NoiseName, NoisePreset, preset_of
from sitl.autopilot.gimbal_settings import GimbalSettings

FlavourName = Literal["px4", "ardupilot"]


@dataclass(frozen=True, slots=True)
class AutopilotConfig:
    """One simulated aircraft. Ports are on the loopback interface; 0 picks a free one, None leaves the link out."""

    flavour: FlavourName = "px4"
    noise: NoiseName = "good"
    seed: int = 1
    home: GeodeticOrigin = field(default_factory=lambda: GeodeticOrigin(37.2276, 126.8405, 30.0, "amsl"))
    """Local ENU (0, 0, 0) on the ground; an `ellipsoid` altitude has the geoid separation taken off."""
    geoid_separation_m: float = 23.0
    """Ellipsoid height minus height above mean sea level."""
    heading_rad: float = 0.0
    """Of the nose at the start, clockwise from north."""
    wind: Wind = field(default_factory=Wind)
    system_id: int = 1
    remote_port: int = 0
    """UDP port that it sends to, as PX4 does; the companion listens there (udpin)."""
    operator_port: int | None = 0
    """UDP port on which it listens for another ground station (udpout)."""
    tcp_port: int | None = None
    """TCP port on which it serves any number of peers (tcpout)."""
    rc: bool = False
    """Whether a pilot's remote control is there (stick modes are refused or unsafe without)."""
    ready_after_s: float = 3.0
    """From the start until the position estimate is good enough to arm and fly."""
    battery_fraction: float = 1.0
    battery_endurance_s: float = 1200.0
    """In the air, from full to empty."""
    parameters: tuple[tuple[str, float], ...] = ()
    """Changes to the flavour's defaults."""
    gimbal: GimbalSettings | None = None
    """Of the gimbal that it carries."""

    @property
    def home_alt_amsl_m(self) -> float:
        """Altitude of the ground at home above mean sea level."""
        return self.home.alt_m - (self.geoid_separation_m if self.home.datum == "ellipsoid" else 0.0)

    @property
    def preset(self) -> NoisePreset:
        """How its estimate errs."""
        return preset_of(self.noise, self.seed)

    def to_json(self) -> str:
        """For the process that runs it."""
        values = asdict(self)
        values["gimbal"] = None if self.gimbal is None else self.gimbal.model_dump()
        return json.dumps(values)

    @classmethod
    def from_json(cls, text: str) -> AutopilotConfig:
        """The inverse of `to_json`."""
        values = json.loads(text)
        values["home"] = GeodeticOrigin(**values["home"])
        wind = values["wind"]
        values["wind"] = Wind(tuple(wind["mean_enu_m_s"]), wind["gust_m_s"], wind["gust_length_s"])
        values["parameters"] = tuple((str(name), value) for name, value in values["parameters"])
        gimbal = values["gimbal"]
        values["gimbal"] = None if gimbal is None else GimbalSettings.model_validate(gimbal)
        return cls(**values)
