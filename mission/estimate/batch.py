"""The default estimator: the posterior mean over every way in which people move and autopilots err.

Wrong sightings are taken out first, at the most probable state of a target that may turn at any moment
(`constant_velocity.most_probable` with a generous white-noise acceleration). What is left is averaged over range,
motion, pose and noise (`averaged.py`). Same input, same answer, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from threadpoolctl import ThreadpoolController

from mission.errors import EstimateRefused
from mission.estimate.arrow import NotPositiveDefinite
from mission.estimate.averaged import Averaged, averaged
from mission.estimate.constant_velocity import most_probable
from mission.estimate.marginal import MarginalModel
from mission.estimate.motion_hypotheses import MotionKind
from mission.estimate.noise_fit import rescaled
from mission.estimate.observations import Observations, observe, tamed_noise, tamed_prior
from mission.estimate.posterior import HOPELESS, POOR
from mission.estimate.size_prior import ADULT, SizePrior, size_priors
from mission.estimate.starts import meets_behind
from mission.estimate.target_covariance import TargetMoments, in_open_world
from mission.records import Estimate, FirstPosition, FlightSightings, NoiseModel, TargetPrior, Vector

_BLAS: Final = ThreadpoolController()
_GENEROUS_PSD: Final = 0.3
"""White-noise acceleration under which a sighting that does not fit is somebody else, m2/s3."""
_NOISIER: Final = (1.5, 3.0, 6.0)
"""Factors of the stated noise under which sightings are judged, the next where too few are right under one."""
_MOST_RIGHT: Final = 0.8
_NOTHING_ELSE: Final = 0.95
"""Probability of wandering at which it may stand for a camera that is turned round."""
_POSTURE: Final = 0.2
"""Probability of a change of posture from which on the apparent heights are not used."""
_MISSTATED: Final = 1.6
"""A factor of the stated noise beyond this, or one over it, is told."""
_CONTRADICTED: Final = 0.1
"""A stated height whose probability falls below this is contradicted by the picture."""
_NAMES: Final[dict[MotionKind, str]] = {
    "steady": "a steady walk or standing",
    "wandering": "wandering",
    "turning": "a turn, stop or start",
    "weaving": "weaving",
    "posture": "a change of posture",
}


@dataclass(frozen=True, slots=True)
class Batch:
    """Posterior mean and covariance over everything that is unknown (see the module)."""

    name: str = "batch"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`."""
        return estimate_together((flight,))


def estimate_together(flights: Sequence[FlightSightings]) -> Estimate:
    """One estimate from one flight's sightings, or from several passes that continue each other.

    Args:
        flights: passes in time order, in the same local frame and on the same clock; noise and prior are the last
            one's, and the first position holds for the last one's first sighting.

    Raises:
        EstimateRefused: the sightings do not determine a position; it says why and what would help.
    """
    last = flights[-1]
    flight = replace(
        last,
        sightings=tuple(s for f in flights for s in f.sightings),
        noise=tamed_noise(last.noise),
        prior=tamed_prior(last.prior),
    )
    seen = observe(flight)
    if len(seen.t_s) < 3:
        raise EstimateRefused(
            f"{len(seen.t_s)} usable sightings are too few", "Keep the target in view for three sightings or more."
        )
    try:
        # Small matrices: more threads than one would only wait for each other.
        with (
            _BLAS.limit(limits=1, user_api="blas"),
            np.errstate(all="ignore"),
        ):  # what overflows ends as a singular matrix, and that is refused
            kept, chi2, freedom = _plausible(flight, seen)
            asked_s = last.sightings[0].t_s - seen.start_s
            model = MarginalModel(kept, flight.noise, flight.prior, asked_s)
            own, *with_class = averaged(model, _heights(flight.prior, sized=bool(kept.size_scale.any())))
            upright = own.motions.get("posture", 0.0) < _POSTURE
            if not upright:  # then the heights tell neither how far away the target is nor that it comes or goes
                unsized = kept.only(np.ones(len(kept.t_s), dtype=bool), np.zeros(len(kept.t_s), dtype=bool))
                model = MarginalModel(unsized, flight.noise, flight.prior, asked_s)
                own, *with_class = averaged(model, [(SizePrior.unknown(),)])
    except (NotPositiveDefinite, np.linalg.LinAlgError, FloatingPointError):
        raise EstimateRefused(
            "The sightings do not determine a position", "Fly further sideways, and keep the target in view."
        ) from None
    found = with_class[0] if with_class and flight.prior.class_height == "use" else own
    camera = model.camera_m[model.first]
    relative = _relative_depth_sigma(found.moments, camera)
    if not np.isfinite(found.moments.covariance).all() or not np.isfinite(found.moments.mean).all():
        raise EstimateRefused(
            "The sightings do not determine a position", "Fly further sideways, and keep the target in view."
        )
    if found.motions.get("wandering", 0.0) > _NOTHING_ELSE and meets_behind(kept, flight.noise, flight.prior):
        raise EstimateRefused(
            "The lines of sight meet behind the camera",
            "Check the camera's mounting, and that the quaternion is world_from_camera with w first.",
        )
    if not found.bounded:
        raise _undetermined(
            f"anything from {found.nearest_m:.1f} to {found.farthest_m:.1f} m and beyond explains the sightings"
        )
    if not relative < HOPELESS:
        raise _undetermined(f"its 1-sigma is {100.0 * relative:.0f} % of it")
    moments = in_open_world(found.moments, camera, flight.noise)
    end = flight.sightings[-1].t_s
    beyond = end - seen.start_s - float(kept.t_s[-1])  # not zero where the last sightings were rejected
    to_end = np.eye(6)
    to_end[:3, 3:] = beyond * np.eye(3)
    velocity = moments.mean[6:]
    return Estimate(
        id=last.id,
        method="batch",
        model=max(found.motions, key=lambda kind: found.motions[kind]),
        t_s=end,
        position_enu_m=seen.reference_m + moments.mean[3:6] + beyond * velocity,
        velocity_enu_m_s=velocity,
        covariance=to_end @ moments.last_covariance @ to_end.T,
        first=FirstPosition(last.sightings[0].t_s, seen.reference_m + moments.mean[:3], moments.first_covariance),
        depth_m=float(np.hypot(*(moments.mean[:2] - camera[:2]))),
        sightings=len(flight.sightings),
        rejected=len(flight.sightings) - len(kept.t_s),
        chi2=chi2,
        dof=freedom,
        notes=(
            *_notes(found, relative, flight.prior),
            *_class_note(own, with_class, flight.prior),
            *(() if upright else ("the apparent height changes as by crouching or getting up: it is not used",)),
        ),
    )


