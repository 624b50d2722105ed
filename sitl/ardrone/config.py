"""What a simulated AR.Drone is told before it starts."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field

from mission.records import GeodeticOrigin
from sitl.ardrone.sensors import SensorNoiseName
from sitl.autopilot.airframe import Wind
from sitl.scenario.schema import Scenario

HEADER_SIZES = (64, 68, 76)
"""Lengths of the PaVE header that have been seen on aircraft."""


@dataclass(frozen=True, slots=True)
class ArdroneConfig:
    """One simulated aircraft; port 0 picks a free one."""

    host: str = "127.0.0.1"
    at_port: int = 5556
    navdata_port: int = 5554
    video_port: int = 5555
    control_port: int = 5559
    seed: int = 1
    noise: SensorNoiseName = "good"
    home: GeodeticOrigin = field(default_factory=lambda: GeodeticOrigin(37.2276, 126.8405, 30.0, "amsl"))
    """Local ENU (0, 0, 0), on the ground."""
    heading_rad: float = 0.0
    """Of the nose at the start, clockwise from true north."""
    declination_rad: float = 0.0
    """Of magnetic north, clockwise from true north."""
    gps: bool = False
    """The GPS edition's receiver is plugged in."""
    wind: Wind = field(default_factory=Wind)
    pave_header_bytes: int = 64
    """One of `HEADER_SIZES`; later firmware has the longer ones."""
    battery_percent: float = 100.0
    battery_endurance_s: float = 720.0
    """In the air, from full to empty."""

    def to_json(self) -> str:
        """For the process that runs it."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> ArdroneConfig:
        """The inverse of `to_json`."""
        values = json.loads(text)
        values["home"] = GeodeticOrigin(**values["home"])
        wind = values["wind"]
        values["wind"] = Wind(tuple(wind["mean_enu_m_s"]), wind["gust_m_s"], wind["gust_length_s"])
        return cls(**values)


def config_of(scenario: Scenario) -> ArdroneConfig:
    """The aircraft of a scenario, at free ports of the loopback interface."""
    autopilot, ardrone = scenario.autopilot, scenario.ardrone
    towards = math.radians(autopilot.wind_from_deg + 180.0)
    mean = (autopilot.wind_m_s * math.sin(towards), autopilot.wind_m_s * math.cos(towards), 0.0)
    return ArdroneConfig(
        at_port=0,
        navdata_port=0,
        video_port=0,
        control_port=0,
        seed=scenario.seed,
        noise="rough" if autopilot.noise == "rough" else "good",
        home=scenario.home.origin,
        heading_rad=math.radians(scenario.vehicle.heading_deg),
        declination_rad=math.radians(ardrone.declination_deg),
        gps=ardrone.gps,
        wind=Wind(mean, autopilot.gust_m_s),
    )
