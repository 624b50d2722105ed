"""The two noise presets against the two recorded flights they were fitted to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sitl.autopilot.config import AutopilotConfig, FlavourName
from sitl.autopilot.estimate_errors import PRESETS, EstimateErrors, NoiseName, NoisePreset, preset_of
from sitl.autopilot.wide_family import MultipathStep
from tests.support.autopilot_bench import Bench
from tests.support.recorded_errors import Errors, drift, recorded_errors

SEEDS = range(10)


def recorded(noise: NoiseName) -> Errors:
    return recorded_errors("arducopter", 8.2, 26.0) if noise == "good" else recorded_errors("px4", 10.0, 30.0)


def simulated(noise: NoiseName, seed: int, seconds: float = 18.0) -> Errors:
    dt = 0.02
    errors = EstimateErrors(preset_of(noise, seed), dt, np.random.default_rng(seed))
    rows = [errors.step() for _ in range(round(seconds / dt))]
    return Errors(
        np.linspace(0.0, seconds - dt, len(rows)),
        np.array([e.position for e in rows]),
        np.array([e.velocity for e in rows]),
        np.array([(e.roll, e.pitch, e.heading) for e in rows]),
    )


def mean_drift(noise: NoiseName, what: str, columns: slice, lag_s: float) -> float:
    runs = [simulated(noise, seed) for seed in SEEDS]
    return float(np.sqrt(np.mean([drift(r.t, getattr(r, what)[:, columns], lag_s) ** 2 for r in runs])))


@pytest.mark.parametrize("noise", ["good", "rough"])
@pytest.mark.parametrize("lag_s", [0.5, 1.0, 2.0, 4.0, 6.0])
def test_the_horizontal_position_drifts_as_on_the_recorded_flight(noise: NoiseName, lag_s: float) -> None:
    real = recorded(noise)
    wanted = drift(real.t, real.position_m[:, 0:2], lag_s)
    assert 0.65 * wanted < mean_drift(noise, "position_m", slice(0, 2), lag_s) < 1.55 * wanted


@pytest.mark.parametrize(
    ("noise", "lag_s", "drift_m"), [("good", 3.0, 0.05), ("rough", 2.0, 0.18), ("rough", 6.0, 0.3)]
)
def test_the_drift_is_what_was_measured_on_real_builds(noise: NoiseName, lag_s: float, drift_m: float) -> None:
    assert mean_drift(noise, "position_m", slice(0, 2), lag_s) == pytest.approx(drift_m, rel=0.3)


@pytest.mark.parametrize("noise", ["good", "rough"])
@pytest.mark.parametrize("lag_s", [0.5, 1.0, 2.0, 4.0])
def test_the_heading_wanders_as_on_the_recorded_flight(noise: NoiseName, lag_s: float) -> None:
    real = recorded(noise)
    wanted = drift(real.t, real.attitude_rad[:, 2], lag_s)
    assert 0.7 * wanted < mean_drift(noise, "attitude_rad", slice(2, 3), lag_s) < 1.4 * wanted


@pytest.mark.parametrize("noise", ["good", "rough"])
def test_height_tilt_and_velocity_errors_have_the_recorded_size(noise: NoiseName) -> None:
    real = recorded(noise)
    for what, columns, low, high in (
        ("position_m", slice(2, 3), 0.6, 1.6),
        ("attitude_rad", slice(1, 2), 0.6, 1.6),  # pitch: roll also holds the timing of a fast manoeuvre
        ("velocity_m_s", slice(0, 2), 0.5, 1.6),
    ):
        wanted = drift(real.t, getattr(real, what)[:, columns], 2.0)
        assert low * wanted < mean_drift(noise, what, columns, 2.0) < high * wanted, what


def test_attitude_noise_has_the_measured_spread() -> None:
    for noise, heading_deg, roll_deg in (("good", 0.22, 0.1), ("rough", 2.0, 1.1)):
        name: NoiseName = "good" if noise == "good" else "rough"
        spread = np.mean([simulated(name, s).attitude_rad.std(axis=0) for s in SEEDS], axis=0)
        assert math.degrees(spread[2]) == pytest.approx(heading_deg, rel=0.3)
        assert math.degrees(spread[0]) < 1.2 * roll_deg


def test_the_compass_and_tilt_offsets_differ_between_aircraft_and_stay_during_a_flight() -> None:
    means = np.degrees([simulated("good", seed).attitude_rad.mean(axis=0) for seed in range(40)])
    assert 1.0 < means[:, 2].std() < 2.0
    assert 0.3 < means[:, 0].std() < 0.7
    first, last = (
        simulated("good", 3, 120.0).attitude_rad[part].mean(axis=0) for part in (slice(0, 2000), slice(-2000, None))
    )
    assert np.degrees(np.abs(first - last)).max() < 0.3


def test_the_same_seed_gives_the_same_errors() -> None:
    a, b, c = simulated("rough", 5, 2.0), simulated("rough", 5, 2.0), simulated("rough", 6, 2.0)
    np.testing.assert_array_equal(a.position_m, b.position_m)
    assert np.abs(a.position_m - c.position_m).max() > 0.01


@pytest.mark.parametrize("flavour", ["px4", "ardupilot"])
def test_what_is_reported_is_the_truth_with_these_errors_and_the_aircraft_flies_on_it(flavour: FlavourName) -> None:
    bench = Bench(AutopilotConfig(flavour=flavour, noise="rough", seed=4))
    bench.hover()
    bench.run(2.0)
    bench.path()
    bench.run(10.0)
    track = bench.path()
    assert 0.05 < np.hypot(track[:, 1].std(), track[:, 2].std()) < 0.8  # it follows its own errors
    bench.peer.ask_rate(33, 20.0)
    bench.run(0.2)
    told = bench.peer.of("GLOBAL_POSITION_INT")[-1]
    place = bench.autopilot.place.enu(told.lat / 1e7, told.lon / 1e7, told.alt / 1e3)
    error = np.array(place) - bench.autopilot.truth.position_enu_m
    assert 0.02 < np.linalg.norm(error) < 2.0


def test_wide_autopilots_differ_from_flight_to_flight_and_from_both_presets() -> None:
    drawn = [preset_of("wide", seed) for seed in range(200)]
    assert drawn[3] == preset_of("wide", 3)
    good, rough = PRESETS["good"], PRESETS["rough"]
    for name in ("horizontal", "vertical", "horizontal_velocity", "vertical_velocity", "roll", "pitch", "heading"):
        levels = np.array([getattr(preset, name).sigma for preset in drawn])
        assert levels.min() < 0.7 * getattr(good, name).sigma, name
        assert levels.max() > 1.7 * getattr(rough, name).sigma, name
    headings = np.array([p.heading.sigma for p in drawn])
    assert headings.max() > 8.0 * headings.min()
    times = np.array([p.horizontal.tau_s for p in drawn])
    assert times.max() > 10.0 * times.min()
    claims = np.array([p.gnss_accuracy_m[0] for p in drawn])
    assert claims.min() < PRESETS["good"].gnss_accuracy_m[0]
    assert claims.max() > PRESETS["rough"].gnss_accuracy_m[0]
    off = np.degrees([p.compass_off_rad for p in drawn])
    assert off.min() < -8.0
    assert off.max() > 8.0


def test_a_multipath_step_displaces_the_position_and_goes_again() -> None:
    step = MultipathStep(at_s=1.0, over_s=0.5, lasts_s=2.0, east_north_m=(0.8, -0.6))
    errors = EstimateErrors(NoisePreset(steps=(step,)), 0.1, np.random.default_rng(1))
    east = [errors.step().position[0] for _ in range(60)]
    assert east[5] == 0.0
    assert east[12] == pytest.approx(0.32)
    assert east[20] == pytest.approx(0.8)
    assert east[45] == 0.0
    assert step.at(np.linspace(0.0, 5.9, 60))[:, 0].tolist() == pytest.approx(east, abs=1e-9)
