"""The path's shape from the pictures, its place and size from the telemetry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mission.records import FlightSightings, Matrix, NoiseModel
from sitl.evaluation.accuracy.flights import Walk, out_and_back, simulate
from sitl.evaluation.ardrone.steadied import steadied

TRUE = simulate(out_and_back(), Walk(6.0), np.random.default_rng(0), noise=NoiseModel()).flight
STATED = replace(NoiseModel(), position_walk_m_per_sqrt_s=0.1, position_scale_sigma=0.05)


def places(flight: FlightSightings) -> Matrix:
    return np.array([one.position_enu_m for one in flight.sightings])


def reckoned(scale: float = 1.0, turned_rad: float = 0.0, sideways_m: float = 0.0) -> FlightSightings:
    """The true flight as an aircraft would reckon it: stretched, turned, and curved sideways."""
    turn = Rotation.from_euler("z", turned_rad)
    times = np.array([one.t_s for one in TRUE.sightings])
    way = scale * turn.apply(places(TRUE) - places(TRUE)[0])
    way[:, 1] += sideways_m * np.sin(math.pi * (times - times[0]) / (times[-1] - times[0]))
    told = []
    for one, place in zip(TRUE.sightings, way, strict=True):
        wxyz = (turn * Rotation.from_quat(one.world_from_camera_wxyz, scalar_first=True)).as_quat(scalar_first=True)
        told.append(replace(one, position_enu_m=tuple(place.tolist()), world_from_camera_wxyz=tuple(wxyz.tolist())))
    return replace(TRUE, sightings=tuple(told), noise=STATED)


def size(flight: FlightSightings) -> float:
    return float(np.ptp(places(flight) @ np.linalg.svd(places(flight) - places(flight).mean(axis=0))[2][0]))


def test_what_turns_and_stretches_all_stays() -> None:
    told = reckoned(scale=0.95, turned_rad=0.05)
    found = steadied(told, TRUE)
    assert places(found) - places(found)[0] == pytest.approx(places(told) - places(told)[0], abs=0.03)
    assert size(found) == pytest.approx(0.95 * size(TRUE), rel=0.005)


def test_a_path_that_curves_by_itself_is_straightened() -> None:
    told = reckoned(sideways_m=0.3)
    found = steadied(told, TRUE)
    shape = np.linalg.svd(places(found) - places(found).mean(axis=0))[1]
    true = np.linalg.svd(places(TRUE) - places(TRUE).mean(axis=0))[1]
    assert shape / shape[0] == pytest.approx(true / true[0], abs=1e-6)


def test_the_stated_noise_holds_what_the_telemetry_leaves_open() -> None:
    told = reckoned()
    noise = steadied(told, TRUE).noise
    assert noise.position_scale_sigma > 0.05
    assert noise.heading_sigma_rad < STATED.heading_sigma_rad
    assert noise.pixel_sigma_px == STATED.pixel_sigma_px
