"""Where the aircraft was and how it was turned at a given time, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass

from mission.records import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """The aircraft's pose at `t_s` as it reports it."""

    t_s: float
    position_enu_m: Vector
    """(3,), relative to the drone's `origin`."""
    velocity_enu_m_s: Vector
    """(3,)."""
    world_from_body_wxyz: Vector
    """(4,), unit quaternion; body is forward-right-down."""
    position_covariance_m2: Matrix
    """(3, 3)."""
    attitude_covariance_rad2: Matrix
    """(3, 3), about the body's forward, right and down axes."""
