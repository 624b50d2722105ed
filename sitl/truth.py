"""The truth of a simulated flight, shared between the simulator's own processes and with nobody else.

The autopilot's process writes where the aircraft really is into a ring in shared memory; the camera's process reads it to
render, and the scorer reads it afterwards. Nothing of `mission` or `gcs_plugin` ever sees it.
"""

from __future__ import annotations

from dataclasses import dataclass

from mission.records import Vector


@dataclass(frozen=True, slots=True, eq=False)
class VehicleTruth:
    """The aircraft's true state at `t_s` (monotonic clock). Local ENU around the scenario's home."""

    t_s: float
    position_enu_m: Vector
    """(3,)"""
    velocity_enu_m_s: Vector
    """(3,)"""
    world_from_body_wxyz: Vector
    """(4,), body forward-right-down."""
