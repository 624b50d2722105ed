"""What the AR.Drone's pilot process is started with."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from mission.vehicle.ardrone.config import ConfigSession, FlightConfig
from mission.vehicle.ardrone.url import ArdroneAddress
from mission.vehicle.limits import FlightSettings


class ArdronePilotConfig(BaseModel):
    """What the program tells the pilot process at its start."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    address: ArdroneAddress
    session: ConfigSession
    program_port: int
    """Loopback UDP port to which navdata is relayed."""
    connect_timeout_s: float = 10.0
    flight: FlightSettings = FlightSettings()
    drone: FlightConfig = FlightConfig()
