"""Two images of a standing target: Kim & Yow 2015, equations (2) and (6), the latter corrected.

The paper centres the target in image 0, flies T to the side, and gets Z = T / tan(theta) from the angle theta at
which image n sees it. As vectors, for any path and any heading: with c = c_n - c_0 and the bearings b_0, b_n of unit
length,

    p = c_0 + Z b_0,    Z = (n_n . c) / (n_n . b_0)

which is T / tan(theta) where c is perpendicular to b_0. (The printed (6) has tan(theta) / T, which is not a length.)
Image n is the one taken furthest to the side. For a target that walks along the line of sight, the paper's
perpendicular case, Z is its depth at image n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.bearings import bearings, closed_form_estimate
from mission.records import Estimate, FlightSightings

LEAST_PARALLAX = 2e-3
"""Sine of the angle between two lines of sight below which they do not cross anywhere in particular (one pixel)."""


@dataclass(frozen=True, slots=True)
class Stereo:
    """Where the first line of sight and that from furthest to the side cross."""

    name: str = "stereo"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`."""
        lines = bearings(flight, 2)
        far = int(np.argmax(np.abs(lines.side_m())))
        parallax = float(lines.normal[far] @ lines.along[0])
        if abs(parallax) < LEAST_PARALLAX:
            raise EstimateRefused(
                "The lines of sight are parallel, so there is no parallax", "Fly further to the side of the target."
            )
        depth = float(lines.normal[far] @ (lines.place[far] - lines.place[0])) / parallax
        return closed_form_estimate(
            flight,
            lines,
            (0, far),
            lines.place[0] + depth * lines.along[0],
            None,
            method=self.name,
            model="stationary",
            notes=(
                f"assumes a standing target; of one that walks along the line of sight the depth is that at t = "
                f"{lines.seen.start_s + lines.seen.t_s[far]:.2f} s",
            ),
        )
