"""What a simulated gimbal is told before it starts: a scenario's table ``[gimbal]``."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from sitl.scenario.table import Degrees, Table

Tells = Literal["nose", "north", "nose-delta", "older"]
"""What its yaw is from, and how it says so: flag 32, flag 64, flag 32 with delta_yaw, or no flag at all."""


class GimbalSettings(Table):
    """The gimbal that carries the camera."""

    kind: Literal["stabilised", "servo"] = "stabilised"
    """servo: two servos that the autopilot moves against its own attitude, without feedback."""
    tells: Tells = "nose"
    rate_hz: float = Field(default=20.0, ge=1.0, le=100.0)
    """At which it measures; asked for faster, the same angles come again."""
    age_ms: float = Field(default=50.0, ge=0.0, le=400.0)
    """How old its angles are when they are sent."""
    lag_s: float = Field(default=0.12, ge=0.01, le=2.0)
    """Time constant of its motors."""
    follow_lag_s: float = Field(default=0.6, ge=0.0, le=3.0)
    """And of what it takes the nose's heading to be while it follows it."""
    rate_limit_deg_s: float = Field(default=90.0, gt=1.0, le=400.0)
    yaw_bias_deg: float | None = Field(default=None, ge=-180.0, le=180.0)
    """Error of its zero; None draws it from N(0, 5) by the seed."""
    wander_deg: float = Field(default=0.04, ge=0.0, le=2.0)
    """Standard deviation of what its own sensor does not see."""
    noise_deg: float = Field(default=0.03, ge=0.0, le=2.0)
    """Of each angle that it reports."""
    pitch_range_deg: tuple[Degrees, Degrees] = (-95.0, 25.0)
    yaw_range_deg: tuple[float, float] = (-160.0, 160.0)
    """From the nose."""
    start_pitch_deg: float = Field(default=-20.0, ge=-90.0, le=25.0)
