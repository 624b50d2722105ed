"""Classical stereo from the disparity of two images: Kim & Yow 2015, equation (1), Z = f T / (x_r - x_l).

The formula wants two pictures without a turn between them and a baseline along the picture's rows. So the second
picture is turned back to the first one's attitude by the reported attitudes (rectification), and T is the part of
the way along the first picture's rows; a way ahead or a target that moved is not accounted for, which is what makes
it the classical one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.bearings import bearings, closed_form_estimate
from mission.estimate.stereo import LEAST_PARALLAX
from mission.records import Estimate, FlightSightings


@dataclass(frozen=True, slots=True)
class Classical:
    """Depth along the first picture's axis from the disparity to the picture from furthest to the side."""

    name: str = "classical"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`."""
        lines = bearings(flight, 2)
        seen = lines.seen
        far = int(np.argmax(np.abs(lines.side_m())))
        first_from_far = seen.camera_from_world[0] @ seen.camera_from_world[far].T
        turned = first_from_far @ np.append(seen.measured[far, :2], 1.0)
        baseline = float(seen.camera_from_world[0, 0] @ (seen.camera_m[far] - seen.camera_m[0]))
        disparity = float(seen.measured[0, 0] - turned[0] / turned[2]) if turned[2] > 0.0 else 0.0
        if abs(disparity) < LEAST_PARALLAX:
            raise EstimateRefused("There is no disparity between the pictures", "Fly further to the side.")
        axis_depth = baseline / disparity
        ray = seen.camera_from_world[0].T @ np.append(seen.measured[0, :2], 1.0)
        return closed_form_estimate(
            flight,
            lines,
            (0,),
            lines.place[0] + axis_depth * ray[:2],
            None,
            method=self.name,
            model="stationary",
            notes=("assumes a standing target and a flight along the picture's rows",),
        )
