"""The pseudo-linear bearing-angle Kalman filter.

Z. Ning, Y. Zhang, J. Li, Z. Chen & S. Zhao 2024, "A Bearing-Angle Approach for Unknown Target Motion Analysis Based on
Visual Measurements", International Journal of Robotics Research. The state is position p, velocity v and physical size
l of the target; the camera is at s, r = |p - s|. A picture gives the bearing g (a unit vector, noise mu across it) and
the angle a that the target subtends (relative noise w), for which, a being small, l = a r. Both are made linear in the
state by multiplying with what is unknown:

    bearing   P_g (p - s) = noise,          P_g = I - g g',   noise = r P_g mu
    angle     a (p - s) - l g = noise,                        noise = a r w g - l P_g mu

The component of the second across g is the first once more, times a, with the same mu. So with N the two unit vectors
across g these three rows carry all of it, and their noises are independent to first order:

    N (p - s) = 0            variance r^2 sigma_mu^2
    a g' (p - s) - l = 0     variance (a r)^2 sigma_w^2

r in the variances is taken from the prediction, as in the paper. The motion is constant velocity; l is constant. The
start is the common one (`filter_problem.py`), with l = a r: range and size are fully correlated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.errors import EstimateRefused
from mission.records import Estimate, FlightSightings, Matrix, Vector
from sitl.evaluation.comparators.filter_problem import START_RANGE_M, START_SIGMA_M, FilterProblem, filter_problem


@dataclass(frozen=True, slots=True)
class BearingAngle:
    """The filter, over all sightings of a flight."""

    name: str = "bearing-angle"

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`."""
        problem = filter_problem(flight)
        mean, covariance = _start(problem)
        for k in range(1, len(problem.t_s)):
            step = float(problem.t_s[k] - problem.t_s[k - 1])
            mean, covariance = _predicted(mean, covariance, step, flight.prior.acceleration_psd_m2_s3)
            mean, covariance = _updated(problem, k, mean, covariance)
        return problem.estimate(self.name, mean[:6], covariance[:6, :6])


def _start(problem: FilterProblem) -> tuple[Vector, Matrix]:
    """Mean (7,) and covariance (7, 7) after the first sighting."""
    angle = float(problem.angular_size[0])
    if not np.isfinite(angle):
        raise EstimateRefused("The first sighting has no height", "This filter needs apparent sizes.")
    mean, covariance = np.zeros(7), np.zeros((7, 7))
    mean[:6], covariance[:6, :6] = problem.start()
    mean[6] = angle * START_RANGE_M
    covariance[6, 6] = angle**2 * (START_SIGMA_M**2 + problem.size_variance * (START_RANGE_M**2 + START_SIGMA_M**2))
    covariance[:3, 6] = covariance[6, :3] = START_SIGMA_M**2 * angle * problem.direction[0]
    return mean, covariance


def _predicted(mean: Vector, covariance: Matrix, step_s: float, psd: float) -> tuple[Vector, Matrix]:
    move = np.eye(7)
    move[:3, 3:6] = step_s * np.eye(3)
    horizontal = np.diag((1.0, 1.0, 0.0))
    wander = np.zeros((7, 7))
    wander[:3, :3] = psd * step_s**3 / 3.0 * horizontal
    wander[:3, 3:6] = wander[3:6, :3] = psd * step_s**2 / 2.0 * horizontal
    wander[3:6, 3:6] = psd * step_s * horizontal
    return move @ mean, move @ covariance @ move.T + wander


def _updated(problem: FilterProblem, k: int, mean: Vector, covariance: Matrix) -> tuple[Vector, Matrix]:
    g, angle, camera = problem.direction[k], float(problem.angular_size[k]), problem.camera_m[k]
    distance = float(np.linalg.norm(mean[:3] - camera))
    rows = 3 if np.isfinite(angle) else 2
    h, noise = np.zeros((rows, 7)), np.zeros(rows)
    h[:2, :3] = np.linalg.svd(g[None, :])[2][1:]
    noise[:2] = distance**2 * problem.across_variance(distance)
    if rows == 3:
        h[2, :3], h[2, 6] = angle * g, -1.0
        noise[2] = angle**2 * (distance**2 * problem.size_variance + problem.place_variance_m2)
    surprise = h[:, :3] @ camera - h @ mean
    gain = np.linalg.solve(h @ covariance @ h.T + np.diag(noise), h @ covariance).T
    rest = np.eye(7) - gain @ h
    return mean + gain @ surprise, rest @ covariance @ rest.T + gain @ np.diag(noise) @ gain.T
