"""Extended and unscented Kalman filters of Stone Soup with bearing and elevation, as its tutorials build them.

Stone Soup (Dstl, MIT licence, PyPI `stonesoup`) is wanted by this comparison alone, so it is imported when a filter is
first used, and its absence is an answer of its own. State: x, vx, y, vy, z, vz in ENU; measurement: elevation and
bearing (`CartesianToElevationBearing`) from the reported camera place; motion: constant velocity with the prior's
white-noise acceleration on the horizontal axes. The start and the variances are those of `filter_problem.py`.
"""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Literal

import numpy as np

from mission.errors import EstimateRefused
from mission.records import Estimate, FlightSightings, Matrix, Vector
from sitl.evaluation.comparators.filter_problem import FilterProblem, filter_problem

NOT_INSTALLED = (
    "Stone Soup is not installed, so its EKF and UKF are left out; `pip install 'sidestep[accuracy]'` brings them"
)
_EPOCH = datetime(2000, 1, 1)  # Stone Soup wants dates; only their differences count.
_ORDER = np.array((0, 3, 1, 4, 2, 5))
"""Place of Stone Soup's x, vx, y, vy, z, vz in position and velocity."""


def installed() -> bool:
    """Whether Stone Soup can be imported."""
    return importlib.util.find_spec("stonesoup") is not None


@dataclass(frozen=True, slots=True)
class StoneSoup:
    """One of its Kalman filters, over all sightings of a flight."""

    kind: Literal["EKF", "UKF"]

    @property
    def name(self) -> str:
        """What the tables call it."""
        return self.kind

    def estimate(self, flight: FlightSightings) -> Estimate:
        """See `Estimator.estimate`.

        Raises:
            EstimateRefused: too few sightings, Stone Soup is not installed, or the filter broke down.
        """
        if not installed():
            raise EstimateRefused("Stone Soup is not installed", "pip install 'sidestep[accuracy]'")
        problem = filter_problem(flight)
        try:
            mean, covariance = _filtered(problem, self.kind)
        except np.linalg.LinAlgError:
            raise EstimateRefused(f"The {self.kind} broke down: its covariance is not positive definite") from None
        return problem.estimate(self.name, mean, covariance)


def _filtered(problem: FilterProblem, kind: Literal["EKF", "UKF"]) -> tuple[Vector, Matrix]:
    """Position and velocity (6,) at the last sighting, and their covariance (6, 6)."""
    # Without stubs or py.typed, modules come as `Any`; importlib says so without asking the type checker to look away.
    linear: Any = importlib.import_module("stonesoup.models.transition.linear")
    nonlinear: Any = importlib.import_module("stonesoup.models.measurement.nonlinear")
    predictors: Any = importlib.import_module("stonesoup.predictor.kalman")
    updaters: Any = importlib.import_module("stonesoup.updater.kalman")
    angles: Any = importlib.import_module("stonesoup.types.angle")
    arrays: Any = importlib.import_module("stonesoup.types.array")
    detections: Any = importlib.import_module("stonesoup.types.detection")
    hypotheses: Any = importlib.import_module("stonesoup.types.hypothesis")
    states: Any = importlib.import_module("stonesoup.types.state")

    psd = problem.flight.prior.acceleration_psd_m2_s3
    axes = [linear.ConstantVelocity(psd), linear.ConstantVelocity(psd), linear.ConstantVelocity(0.0)]
    transition = linear.CombinedLinearGaussianTransitionModel(axes)
    if kind == "EKF":
        predictor, updater = predictors.ExtendedKalmanPredictor(transition), updaters.ExtendedKalmanUpdater()
    else:
        # Sigma points at sqrt(n) sigma: no weight is negative, unlike with the default of kappa = 3 - n for n = 6.
        spread = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0}
        predictor = predictors.UnscentedKalmanPredictor(transition, **spread)
        updater = updaters.UnscentedKalmanUpdater(**spread)
    mean, covariance = problem.start()
    state: Any = states.GaussianState(
        arrays.StateVector(mean[_ORDER]), arrays.CovarianceMatrix(covariance[np.ix_(_ORDER, _ORDER)]), _EPOCH
    )
    for k in range(1, len(problem.t_s)):
        at = _EPOCH + timedelta(seconds=float(problem.t_s[k]))
        predicted = predictor.predict(state, timestamp=at)
        ahead = np.asarray(predicted.state_vector, dtype=float)[[0, 2, 4], 0] - problem.camera_m[k]
        g = problem.direction[k]
        across = problem.across_variance(float(np.linalg.norm(ahead)))
        model = nonlinear.CartesianToElevationBearing(
            ndim_state=6,
            mapping=(0, 2, 4),
            # A degree of bearing is shorter than one of elevation where the line of sight is steep.
            noise_covar=np.diag((across, across / max(g[0] ** 2 + g[1] ** 2, 1e-6))),
            translation_offset=arrays.StateVector(problem.camera_m[k]),
        )
        measured = arrays.StateVector(
            (angles.Elevation(float(np.arcsin(g[2]))), angles.Bearing(float(np.arctan2(g[1], g[0]))))
        )
        detection = detections.Detection(measured, timestamp=at, measurement_model=model)
        state = updater.update(hypotheses.SingleHypothesis(predicted, detection))
    back = np.argsort(_ORDER)
    last = np.asarray(state.state_vector, dtype=float)[:, 0]
    return last[back], np.asarray(state.covar, dtype=float)[np.ix_(back, back)]
