"""One ray onto flat ground: what single-image tools do.

The lowest point of the body in the first picture, followed to the horizontal plane of the ground. The camera's height
above that plane, its tilt and the flatness of the ground are taken as exact, so a tilt error e moves the answer by
Z (Z / h + h / Z) e: at 1.5 m above the ground and 9 m away, half a degree is half a metre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.observations import observe
from mission.records import Estimate, FirstPosition, FlightSightings


@dataclass(frozen=True, slots=True)
class GroundRay:
    """The first sighting's foot on the plane up = `ground_up_m` of the flight's local frame."""

    ground_up_m: float = 0.0
    name: str = "ground ray"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`; the target is taken as standing."""
        seen = observe(flight)
        sized = np.flatnonzero(seen.size_scale > 0.0)
        if len(sized) == 0:
            raise EstimateRefused("No sighting has a height, so there is no foot to follow", "Use another method.")
        k = int(sized[0])
        # An upright body of height H at depth Z along the camera's axis: its foot is at Z (u, 1) + H/2 down. With
        # w = H / 2 Z and down = (a, b), its ends are at (u - w a) / (1 - w b) and (u + w a) / (1 + w b), and the
        # measured height in tangents is their distance, 2 w |a - u b| / (1 - w^2 b^2).
        down = -seen.camera_from_world[k][:, 2]
        centre, height = seen.measured[k, :2], float(np.exp(seen.measured[k, 2]))
        slant = float(np.linalg.norm(down[:2] - centre * down[2]))
        half = height / (slant + math.sqrt(slant**2 + (height * down[2]) ** 2))
        foot = np.append(centre, 1.0) + half * down
        ray = seen.camera_from_world[k].T @ foot
        camera = seen.reference_m + seen.camera_m[k]
        if not (ray[2] < 0.0 and camera[2] > self.ground_up_m):
            raise EstimateRefused("The ray to the foot does not meet the ground", "Fly higher, or use another method.")
        place = camera + ray * ((self.ground_up_m - camera[2]) / ray[2])
        return Estimate(
            id=flight.id,
            method=self.name,
            model="stationary",
            t_s=flight.sightings[-1].t_s,
            position_enu_m=place,
            velocity_enu_m_s=None,
            covariance=None,
            first=FirstPosition(flight.sightings[0].t_s, place, np.full((3, 3), np.nan)),
            depth_m=float(np.hypot(*(place - camera)[:2])),
            sightings=len(flight.sightings),
            rejected=0,
            chi2=None,
            dof=None,
            notes=("the ground is taken as flat and its height as exact",),
        )
