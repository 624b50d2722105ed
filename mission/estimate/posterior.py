"""From the most probable state to the estimate: positions and covariances at the first and at the last sighting."""

from __future__ import annotations

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.gauss_newton import Minimum
from mission.estimate.joint_model import JointModel
from mission.estimate.motion import compare_motions
from mission.estimate.range_profile import profile_range
from mission.estimate.target_covariance import TargetMoments, first_camera, in_open_world, target_moments
from mission.records import Estimate, FirstPosition, FlightSightings, Vector

LOPSIDED = 0.05
"""A depth whose relative sigma is above this is not normally distributed: its whole profile is looked at."""
POOR = 0.05
"""A depth whose relative sigma is above this is called poor."""
HOPELESS = 0.5
"""Above this there is no answer: the sightings say next to nothing about the distance."""


def to_estimate(flight: FlightSightings, model: JointModel, minimum: Minimum) -> Estimate:
    """The estimate at the last sighting, and the position at the first.

    Raises:
        EstimateRefused: the distance is not determined.
        NotPositiveDefinite: something is not observable.
    """
    moments = target_moments(model, minimum.at.state, minimum.factored)
    camera = first_camera(model, minimum.at.state)
    relative = _relative_depth_sigma(moments, camera)
    if relative > LOPSIDED:
        profile = profile_range(model, minimum)
        if not profile.bounded:
            raise _undetermined(f"anything from {profile.nearest_m:.1f} m outwards explains the sightings")
        moments = profile.moments
        relative = _relative_depth_sigma(moments, camera)
    if not relative < HOPELESS:
        raise _undetermined(f"its 1-sigma is {100.0 * relative:.0f} % of it")
    moments = in_open_world(moments, camera, model.noise)
    notes = []
    if relative > POOR:
        notes.append(f"poor geometry: the depth's 1-sigma is {100.0 * relative:.0f} % of it; fly out and back")
    motions = compare_motions(model, minimum)
    if motions is not None:
        notes.append(str(motions))
    if not minimum.converged:
        notes.append("the minimisation did not converge")
    seen, last = model.seen, flight.sightings[-1].t_s
    beyond = last - seen.start_s - float(seen.t_s[-1])  # not zero where the last sightings were rejected
    to_last = np.eye(6)
    to_last[:3, 3:] = beyond * np.eye(3)
    velocity = moments.mean[6:]
    return Estimate(
        id=flight.id,
        method="constant-velocity",
        model="manoeuvring" if model.manoeuvres else "constant-velocity",
        t_s=last,
        position_enu_m=seen.reference_m + moments.mean[3:6] + beyond * velocity,
        velocity_enu_m_s=velocity,
        covariance=to_last @ moments.last_covariance @ to_last.T,
        first=FirstPosition(flight.sightings[0].t_s, seen.reference_m + moments.mean[:3], moments.first_covariance),
        depth_m=float(np.hypot(*(moments.mean[:2] - camera[:2]))),
        sightings=len(flight.sightings),
        rejected=len(flight.sightings) - model.count,
        chi2=minimum.at.cost,
        dof=model.freedom,
        notes=tuple(notes),
    )


def _relative_depth_sigma(moments: TargetMoments, camera_m: Vector) -> float:
    line = (moments.mean[:3] - camera_m)[:2]
    depth2 = float(line @ line)
    return float(np.sqrt(line @ moments.first_covariance[:2, :2] @ line)) / max(depth2, 1e-12)


def _undetermined(how: str) -> EstimateRefused:
    return EstimateRefused(
        f"The distance is not determined: {how}",
        "Fly out and back, further sideways, with the camera kept on the target.",
    )
