"""Between two sidesteps: go where the target is as far away as it was, so that it stays in view (Figure 2)."""

from __future__ import annotations

import numpy as np

from mission.planning.pattern import legs
from mission.records import Estimate, Vector
from mission.vehicle.drone import Path

SPEED_M_S = 1.5
"""Mean speed of the move."""
WORTH_FLYING_M = 0.7
LONGEST_M = 8.0
NEAREST_M = 3.0
"""No nearer to the target than this, wherever it goes."""


def follow_path(estimate: Estimate, camera_m: Vector, now_s: float) -> Path | None:
    """A straight flight towards the target or away from it, to the distance at which it was first seen.

    Args:
        estimate: of the sidestep before.
        camera_m: where the camera is, ENU, shape (3,).
        now_s: when the flight begins; the target is expected where its velocity has taken it by then.

    Returns:
        None where the target is about as far away as it was.
    """
    velocity = np.zeros(3) if estimate.velocity_enu_m_s is None else estimate.velocity_enu_m_s
    target = estimate.position_enu_m + velocity * (now_s - estimate.t_s)
    towards = (target - camera_m)[:2]
    away_m = float(np.linalg.norm(towards))
    if away_m < 1e-6:
        return None
    move_m = float(np.clip(away_m - max(estimate.depth_m, NEAREST_M), -LONGEST_M, LONGEST_M))
    if abs(move_m) < WORTH_FLYING_M:
        return None
    direction = np.array([*(towards / away_m), 0.0])
    return legs(direction, [0.0, move_m], [max(1.5, abs(move_m) / SPEED_M_S)])
