"""The heading that keeps the target in the middle of the picture while the aircraft flies past it.

Most of the target's apparent motion is the aircraft's own, and that is known. So the filter follows a point on the
ground: along the bearing, at a presumed distance that the target's apparent height suggests. Where the presumption is
wrong, the point moves a little, and the filter follows. Nothing but the heading hangs on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mission.records import Vector

LOOK_AHEAD_S = 0.2
"""How long an aircraft takes to follow a new heading, about: the aim leads by this."""
BANDWIDTH_S = 0.3
"""Time over which the filter believes its velocity."""
CAUTIOUS_BANDWIDTH_S = 1.0
"""While the video's delay is not known, the aircraft's own turning looks like the target's: then the aim follows slowly
and does not lead, which keeps the yaw loop stable for delays of half a second and more."""
RANGE_BANDWIDTH_S = 1.0
"""Time over which the presumed distance follows the apparent height: bearings alone would never correct it."""
LARGEST_SPEED_M_S = 3.0
"""A point that moves faster is a wrong sighting, not a target."""
LARGEST_LEAD_S = 0.8
PRESUMED_HEIGHT_M = 1.7
PRESUMED_RANGE_M = (1.5, 200.0)


def wrapped(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def presumed_range(height_px: float, focal_px: float) -> float:
    """Distance (m) at which somebody of ordinary height looks this tall."""
    return min(PRESUMED_RANGE_M[1], max(PRESUMED_RANGE_M[0], focal_px * PRESUMED_HEIGHT_M / max(height_px, 1.0)))


@dataclass(slots=True)
class Aim:
    """An alpha-beta filter on the presumed point (critically damped, for any frame interval)."""

    range_m: float = 10.0
    """Presumed distance of the first bearing."""
    cautious: bool = False
    """Whether the times of the bearings are uncertain."""
    point_m: Vector | None = None
    """East, north; shape (2,)."""
    velocity_m_s: Vector = field(default_factory=lambda: np.zeros(2))
    t_s: float = 0.0

    def observe(self, azimuth_rad: float, camera_m: Vector, t_s: float, range_m: float | None = None) -> None:
        """Take in a bearing; older ones than the newest are ignored.

        Args:
            azimuth_rad: clockwise from north.
            camera_m: where the camera was, east and north first.
            t_s: program time of the picture.
            range_m: how far away the apparent height says that the target is (`presumed_range`), where it is known.
        """
        towards = np.array([math.sin(azimuth_rad), math.cos(azimuth_rad)])
        if self.point_m is None:
            self.point_m, self.t_s = camera_m[:2] + self.range_m * towards, t_s
            return
        dt = t_s - self.t_s
        if dt <= 0.0:
            return
        expected = self.point_m + self.velocity_m_s * dt
        away = max(PRESUMED_RANGE_M[0], float(np.linalg.norm(expected - camera_m[:2])))
        across = camera_m[:2] + away * towards - expected
        along = np.zeros(2) if range_m is None else (range_m - away) * towards
        if self.cautious:
            self.point_m = expected + (1.0 - math.exp(-dt / CAUTIOUS_BANDWIDTH_S)) * (across + along)
        else:
            fade, slow = math.exp(-dt / BANDWIDTH_S), math.exp(-dt / RANGE_BANDWIDTH_S)
            self.point_m = expected + (1.0 - fade**2) * across + (1.0 - slow**2) * along
            velocity = self.velocity_m_s + ((1.0 - fade) ** 2 * across + (1.0 - slow) ** 2 * along) / dt
            speed = float(np.linalg.norm(velocity))
            self.velocity_m_s = velocity * min(1.0, LARGEST_SPEED_M_S / max(speed, 1e-9))
        self.t_s = t_s

    def trusting(self) -> Aim:
        """The same aim, now that the times of the bearings are known."""
        return Aim(self.range_m, False, self.point_m, np.zeros(2), self.t_s)

    def azimuth(self, t_s: float, camera_m: Vector) -> float | None:
        """The point's azimuth (clockwise from north) from a camera position; None before the first bearing."""
        if self.point_m is None:
            return None
        east, north = self.point_m + self.velocity_m_s * min(LARGEST_LEAD_S, t_s - self.t_s) - camera_m[:2]
        return math.atan2(east, north)
