"""The sidesteps of one procedure, estimated one after another, each with what the ones before it left.

The procedure that flies and `sidestep estimate` on its log go through the same `Passes`, in the same order and over the
same sightings, so a replay gives the same answers bit for bit: all that decides them is in the log, the flights in
their order and each one's word on which flight it continues.

What was carried is believed only where the new pass, estimated on its own, does not contradict it: a target that turned
round, or another one that is followed now, is estimated on its own, and the estimate says so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import gammaincinv

from mission.errors import EstimateRefused
from mission.estimate.fuse import BETWEEN_PSD_M2_S3, Carried, carry_on
from mission.records import Estimate, FlightSightings

_COMPARED = [0, 1, 3, 4, 6]
"""Horizontal position and velocity, and the size: places in what is carried."""
SAME_TARGET_CHI2 = 2.0 * float(gammaincinv(len(_COMPARED) / 2.0, 0.999))
"""A target that moves as expected fails once in a thousand passes."""


class Passes:
    """Estimates pass after pass; remembers what the last one left."""

    def __init__(self) -> None:
        self._left: tuple[str, Carried] | None = None

    name = "batch"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """One pass (an `Estimator` with a memory).

        Args:
            flight: its sightings. The flight that it continues must be the one before it here; otherwise it stands for
                itself.

        Raises:
            EstimateRefused: the sightings (with what was carried) cannot support a position. What was carried is kept
                for the next pass, which then continues the same one.
        """
        carried = self._carried(flight)
        if carried is None:
            estimate, left = carry_on(flight)
            if flight.continues is not None:
                estimate = _noted(estimate, f"stands for itself: {flight.continues} is not the pass before it")
        else:
            estimate, left = _continued(flight, carried)
        self._left = (flight.id, left)
        return estimate

    def _carried(self, flight: FlightSightings) -> Carried | None:
        if flight.continues is None or self._left is None or self._left[0] != flight.continues or not flight.sightings:
            return None
        known = self._left[1]
        return known if known.t_s <= flight.sightings[0].t_s else None


def _continued(flight: FlightSightings, carried: Carried) -> tuple[Estimate, Carried]:
    try:
        own = carry_on(flight)
    except EstimateRefused:
        return carry_on(flight, carried)  # on its own it says too little; what was carried may be enough
    if surprise(carried, own[1], flight) > SAME_TARGET_CHI2:
        return _noted(own[0], "stands for itself: the target turned since the pass before, or is another one"), own[1]
    return carry_on(flight, carried)


def surprise(carried: Carried, own: Carried, flight: FlightSightings) -> float:
    """How far a pass on its own is from what was expected of it, chi-square with 5 degrees of freedom, never too much.

    Both share the biases, so that their difference is less than the sum of their variances allows.

    Args:
        carried: from the pass before.
        own: what the pass says on its own.
        flight: the pass's sightings.
    """
    psd = max(flight.prior.acceleration_psd_m2_s3, BETWEEN_PSD_M2_S3)
    expected = carried.at(own.t_s, psd, flight.noise.position_walk_m_per_sqrt_s)
    places = np.ix_(_COMPARED, _COMPARED)
    off = (own.mean - expected.mean)[_COMPARED]
    return float(off @ np.linalg.solve(own.covariance[places] + expected.covariance[places], off))


def _noted(estimate: Estimate, note: str) -> Estimate:
    return replace(estimate, notes=(*estimate.notes, note))
