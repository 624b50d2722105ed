"""What the pilot process is started with."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from mission.vehicle.limits import FlightSettings

MAVSDK_COMPONENT = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER: MAVSDK in the pilot process."""
PILOT_COMPONENT = 192
"""The pilot process's own pymavlink side."""
PROGRAM_COMPONENT = 193
"""The program's pymavlink side."""


class PilotConfig(BaseModel):
    """What the program tells the pilot process at its start."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    url: str
    """As MAVSDK takes it."""
    program_port: int
    """Loopback UDP port of the program's link."""
    target_system: int = 0
    """The vehicle; 0 takes the first autopilot that is heard."""
    connect_timeout_s: float = 10.0
    flight: FlightSettings = FlightSettings()
    sparing: bool = False
    """Decode little while nothing is flown, see `mission.vehicle.mavlink.decode_throttle`."""
