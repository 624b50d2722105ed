"""What a flight's sightings would have been with perfect dead reckoning: what drift without GPS costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from mission.errors import AnswerError
from mission.records import FlightSightings, NoiseModel, Sighting, Vector
from sitl.camera.airframe import CameraOnAirframe
from sitl.simulation.processes import Simulation


def true_camera(running: Simulation, t_s: float) -> Vector:
    """Where the lens truly was, ENU, (3,).

    Raises:
        AnswerError: the truth does not reach there.
    """
    truth = running.ring.at(t_s)
    if truth is None:
        raise AnswerError(f"the truth of {t_s:.1f} s is not known", "The flight and the simulator disagree about time.")
    return CameraOnAirframe(running.scenario, running.ring).mounted(truth).position_enu_m


def drift_m(running: Simulation, flight: FlightSightings) -> float:
    """How far the reckoned way of the camera was from the true one between the first and the last sighting."""
    first, last = flight.sightings[0], flight.sightings[-1]
    true = true_camera(running, last.t_s) - true_camera(running, first.t_s)
    told = np.asarray(last.position_enu_m) - np.asarray(first.position_enu_m)
    return float(np.linalg.norm((told - true)[:2]))


def with_true_poses(running: Simulation, flight: FlightSightings) -> FlightSightings:
    """The same pixels, seen from where the camera truly was and as it was truly turned.

    The noise model says so too, as far as reckoning is concerned: no drift, no wrong scale, no compass.

    Raises:
        AnswerError: the truth does not reach there.
    """
    camera = CameraOnAirframe(running.scenario, running.ring)

    def seen_from(sighting: Sighting) -> Sighting:
        east, north, up = true_camera(running, sighting.t_s).tolist()
        turned = Rotation.from_matrix(camera.pose_at(sighting.t_s).world_from_camera)
        w, x, y, z = turned.as_quat(scalar_first=True).tolist()
        return replace(sighting, position_enu_m=(east, north, up), world_from_camera_wxyz=(w, x, y, z))

    return replace(flight, sightings=tuple(seen_from(one) for one in flight.sightings), noise=of_truth(flight.noise))


def of_truth(noise: NoiseModel) -> NoiseModel:
    """The noise of sightings whose poses are the truth: what remains is the tracker's and the lens's."""
    small = NoiseModel()
    return replace(
        noise,
        position_sigma_m=0.005,
        position_walk_m_per_sqrt_s=0.005,
        position_scale_sigma=0.0,
        world_heading_sigma_rad=0.0,
        world_tilt_sigma_rad=0.0,
        heading_bias_sigma_rad=0.001,
        tilt_bias_sigma_rad=0.001,
        heading_sigma_rad=min(noise.heading_sigma_rad, small.heading_sigma_rad),
        tilt_sigma_rad=min(noise.tilt_sigma_rad, small.tilt_sigma_rad),
    )
