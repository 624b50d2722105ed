"""How good the pose is that an autopilot reports, from what it says about itself.

Within a pattern only the changes of the error matter. Measured against the truth of two real flights (out and back,
15 s): an ArduPilot with a GPS that reports 0.3 m drifted by 0.05 m over 2 s, a PX4 with one that reports 0.9 m by
0.18 m; so the drift is taken as proportional to the reported accuracy, and where none is reported the worse one stands.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mission.records import Matrix, NoiseModel
from mission.vehicle.limits import COMPASS_SIGMA_RAD
from mission.vehicle.state.vehicle_state import VehicleState

_WALK_PER_ACCURACY = 0.1
"""Random walk of the position error on each axis, m per square root of a second, for each metre of GPS accuracy."""
_UNKNOWN_GPS_M = 0.9
_UNKNOWN_POSITION_M = 2.0
_GOOD_GPS_M = 0.3
_VERTICAL_FACTOR = 1.5
_BAD_HEADING_CORRELATION_S = 4.0
"""The PX4 flight's heading error, 2.0 deg, changed by 1.8 deg over 2 s: a correlation of 0.6."""


def noise_model(vehicle: VehicleState, compass_sigma_rad: float = COMPASS_SIGMA_RAD) -> NoiseModel:
    """The pose fields of the noise model; the others keep their defaults.

    Heading and tilt wander with the same estimator: from their defaults they grow with the GPS accuracy up to the PX4
    flight's 2 degrees of heading and 1.1 degrees of roll.

    Args:
        vehicle: what the autopilot says of itself.
        compass_sigma_rad: standard deviation of the heading's constant error.
    """
    gps_m = vehicle.gps_accuracy_m or _UNKNOWN_GPS_M
    walk = min(0.3, max(0.02, _WALK_PER_ACCURACY * gps_m))
    worse = min(1.0, max(0.0, (gps_m - _GOOD_GPS_M) / (_UNKNOWN_GPS_M - _GOOD_GPS_M)))
    base = NoiseModel()
    return replace(
        base,
        position_walk_m_per_sqrt_s=walk,
        heading_correlation_s=base.heading_correlation_s
        + worse * (_BAD_HEADING_CORRELATION_S - base.heading_correlation_s),
        heading_bias_sigma_rad=compass_sigma_rad,
        heading_sigma_rad=base.heading_sigma_rad + worse * (math.radians(2.0) - base.heading_sigma_rad),
        tilt_sigma_rad=base.tilt_sigma_rad + worse * (math.radians(1.1) - base.tilt_sigma_rad),
        tilt_bias_sigma_rad=base.tilt_bias_sigma_rad + worse * (math.radians(1.1) - base.tilt_bias_sigma_rad),
    )


def position_covariance(vehicle: VehicleState) -> Matrix:
    """Absolute, east-north-up (3, 3) m2: the larger of the estimator's and the GPS's own accuracy."""
    told = [a for a in (vehicle.estimator_accuracy_m, vehicle.gps_accuracy_m) if a]
    horizontal = max(told) if told else _UNKNOWN_POSITION_M
    return np.diag([horizontal**2 / 2.0, horizontal**2 / 2.0, (_VERTICAL_FACTOR * horizontal) ** 2])


def attitude_covariance(vehicle: VehicleState, compass_sigma_rad: float = COMPASS_SIGMA_RAD) -> Matrix:
    """About forward, right and down, (3, 3) rad2: bias and wander of `noise_model` together."""
    noise = noise_model(vehicle, compass_sigma_rad)
    tilt = noise.tilt_bias_sigma_rad**2 + noise.tilt_sigma_rad**2
    return np.diag([tilt, tilt, noise.heading_bias_sigma_rad**2 + noise.heading_sigma_rad**2])
