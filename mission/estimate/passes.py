"""The sidesteps of one procedure, estimated one after another, each together with the ones before it.

The procedure that flies and `sidestep estimate` on its log go through the same `Passes`, in the same order and over the
same sightings, so a replay gives the same answers bit for bit: all that decides them is in the log, the flights in
their order and each one's word on which flight it continues.

Passes are estimated together under one motion model, so that a target wanders in a gap as it does in view, and a
heading that is 2 degrees off in each pass is not averaged out. Earlier passes are believed only where the new one,
estimated on its own, does not contradict them: another person who is followed now is estimated on their own, and the
estimate says so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.batch import estimate_together
from mission.records import Estimate, FlightSightings

_BETWEEN_PSD_M2_S3: Final = 0.06
"""How a walking person's velocity wanders while nobody looks: 0.25 m/s in a second."""
_MOST_PASSES: Final = 4
"""Passes estimated together; older ones say next to nothing of where a target is now."""
SAME_TARGET_CHI2: Final = 13.8
"""Chi-square with 2 degrees of freedom that a target which moves as expected exceeds once in a thousand passes."""


class Passes:
    """Estimates pass after pass; remembers the ones before (an `Estimator` with a memory)."""

    name = "batch"

    def __init__(self) -> None:
        self._before: tuple[FlightSightings, ...] = ()
        self._estimate: Estimate | None = None

    def estimate(self, flight: FlightSightings) -> Estimate:
        """One pass.

        Args:
            flight: its sightings. The flight that it continues must be the one before it here; otherwise it stands for
                itself.

        Raises:
            EstimateRefused: the sightings (with those before) cannot support a position. The passes before are kept for
                the next one, which then continues the same one.
        """
        if not self._continues(flight):
            estimate = estimate_together((flight,))
            if flight.continues is not None:
                estimate = _noted(estimate, f"stands for itself: {flight.continues} is not the pass before it")
            self._before, self._estimate = (flight,), estimate
            return estimate
        together = (*self._before, flight)[-_MOST_PASSES:]
        try:
            own = estimate_together((flight,))
        except EstimateRefused:
            estimate = estimate_together(together)  # on its own it says too little; with the others it may be enough
        else:
            if self._estimate is not None and surprise(self._estimate, own) > SAME_TARGET_CHI2:
                note = "stands for itself: the target turned since the pass before, or is another one"
                together, estimate = (flight,), _noted(own, note)
            else:
                estimate = estimate_together(together)
        self._before, self._estimate = together, estimate
        return estimate

    def _continues(self, flight: FlightSightings) -> bool:
        if flight.continues is None or not self._before or not flight.sightings:
            return False
        before = self._before[-1]
        return before.id == flight.continues and before.sightings[-1].t_s <= flight.sightings[0].t_s


def surprise(before: Estimate, own: Estimate) -> float:
    """How far a pass on its own begins from where the one before expected it, chi-square with 2 degrees of freedom.

    Both share the biases, so that their difference is less than the sum of their variances allows.

    Args:
        before: what the pass before said, at its last sighting.
        own: what this pass says on its own, with its first position.
    """
    if before.covariance is None or before.velocity_enu_m_s is None or own.first is None:
        return 0.0
    dt = max(own.first.t_s - before.t_s, 0.0)
    move = np.hstack((np.eye(2), np.zeros((2, 1)), dt * np.eye(2), np.zeros((2, 1))))
    expected = before.position_enu_m[:2] + dt * before.velocity_enu_m_s[:2]
    spread = move @ before.covariance @ move.T + own.first.covariance[:2, :2]
    spread += _BETWEEN_PSD_M2_S3 * dt**3 / 3.0 * np.eye(2)
    off = own.first.position_enu_m[:2] - expected
    return float(off @ np.linalg.solve(spread, off))


def _noted(estimate: Estimate, note: str) -> Estimate:
    return replace(estimate, notes=(*estimate.notes, note))
