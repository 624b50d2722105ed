"""How good the AR.Drone's pose is: dead reckoning drifts, its attitude wanders, its compass is a phone's.

No figure here is measured on an aircraft of ours. The velocity is what Bristeau, Callou, Vissiere & Petit ("The
Navigation and Control technology inside the AR.Drone micro UAV", IFAC 2011) make of the vertical camera and the
accelerometers, taken as 0.1 m/s that changes within half a second; angles are those of a consumer inertial sensor.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mission.records import Matrix, NoiseModel
from mission.vehicle.ardrone.reckoning import WALK_M_PER_SQRT_S, Reckoning

COMPASS_SIGMA_RAD = math.radians(5.0)
"""A magnetometer between four motors."""
DECLINATION_SIGMA_RAD = math.radians(8.0)
"""Where nobody told the declination: 95 % of the inhabited earth lie within 20 degrees."""
FLOW_SCALE_SIGMA = 0.05
"""Of the vertical camera's velocity, which hangs on the sonar's height and the floor's texture; an owner measured
4.3 to 4.6 m where 4 m had been reckoned (docs/ardrone.md)."""
UNPLACED_HEIGHT_M = 0.1
_GPS_HEIGHT_FACTOR = 1.5


def noise_model(reckoning: Reckoning, *, declination_known: bool) -> NoiseModel:
    """The pose fields of the noise model; the others keep their defaults.

    A heading without a compass is relative to the local frame, whose north is where it says. With one, north is meant,
    and the compass's error is in the answer; on a map also that of a declination that nobody told. A reckoned path is
    turned with the compass, and is as long as the flow says; a GPS path is neither.
    """
    base = NoiseModel()
    bias = COMPASS_SIGMA_RAD if reckoning.magnetic else base.heading_bias_sigma_rad
    turned = scale = 0.0
    if reckoning.origin is None:
        turned, bias = COMPASS_SIGMA_RAD if reckoning.magnetic else 0.0, base.heading_bias_sigma_rad
        scale = FLOW_SCALE_SIGMA
    elif reckoning.magnetic and not declination_known:
        bias = math.hypot(bias, DECLINATION_SIGMA_RAD)
    return replace(
        base,
        position_sigma_m=0.02,
        position_walk_m_per_sqrt_s=WALK_M_PER_SQRT_S,
        heading_bias_sigma_rad=bias,
        heading_sigma_rad=math.radians(0.5),
        heading_correlation_s=3.0,
        tilt_bias_sigma_rad=math.radians(1.0),
        tilt_sigma_rad=math.radians(0.4),
        tilt_correlation_s=2.0,
        position_scale_sigma=scale,
        world_heading_sigma_rad=turned,
    )


def position_covariance(reckoning: Reckoning) -> Matrix:
    """East-north-up (3, 3) m2: of the place on earth with GPS, of the drift since the start without."""
    variance = reckoning.variance_m2
    height = _GPS_HEIGHT_FACTOR**2 * variance if reckoning.origin is not None else UNPLACED_HEIGHT_M**2
    return np.diag([variance, variance, height])


def attitude_covariance(noise: NoiseModel) -> Matrix:
    """About forward, right and down, (3, 3) rad2: bias and wander of `noise_model` together."""
    tilt = noise.tilt_bias_sigma_rad**2 + noise.tilt_sigma_rad**2
    heading = noise.heading_bias_sigma_rad**2 + noise.heading_sigma_rad**2 + noise.world_heading_sigma_rad**2
    return np.diag([tilt, tilt, heading])
