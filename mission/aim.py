"""The heading that keeps the target in the middle of the picture while the aircraft flies past it."""

from __future__ import annotations

import math
from dataclasses import dataclass

LOOK_AHEAD_S = 0.2
"""How long an aircraft takes to follow a new heading, about: the aim leads by this."""
BANDWIDTH_S = 0.25
"""Time over which the filter believes its azimuth rate."""
CAUTIOUS_BANDWIDTH_S = 1.0
"""While the video's delay is not known, the aircraft's own turning looks like the target's: then the aim follows slowly
and does not lead, which keeps the yaw loop stable for delays of half a second and more."""
LARGEST_RATE_RAD_S = 1.5
"""A faster azimuth rate is a wrong sighting, not a target."""


def wrapped(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@dataclass(slots=True)
class Aim:
    """An alpha-beta filter on the target's azimuth (critically damped, for any frame interval)."""

    azimuth_rad: float | None = None
    rate_rad_s: float = 0.0
    t_s: float = 0.0
    cautious: bool = False
    """Whether the times of the azimuths are uncertain."""

    def observe(self, azimuth_rad: float, t_s: float) -> None:
        """Take in an azimuth (clockwise from north) seen at a program time; older ones than the newest are ignored."""
        if self.azimuth_rad is None:
            self.azimuth_rad, self.t_s = azimuth_rad, t_s
            return
        dt = t_s - self.t_s
        if dt <= 0.0:
            return
        if self.cautious:
            innovation = wrapped(azimuth_rad - self.azimuth_rad)
            self.azimuth_rad = wrapped(self.azimuth_rad + (1.0 - math.exp(-dt / CAUTIOUS_BANDWIDTH_S)) * innovation)
            self.t_s = t_s
            return
        fade = math.exp(-dt / BANDWIDTH_S)
        alpha, beta = 1.0 - fade**2, (1.0 - fade) ** 2
        innovation = wrapped(azimuth_rad - (self.azimuth_rad + self.rate_rad_s * dt))
        self.azimuth_rad = wrapped(self.azimuth_rad + self.rate_rad_s * dt + alpha * innovation)
        rate = self.rate_rad_s + beta * innovation / dt
        self.rate_rad_s = max(-LARGEST_RATE_RAD_S, min(LARGEST_RATE_RAD_S, rate))
        self.t_s = t_s

    def predicted(self, t_s: float) -> float:
        """Azimuth at a later time if its rate stays; 0 before the first sighting."""
        return wrapped((self.azimuth_rad or 0.0) + self.rate_rad_s * (t_s - self.t_s))

    def heading(self, now_s: float, camera_azimuth_rad: float = 0.0) -> float | None:
        """The heading to order now, or None before the first sighting.

        Args:
            now_s: program time.
            camera_azimuth_rad: azimuth of the camera's axis relative to the nose (0 for a forward camera).
        """
        if self.azimuth_rad is None:
            return None
        ahead = min(0.6, now_s - self.t_s + LOOK_AHEAD_S)
        return wrapped(self.predicted(self.t_s + ahead) - camera_azimuth_rad)
