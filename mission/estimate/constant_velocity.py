"""The most probable state of a target at constant velocity: maximum a posteriori, target and camera errors jointly.

From several starts (`starts.py`) the joint model (`joint_model.py`) is minimised by Gauss-Newton; wrong sightings
are taken out (`wrong_sightings.py`); the covariance is the inverse of the information at the minimum with everything
but the target eliminated. Same input, same answer, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mission.errors import EstimateRefused
from mission.estimate.arrow import NotPositiveDefinite
from mission.estimate.gauss_newton import Minimum, minimise
from mission.estimate.joint_model import WHITE, JointModel
from mission.estimate.observations import Observations, observe, tamed_noise, tamed_prior
from mission.estimate.outliers import PIXEL_LIMIT, SIZE_LIMIT, blunder_scores, plausible, worst
from mission.estimate.posterior import to_estimate
from mission.estimate.starts import Start, find_starts, meets_behind
from mission.records import Estimate, FlightSightings, Vector

_RIVAL = 12.0
"""A start whose cost is this much above the best one's (as a share of it, or absolutely) is not tried."""
_ROUNDS = 12
_READMISSIONS = 3
_MAJORITY = 0.55
"""Share of the sightings that must fit a target."""
_SUSPICIOUS = 2.0
"""A chi-square this many times its degrees of freedom is not noise."""


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """Maximum a posteriori over all sightings (see the module)."""

    name: str = "constant-velocity"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`."""
        seen = observe(flight)
        if len(seen.t_s) < 3:
            raise EstimateRefused(
                f"{len(seen.t_s)} usable sightings are too few", "Keep the target in view for three sightings or more."
            )
        flight = replace(flight, noise=tamed_noise(flight.noise), prior=tamed_prior(flight.prior))
        try:
            with np.errstate(all="ignore"):  # what overflows ends as a singular matrix, and that is refused
                return to_estimate(flight, *most_probable(flight, seen))
        except (NotPositiveDefinite, np.linalg.LinAlgError):
            raise EstimateRefused(
                "The sightings do not determine a position", "Fly further sideways, and keep the target in view."
            ) from None


def most_probable(flight: FlightSightings, seen: Observations) -> tuple[JointModel, Minimum]:
    """The lowest minimum that the starts lead to, over the sightings that fit it.

    Args:
        flight: its noise model and prior are used.
        seen: its observations, three at least.

    Raises:
        EstimateRefused: no start leads anywhere, or the sightings contradict each other.
        NotPositiveDefinite: something is not observable.
    """
    found = find_starts(seen, flight.noise, flight.prior)
    kept = seen if found.right.all() and found.sized.all() else seen.only(found.right, found.sized)
    best: tuple[JointModel, Minimum] | None = None
    refused = EstimateRefused("No distance explains the sightings", "Check the camera's mounting.")
    for start in found.starts:
        if best is not None and start.cost > found.starts[0].cost + _RIVAL:
            break
        try:
            candidate = _from_start(JointModel(kept, flight.noise, flight.prior), start)
        except EstimateRefused as error:
            refused = error
            continue
        if best is None or _worth(candidate) < _worth(best):
            best = candidate
    if best is None:
        raise refused
    model, minimum = best
    for _ in range(_READMISSIONS):
        before = model.count
        if before == len(seen.t_s):
            break
        model, minimum = _readmitted(seen, model, minimum)
        if model.count <= before:
            break
    if model.count < _MAJORITY * len(seen.t_s):
        if meets_behind(seen, flight.noise, flight.prior):
            raise EstimateRefused(
                "The lines of sight meet behind the camera",
                "Check the camera's mounting, and that the quaternion is world_from_camera with w first.",
            )
        raise EstimateRefused(
            "The sightings contradict each other: no single target explains most of them",
            "Check that one and the same person was tracked, and the camera's calibration and mounting.",
        )
    return model, minimum


def _worth(candidate: tuple[JointModel, Minimum]) -> float:
    """Cost, with what was taken out charged as if it had just failed: fewer sightings must not win by being fewer."""
    model, minimum = candidate
    return minimum.at.cost - PIXEL_LIMIT * model.count


def _from_start(model: JointModel, start: Start) -> tuple[JointModel, Minimum]:
    """The minimum near a start, without blunders.

    Where two steps leave far more chi-square than noise would, blunders are looked for at once, and the next round
    begins at the start again: what does not fit would lead the minimisation astray. If that takes out too many, it was
    the start that did not fit, and they are looked for at the minimum only.
    """
    whole = model
    while model.count >= _MAJORITY * whole.count:
        first = minimise(model, model.start(start.position_m, start.velocity_m_s, start.log_size), max_steps=2)
        smaller = _less(model, first)[0] if first.at.cost > _SUSPICIOUS * model.freedom else None
        if smaller is None:
            return _without_blunders(model, _continued(model, first))
        model = smaller
    state = whole.start(start.position_m, start.velocity_m_s, start.log_size)
    return _without_blunders(whole, minimise(whole, state))


def _continued(model: JointModel, first: Minimum) -> Minimum:
    return first if first.converged else minimise(model, first.at)


def _less(model: JointModel, minimum: Minimum) -> tuple[JointModel | None, NDArray[np.intp]]:
    """The model without the worst blunders, or None when there are none, and the rows that it kept."""
    pixel, size = blunder_scores(model, minimum.at)
    # A glitch in one channel spoils the other's scores, so only the worse of the two is looked at.
    if pixel.max() / PIXEL_LIMIT >= size.max() / SIZE_LIMIT:
        wrong, unsized = worst(pixel, PIXEL_LIMIT), np.zeros(model.count, dtype=bool)
    else:
        wrong, unsized = np.zeros(model.count, dtype=bool), worst(size, SIZE_LIMIT)
    rows = np.flatnonzero(~wrong)
    if not (wrong.any() or unsized.any()) or len(rows) < 3:
        return None, rows
    return model.over(model.seen.only(~wrong, ~unsized)), rows


def _without_blunders(model: JointModel, minimum: Minimum) -> tuple[JointModel, Minimum]:
    """Take out what does not fit, the worst first, until everything fits."""
    for _ in range(_ROUNDS):
        smaller, rows = _less(model, minimum)
        if smaller is None:
            break
        minimum = minimise(smaller, smaller.adopt(model, minimum.at.state, rows))
        model = smaller
    return model, minimum


def _readmitted(seen: Observations, model: JointModel, minimum: Minimum) -> tuple[JointModel, Minimum]:
    """Take back what was found wrong too early: the start was rough, and the most probable state knows better."""
    everything = model.over(seen)
    state = everything.adopt(model, minimum.at.state, _nearest(model.seen.t_s, seen.t_s))
    inside = np.isin(seen.index, model.seen.index)
    state.chain[~inside, WHITE] = 0.0
    at = everything.linearise(state)
    if at is None:
        return model, minimum
    back = plausible(everything, at) & ~inside
    if not back.any():
        return model, minimum
    kept = inside | back
    larger = model.over(seen.only(kept))
    return _without_blunders(larger, minimise(larger, larger.adopt(everything, state, np.flatnonzero(kept))))


def _nearest(times_s: Vector, wanted_s: Vector) -> NDArray[np.intp]:
    """For each wanted time the index of the nearest of some ascending times."""
    after = np.searchsorted(times_s, wanted_s).clip(1, max(len(times_s) - 1, 1))
    before = after - 1
    after = after.clip(0, len(times_s) - 1)
    return np.where(wanted_s - times_s[before] <= times_s[after] - wanted_s, before, after)
