"""What pictures of a background without any error of their own would make of a reckoned flight.

They tell the path's shape and how the camera turned, and leave open what `mission.bundle` takes from the telemetry:
where the path lies, how large it is, and where north and up are. So the path here is the true one, turned, moved and
stretched to agree best with what was reckoned: what is still wrong with it is what drift costs behind the steadying.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mission.bundle.gauge_alignment import SCALE, Similarity, most_likely_gauge
from mission.bundle.projection import Cameras
from mission.bundle.telemetry_prior import ErrorLevels, TelemetryPrior
from mission.records import FlightSightings, Matrix, NoiseModel, Sighting, Vector

ACHIEVED = NoiseModel(
    position_sigma_m=0.005,
    position_walk_m_per_sqrt_s=0.003,
    heading_bias_sigma_rad=0.0075,
    tilt_bias_sigma_rad=0.0006,
    heading_sigma_rad=0.0025,
    tilt_sigma_rad=0.0006,
)
"""The pose fields that the background ordinarily achieves on the rows (`sidestep accuracy --drone ardrone`)."""


def steadied(told: FlightSightings, true: FlightSightings) -> FlightSightings:
    """The sightings from the true path as the telemetry places it.

    Args:
        told: the sightings with the reckoned poses, and what the aircraft states of them.
        true: the same ones with the true poses.
    """
    t_s = np.array([one.t_s for one in told.sightings])
    reckoned, reckoned_m = _cameras(told)
    rotation, position_m = _cameras(true)
    still = np.zeros((len(t_s), 3))
    # Reckoning is the velocity summed up: the two reports say the same here.
    reports = TelemetryPrior(Cameras(t_s, reckoned, reckoned_m, still, still), reckoned_m - reckoned_m[0])
    levels = ErrorLevels.stated(told.noise)
    for last in (False, True):
        turned = rotation @ np.swapaxes(reckoned, 1, 2)
        found = most_likely_gauge(position_m, reckoned_m, turned, reports.prior(levels))
        arm = position_m - found.pivot_m
        position_m = found.pivot_m + found.offset_m + found.scale * arm @ found.turn.T
        rotation = found.turn @ rotation
        if not last:
            placed = Cameras(t_s, rotation, position_m, still, still)
            levels = reports.fitted(levels, placed, rotation @ np.swapaxes(reckoned, 1, 2))
    wxyz = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    return replace(
        told,
        sightings=tuple(_from(one, *pose) for one, *pose in zip(told.sightings, position_m, wxyz, strict=True)),
        noise=_noise(told.noise, found),
    )


def _cameras(flight: FlightSightings) -> tuple[NDArray[np.float64], Matrix]:
    """World_from_camera (n, 3, 3) and positions (n, 3)."""
    wxyz = np.array([one.world_from_camera_wxyz for one in flight.sightings])
    turned: NDArray[np.float64] = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
    return turned, np.array([one.position_enu_m for one in flight.sightings])


def _from(sighting: Sighting, position_m: Vector, wxyz: Vector) -> Sighting:
    east, north, up = position_m.tolist()
    w, x, y, z = wxyz.tolist()
    return replace(sighting, position_enu_m=(east, north, up), world_from_camera_wxyz=(w, x, y, z))


def _noise(stated: NoiseModel, found: Similarity) -> NoiseModel:
    open_ = np.diag(found.covariance)
    return replace(
        ACHIEVED,
        pixel_sigma_px=stated.pixel_sigma_px,
        pixel_correlation_s=stated.pixel_correlation_s,
        size_sigma=stated.size_sigma,
        size_correlation_s=stated.size_correlation_s,
        position_scale_sigma=math.hypot(stated.position_scale_sigma, math.sqrt(open_[SCALE])),
        world_heading_sigma_rad=math.hypot(stated.world_heading_sigma_rad, math.sqrt(open_[3])),
        world_tilt_sigma_rad=math.hypot(stated.world_tilt_sigma_rad, math.sqrt(0.5 * (open_[1] + open_[2]))),
    )
