"""Four images of a target that walks straight in any direction: constant velocity from four bearings, in closed form.

p(t) = p_0 + v t has four unknowns in the plane, and each bearing gives one linear equation:

    n_k . p_0 + t_k (n_k . v) = n_k . c_k,    k = 1 .. 4

    [ n_1'  t_1 n_1' ]            [ n_1 . c_1 ]
    [ n_2'  t_2 n_2' ] [ p_0 ]    [ n_2 . c_2 ]
    [ n_3'  t_3 n_3' ] [  v  ]  = [ n_3 . c_3 ]
    [ n_4'  t_4 n_4' ]            [ n_4 . c_4 ]

If the camera flies at constant velocity too, c_k = c_0 + u t_k, the right-hand side is itself a combination of the
columns for (c_0, u), and adding any multiple of (p_0 - c_0, v - u) to a solution gives another: the matrix is
singular, which is the bearings-only observability condition (Nardone & Aidala 1981): the camera has to accelerate,
as it does when it flies out and back. The authors' own follow-up (Yow & Kim, Applied Sciences 2020, 10(19) 6945)
needs four images too.

Of all sightings, thinned to at most sixteen, the four with the largest determinant are used: closed forms do not
average, so the best conditioned ones are worth the most.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mission.errors import EstimateRefused
from mission.estimate.bearings import bearings, closed_form_estimate
from mission.estimate.three_image import LEAST_DETERMINANT
from mission.records import Estimate, FlightSightings

_CANDIDATES = 16


@dataclass(frozen=True, slots=True)
class FourImage:
    """Constant velocity in any direction, from four bearings."""

    name: str = "four-image"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`."""
        lines = bearings(flight, 4)
        t = lines.seen.t_s
        span = max(float(t[-1]), 1e-9)
        rows = np.column_stack((lines.normal, lines.normal * (t / span)[:, None]))
        candidates = np.unique(np.linspace(0, len(t) - 1, min(len(t), _CANDIDATES)).round().astype(np.intp))
        fours = candidates[_fours(len(candidates))]
        determinants = np.abs(np.linalg.det(rows[fours]))
        used = fours[int(np.argmax(determinants))]
        if float(determinants.max()) < LEAST_DETERMINANT:
            raise EstimateRefused(
                "Four bearings cannot tell the target's own motion from parallax here", "Fly out and back."
            )
        solution = np.linalg.solve(rows[used], np.einsum("ki,ki->k", lines.normal[used], lines.place[used]))
        return closed_form_estimate(
            flight,
            lines,
            tuple(int(k) for k in used),
            solution[:2],
            solution[2:] / span,
            method=self.name,
            model="constant-velocity",
            notes=("assumes a target that stands or walks straight at constant speed",),
        )


@lru_cache(maxsize=16)
def _fours(count: int) -> NDArray[np.intp]:
    return np.array(list(combinations(range(count), 4)), dtype=np.intp)
