"""What the pilot's rules order of a vehicle; `mission.drones.controls` does it with MAVSDK."""

from __future__ import annotations

from typing import Protocol

from mission.drones.modes import ModeKind
from mission.drones.path_follower import Setpoint


class Controls(Protocol):
    """What the pilot can do to the vehicle. Nothing here blocks; results show in the vehicle's state."""

    def ask_mode(self, kind: ModeKind, attempt: int) -> None:
        """Send MAV_CMD_DO_SET_MODE; the answer shows in the vehicle's mode."""
        ...

    def arm(self) -> None:
        """Ask to arm; the answer shows in the vehicle's state."""
        ...

    def take_off(self, height_m: float) -> None:
        """Send MAV_CMD_NAV_TAKEOFF for a height above the ground."""
        ...

    def complaint(self) -> str:
        """Why the autopilot refused the last request, or an empty text."""
        ...

    def setpoint(self, setpoint: Setpoint, yaw_rad: float) -> None:
        """Send a position and velocity setpoint with an absolute heading; it is repeated until the next one."""
        ...

    def start(self) -> None:
        """Ask for the mode that flies setpoints."""
        ...

    def stop(self) -> None:
        """Stop the setpoints and ask for hold."""
        ...

    def release(self) -> None:
        """Stop the setpoints at once and leave the mode as it is."""
        ...
