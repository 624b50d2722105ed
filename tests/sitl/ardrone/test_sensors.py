"""What the aircraft believes of itself strays from the truth as its presets say, and the same way for the same seed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sitl.ardrone.aircraft import Aircraft
from sitl.ardrone.config import ArdroneConfig
from sitl.ardrone.sensors import PRESETS, SensorNoiseName, Sensors
from sitl.autopilot.airframe import Wind
from tests.sitl.ardrone.test_drone import Pilot

DT = 0.005


def aloft(noise: SensorNoiseName, seed: int, wind: Wind | None = None) -> Aircraft:
    aircraft = Aircraft(PRESETS[noise], wind or Wind(), 0.4, DT, np.random.default_rng(seed))
    aircraft.sensors.flat_trim()
    aircraft.place((0.0, 0.0, 1.5))
    return aircraft


def reckoned_and_true_way(noise: SensorNoiseName, seed: int) -> tuple[float, float]:
    """Length of a two-second flight to the left, by the reported velocity and in truth."""
    aircraft = aloft(noise, seed)
    reckoned = np.zeros(2)
    for _ in range(round(2.0 / DT)):
        aircraft.tilt(-0.2, 0.0, height_m=1.5, climb_m_s=0.0, yaw_rate_rad_s=0.0)
        reckoned += np.array(aircraft.flow) * DT
    return float(np.linalg.norm(reckoned)), float(np.linalg.norm(aircraft.position_enu_m[:2]))


def test_without_errors_the_reported_velocity_adds_up_to_the_way() -> None:
    reckoned, true = reckoned_and_true_way("none", 1)
    assert reckoned == pytest.approx(true, rel=0.01)


def test_reckoning_misses_the_way_by_a_few_percent() -> None:
    off = [reckoned / true - 1.0 for reckoned, true in (reckoned_and_true_way("good", seed) for seed in range(6))]
    assert 0.01 < np.std(off) < 0.08


def test_hover_drifts_but_slowly() -> None:
    aircraft = aloft("good", 3)
    for _ in range(round(10.0 / DT)):
        aircraft.hover(height_m=1.5)
    drift_m = float(np.linalg.norm(aircraft.position_enu_m[:2]))
    assert 0.01 < drift_m < 1.5
    assert aircraft.position_enu_m[2] == pytest.approx(1.5, abs=0.15)


def test_hover_holds_against_a_light_wind() -> None:
    aircraft = aloft("none", 1, Wind((2.0, 0.0, 0.0)))
    for _ in range(round(12.0 / DT)):
        aircraft.hover(height_m=1.5)
    assert np.linalg.norm(aircraft.velocity_enu_m_s) < 0.1


def test_level_flight_is_carried_away_by_the_wind_that_hovering_resists() -> None:
    aircraft = aloft("none", 1, Wind((2.0, 0.0, 0.0)))
    for _ in range(round(4.0 / DT)):
        aircraft.tilt(0.0, 0.0, height_m=1.5, climb_m_s=0.0, yaw_rate_rad_s=0.0)
    assert aircraft.velocity_enu_m_s[0] > 1.0


def test_flat_trim_makes_the_tilt_better() -> None:
    offsets = []
    for trimmed in (False, True):
        tilts = []
        for seed in range(40):
            sensors = Sensors(PRESETS["good"], DT, np.random.default_rng(seed))
            if trimmed:
                sensors.flat_trim()
            tilts.append(sensors.step().roll_rad)
        offsets.append(math.degrees(float(np.std(tilts))))
    assert offsets[0] == pytest.approx(1.0, rel=0.4)
    assert offsets[1] == pytest.approx(math.hypot(0.3, 0.15), rel=0.4)


def test_the_compass_is_off_by_the_same_angle_all_flight() -> None:
    errors = []
    for seed in range(60):
        sensors = Sensors(PRESETS["good"], DT, np.random.default_rng(seed))
        headings = [sensors.step().heading_rad for _ in range(400)]
        errors.append(math.degrees(float(np.mean(headings))))
        assert np.degrees(np.std(headings)) < 1.0
    assert np.std(errors) == pytest.approx(3.0, rel=0.35)


def test_the_same_seed_gives_the_same_flight() -> None:
    flights = []
    for seed in (4, 4, 5):
        pilot = Pilot(ArdroneConfig(seed=seed))
        pilot.send("REF", 0x11540200)
        pilot.wait(3.0)
        flights.append(pilot.drone.motion())
    assert flights[0] == flights[1]
    assert flights[0] != flights[2]
