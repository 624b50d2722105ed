"""Three images of a target that walks parallel to the flight: Kim & Yow 2015, equations (3) to (5) and (7), corrected.

With d the direction of flight (from the camera's first place to that furthest to the side) and w the target's speed
along it, p(t) = p_0 + w d t. Each bearing gives one equation, n_k . (p_0 + w d t_k) = n_k . c_k, and three of them
give the three unknowns:

    [ n_0'  (n_0 . d) t_0 ] [ p_0 ]   [ n_0 . c_0 ]
    [ n_1'  (n_1 . d) t_1 ] [     ] = [ n_1 . c_1 ]
    [ n_n'  (n_n . d) t_n ] [  w  ]   [ n_n . c_n ]

For the paper's pattern (target centred in image 0, image 1 after one interval from the same place, flight to the
left by T) the solution is Z = T / (tan theta_n - n tan theta_1), its (5) with both angles counted positive to the
right; it holds for both walking directions. The position is p_0 itself, which (7) gives without its depth component.

Image n is the one from furthest to the side, image 1 the one that makes the equations best conditioned (largest
determinant): on the paper's one-way pattern an early one, on an out-and-back pattern the last, at the place of the
first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.bearings import bearings, closed_form_estimate
from mission.records import Estimate, FlightSightings

LEAST_DETERMINANT = 1e-6
"""Of equations with unit rows and time in units of the flight's duration."""


@dataclass(frozen=True, slots=True)
class ThreeImage:
    """Constant speed along the direction of flight, from three bearings."""

    name: str = "three-image"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`."""
        lines = bearings(flight, 3)
        t = lines.seen.t_s
        far = int(np.argmax(np.abs(lines.side_m())))
        way = lines.place[far] - lines.place[0]
        length = float(np.hypot(*way))
        if length < 1e-6:
            raise EstimateRefused("The camera did not move, so there is no parallax", "Fly a lateral pattern.")
        direction = way / length
        span = max(float(t[-1]), 1e-9)
        rows = np.column_stack((lines.normal, (lines.normal @ direction) * t / span))
        systems = np.stack([np.broadcast_to(rows[0], rows.shape), rows, np.broadcast_to(rows[far], rows.shape)], axis=1)
        determinants = np.abs(np.linalg.det(systems))
        middle = int(np.argmax(determinants))
        if determinants[middle] < LEAST_DETERMINANT:
            raise EstimateRefused(
                "Three bearings cannot tell walking along the flight from parallax here",
                "Hover for a moment before flying, or fly out and back.",
            )
        used = tuple(sorted((0, middle, far)))
        solution = np.linalg.solve(rows[list(used)], np.einsum("ki,ki->k", lines.normal, lines.place)[list(used)])
        return closed_form_estimate(
            flight,
            lines,
            used,
            solution[:2],
            solution[2] / span * direction,
            method=self.name,
            model="parallel",
            notes=("assumes a target that stands or walks parallel to the flight at constant speed",),
        )