def _heights(prior: TargetPrior, *, sized: bool) -> list[tuple[SizePrior, ...]]:
    """What is believed of the height: what is stated, and beside it an adult's where the class may count."""
    stated = size_priors(prior)
    return [stated, ADULT] if sized and prior.height_m is None and prior.class_height != "never" else [stated]


def _class_note(own: Averaged, with_class: Sequence[Averaged], prior: TargetPrior) -> tuple[str, ...]:
    """Whether an adult's height was used, and what the distance would be otherwise."""
    if not with_class:
        return ()
    used = prior.class_height == "use"
    other = own if used else with_class[0]
    place, sigma = other.moments.mean[:3], other.moments.first_covariance
    far = float(np.linalg.norm(place))
    spread = float(np.sqrt(place @ sigma @ place)) / max(far, 1e-9)
    adult = 100.0 * with_class[0].heights.get("class", 0.0)
    without = f"an adult's height was used ({adult:.0f} % likely); without it"
    return (f"{without if used else 'with an adult height'} the range would be {far:.2f} m +- {spread:.2f} m",)


def _plausible(flight: FlightSightings, seen: Observations) -> tuple[Observations, float, int]:
    """The observations without somebody else's, chi-square of what is left, and its degrees of freedom.

    Raises:
        EstimateRefused: the sightings contradict each other, the camera did not move, or all lines of sight point back.
        NotPositiveDefinite: something is not observable.
    """
    prior = replace(
        flight.prior, acceleration_psd_m2_s3=max(_GENEROUS_PSD, flight.prior.acceleration_psd_m2_s3), height_m=None
    )
    for factor in _NOISIER:
        # A header may understate its noise: many sightings that do not fit are then not somebody else.
        louder = rescaled(replace(flight, prior=prior), _louder(flight.noise, factor))
        try:
            model, minimum = most_probable(louder, observe(louder))
        except EstimateRefused:
            if factor == _NOISIER[-1] or meets_behind(seen, flight.noise, flight.prior):
                raise
            continue
        if model.count >= _MOST_RIGHT * len(seen.t_s):
            break
    right = np.isin(seen.index, model.seen.index)
    sized = np.ones(len(seen.t_s), dtype=bool)
    sized[right] = model.has_size
    given = flight.prior.height_m is not None and model.any_size
    return seen.only(right, sized), minimum.at.cost, model.freedom + given


def _louder(noise: NoiseModel, factor: float) -> NoiseModel:
    """All that errs within a flight times a factor."""
    return replace(
        noise,
        pixel_sigma_px=factor * noise.pixel_sigma_px,
        size_sigma=factor * noise.size_sigma,
        heading_sigma_rad=factor * noise.heading_sigma_rad,
        tilt_sigma_rad=factor * noise.tilt_sigma_rad,
    )


def _relative_depth_sigma(moments: TargetMoments, camera_m: Vector) -> float:
    line = (moments.mean[:3] - camera_m)[:2]
    depth2 = float(line @ line)
    return float(np.sqrt(line @ moments.first_covariance[:2, :2] @ line)) / max(depth2, 1e-12)


def _notes(found: Averaged, relative: float, prior: TargetPrior) -> tuple[str, ...]:
    notes = []
    if relative > POOR:
        notes.append(f"poor geometry: the depth's 1-sigma is {100.0 * relative:.0f} % of it; fly out and back")
    ranked = sorted(found.motions.items(), key=lambda item: -item[1])
    shares = ", ".join(f"{_NAMES[kind]} {100.0 * share:.0f} %" for kind, share in ranked if share >= 0.005)
    notes.append(f"the sightings support {shares}")
    channels = (("bearings", found.factors.across), ("elevations", found.factors.up), ("heights", found.factors.size))
    for name, factor in channels:
        if factor > _MISSTATED or factor < 1.0 / _MISSTATED:
            notes.append(f"the {name} scatter {factor:.1f} times as much as stated, which is taken into account")
    if prior.height_m is not None and found.heights.get("stated", 0.0) < _CONTRADICTED:
        notes.append(f"the stated height is contradicted: the picture says {np.exp(found.log_height[0]):.2f} m")
    return tuple(notes)


def _undetermined(how: str) -> EstimateRefused:
    return EstimateRefused(
        f"The distance is not determined: {how}",
        "Fly out and back, further sideways, with the camera kept on the target.",
    )
