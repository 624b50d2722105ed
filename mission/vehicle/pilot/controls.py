"""What the pilot's rules order of a vehicle; `mission.vehicle.mavlink.controls` does it over MAVLink."""

from __future__ import annotations

from typing import Literal, Protocol

from mission.vehicle.path_follower import Setpoint
from mission.vehicle.state.modes import ModeKind

Ordered = Literal["mode", "arm", "take-off"]
"""What is ordered by a message that the autopilot answers."""
Answer = Literal["accepted", "refused", "not-received", "silent", "lossy"]
"""What became of an order. `not-received`: no answer, and nothing that the autopilot sent is missing; `silent`: no
answer, and something is missing; `lossy`: no answer on a link that loses packets all the time."""


class Controls(Protocol):
    """What the pilot can do to the vehicle. Nothing blocks; an order is one message, its result shows in the state."""

    def ask_mode(self, kind: ModeKind, attempt: int) -> None:
        """Order a flight mode, once; `attempt` counts from 0."""
        ...

    def arm(self, attempt: int) -> None:
        """Order to arm, once."""
        ...

    def take_off(self, height_m: float, attempt: int) -> None:
        """Order to climb to a height above the ground, once."""
        ...

    def answer(self, order: Ordered, since_s: float) -> Answer:
        """What became of the order of this kind that was sent at a time."""
        ...

    def complaint(self) -> str:
        """Why the autopilot refused the last order, or an empty text."""
        ...

    def setpoint(self, setpoint: Setpoint, yaw_rad: float) -> None:
        """Send a position and velocity setpoint with an absolute heading; it is repeated until the next one."""
        ...

    def release(self) -> None:
        """Stop the setpoints at once and leave the mode as it is."""
        ...
