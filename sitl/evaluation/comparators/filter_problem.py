"""What the recursive filters are given: lines of sight in the world, white noise that stands for the real one, a start.

The comparators are filters for white noise and a known camera path, and the sightings have neither. So that they are
not beaten by a wrong setting, every variance is the one that a careful user would give them: correlated errors are
inflated by what their correlation takes away from a mean, (1 + rho) / (1 - rho), and errors of the camera's place count
as errors across the line of sight at the range in hand. The biases that all sightings share are left out: they turn the
whole answer about the drone and do not touch the depth.

The start is the prior of the batch (speed) and one more thing that a filter cannot do without: a range. It lies along
the first line of sight between 2 and 30 m, uniform in its logarithm as befits an unknown scale, and goes in by its mean
and variance (the moments of a range interval: Ristic, Arulampalam & Gordon 2004, "Beyond the Kalman Filter", ch. 6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mission.errors import EstimateRefused
from mission.estimate.observations import observe
from mission.records import Estimate, FirstPosition, FlightSightings, Matrix, Vector

NEAREST_M, FARTHEST_M = 2.0, 30.0
"""Where a filter expects the target: it must start somewhere."""
_SPAN = math.log(FARTHEST_M / NEAREST_M)
START_RANGE_M = (FARTHEST_M - NEAREST_M) / _SPAN
START_SIGMA_M = math.sqrt((FARTHEST_M**2 - NEAREST_M**2) / (2.0 * _SPAN) - START_RANGE_M**2)


@dataclass(frozen=True, slots=True, eq=False)
class FilterProblem:
    """Lines of sight in ENU with variances for white noise; positions are relative to the first reported one."""

    flight: FlightSightings
    t_s: Vector
    """(n,), since the first sighting."""
    camera_m: Matrix
    """(n, 3)."""
    reference_m: Vector
    """(3,), ENU."""
    direction: Matrix
    """(n, 3), unit vectors to the target."""
    angular_size: Vector
    """(n,), height over range (radians, for a small angle); NaN where the sighting has no height."""
    angle_variance: float
    """Of each direction, per axis, rad2."""
    size_variance: float
    """Of the log of the angular size."""
    place_variance_m2: float
    """Of each camera place, per axis."""

    def across_variance(self, range_m: float) -> float:
        """Variance of a direction (rad2) with the camera place's share, for a target at `range_m`."""
        return self.angle_variance + self.place_variance_m2 / max(range_m, 0.1) ** 2

    def start(self) -> tuple[Vector, Matrix]:
        """Mean (6,) and covariance (6, 6) of position and velocity after the first sighting."""
        g, prior = self.direction[0], self.flight.prior
        along = np.outer(g, g)
        covariance = np.zeros((6, 6))
        across = START_RANGE_M**2 * self.angle_variance + self.place_variance_m2
        covariance[:3, :3] = START_SIGMA_M**2 * along + across * (np.eye(3) - along)
        speed = np.array((prior.speed_sigma_m_s, prior.speed_sigma_m_s, prior.vertical_speed_sigma_m_s))
        covariance[3:, 3:] = np.diag(np.square(speed))
        return np.concatenate((self.camera_m[0] + START_RANGE_M * g, np.zeros(3))), covariance

    def estimate(self, method: str, mean: Vector, covariance: Matrix) -> Estimate:
        """The answer of a filter that ended with position and velocity `mean` (6,), `covariance` (6, 6).

        The first position is the last one taken back with the velocity, which for a constant velocity is what a
        smoother would say.

        Raises:
            EstimateRefused: the filter diverged.
        """
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise EstimateRefused(f"The {method} filter diverged", "Use --method batch.")
        back = np.eye(6)
        back[:3, 3:] = -self.t_s[-1] * np.eye(3)
        first = (back @ mean)[:3]
        turned = np.array(covariance)
        turned[:3, :3] += self._turn(mean[:3] - self.camera_m[-1])
        back_covariance = (back @ covariance @ back.T)[:3, :3] + self._turn(first - self.camera_m[0])
        sightings = self.flight.sightings
        return Estimate(
            id=self.flight.id,
            method=method,
            model="constant-velocity",
            t_s=sightings[-1].t_s,
            position_enu_m=self.reference_m + mean[:3],
            velocity_enu_m_s=mean[3:],
            covariance=turned,
            first=FirstPosition(sightings[0].t_s, self.reference_m + first, back_covariance),
            depth_m=float(np.hypot(*(first - self.camera_m[0])[:2])),
            sightings=len(sightings),
            rejected=0,
            chi2=None,
            dof=None,
        )

    def _turn(self, line_m: Vector) -> Matrix:
        """Covariance (3, 3) of the end of a line (3,) from the camera by heading and tilt errors, first order."""
        noise = self.flight.noise
        up = np.array((0.0, 0.0, 1.0))
        by_heading = np.cross(up, line_m)
        by_tilt = np.cross(by_heading / max(float(np.linalg.norm(by_heading)), 1e-9), line_m)
        heading = noise.heading_bias_sigma_rad**2 + noise.heading_sigma_rad**2
        tilt = noise.tilt_bias_sigma_rad**2 + noise.tilt_sigma_rad**2
        covariance: Matrix = heading * np.outer(by_heading, by_heading) + tilt * np.outer(by_tilt, by_tilt)
        return covariance


def filter_problem(flight: FlightSightings) -> FilterProblem:
    """The flight as a filter for white noise wants it.

    Raises:
        EstimateRefused: there are fewer than three usable sightings.
    """
    seen, noise, camera = observe(flight), flight.noise, flight.camera
    count = len(seen.t_s)
    if count < 3:
        raise EstimateRefused(f"{count} usable sightings are too few", "Keep the target in view.")
    rays = np.column_stack((seen.measured[:, :2], np.ones(count)))
    length = np.linalg.norm(rays, axis=1)
    world = np.matmul(rays[:, None, :], seen.camera_from_world)[:, 0]
    span = float(seen.t_s[-1])
    step = span / (count - 1)
    pixel = (noise.pixel_sigma_px / math.sqrt(camera.fx * camera.fy)) ** 2
    turn = 0.5 * (noise.heading_sigma_rad**2 + noise.tilt_sigma_rad**2)
    # The height is f H / Z with Z along the camera's axis; over the range it is Z / range = 1 / |ray| of that.
    sized = np.where(seen.size_scale > 0.0, np.exp(seen.measured[:, 2]) / length, np.nan)
    return FilterProblem(
        flight,
        seen.t_s,
        seen.camera_m,
        seen.reference_m,
        world / length[:, None],
        sized,
        max(pixel * inflation(step, noise.pixel_correlation_s, count) + turn, 1e-12),
        max(noise.size_sigma**2 * inflation(step, noise.size_correlation_s, count), 1e-12),
        noise.position_sigma_m**2 + noise.position_walk_m_per_sqrt_s**2 * span / 4.0,
    )


def inflation(step_s: float, correlation_s: float, count: int) -> float:
    """How many times the variance a white error must have to leave a mean of `count` values as uncertain."""
    if correlation_s <= 0.0 or step_s <= 0.0:
        return 1.0
    rho = math.exp(-step_s / correlation_s)
    return min((1.0 + rho) / (1.0 - rho), float(count))
