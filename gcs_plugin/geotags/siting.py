"""An estimate on the earth: it has the uncertainty of the aircraft's own place too, which a distance has not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from mission.pose.buffer import PoseAt
from mission.records import Estimate, FlightSightings, Matrix, Vector

# GPS Standard Positioning Service performance standard (5th edition, 2020, table 3.8-3), global average: 95 % within
# 8 m horizontally (a circle, 2.448 sigmas of each axis) and 13 m vertically (1.960 sigmas).
_UNKNOWN_PLACE_M2: Final = np.diag([(8.0 / 2.448) ** 2, (8.0 / 2.448) ** 2, (13.0 / 1.960) ** 2])
_NOTE: Final = "the aircraft did not tell how well it knows its own place: that of a plain GPS receiver was assumed"


@dataclass(frozen=True, slots=True, eq=False)
class Sited:
    """An estimate as a place on the earth."""

    estimate: Estimate
    drone_enu_m: Vector | None
    """Where the aircraft was then, shape (3,)."""


def sited(estimate: Estimate, flight: FlightSightings, pose_at: PoseAt) -> Sited:
    """The estimate with the covariance of the aircraft's own place added, and that place.

    Where the aircraft told no pose for the estimate's own time, its accuracy is that of the nearest sighting's time,
    and its place that of the camera at the last sighting. An accuracy that is nowhere told is never taken for zero.
    """
    pose = pose_at(estimate.t_s)
    accuracy = None if pose is None else _possible(pose.position_covariance_m2)
    for sighting in reversed(flight.sightings):
        if accuracy is not None:
            break
        known = pose_at(sighting.t_s)
        accuracy = None if known is None else _possible(known.position_covariance_m2)
    if pose is not None:
        place: Vector | None = np.asarray(pose.position_enu_m)
    else:
        place = np.array(flight.sightings[-1].position_enu_m) if flight.sightings else None
    if estimate.covariance is None:
        return Sited(estimate, place)
    notes = estimate.notes if accuracy is not None else (*estimate.notes, _NOTE)
    covariance = estimate.covariance.copy()
    covariance[:3, :3] += _UNKNOWN_PLACE_M2 if accuracy is None else accuracy
    return Sited(replace(estimate, covariance=covariance, notes=notes), place)


def _possible(covariance: Matrix) -> Matrix | None:
    """The covariance, unless it is none: an accuracy of zero is one that nobody told."""
    return covariance if np.isfinite(covariance).all() and np.diag(covariance).min() > 0.0 else None
