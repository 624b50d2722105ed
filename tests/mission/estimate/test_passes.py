"""The sidesteps of one procedure: each stands on the ones before it, truly, and a replay of the log says the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mission.errors import EstimateRefused
from mission.estimate import Batch
from mission.estimate.passes import SAME_TARGET_CHI2, Passes, surprise
from mission.estimate.sightings_file import FlightProblem, read_flights, write_flight
from mission.records import Estimate, FlightSightings, Vector
from sitl.evaluation.accuracy.flights import SimulatedFlight, Walk, out_and_back
from sitl.evaluation.accuracy.repeated import repeated_passes


def procedure(seed: int, *, between_psd: float = 0.02, depth_m: float = 9.0) -> list[SimulatedFlight]:
    rng = np.random.default_rng(seed)
    right, away = rng.normal(0.0, 0.4, 2)
    walk = Walk(depth_m, (float(right), float(away), 0.0))
    return repeated_passes(out_and_back(), (8.0, 8.0), walk, rng, between_psd_m2_s3=between_psd)


def continuing(flight: FlightSightings, before: str | None) -> FlightSightings:
    return replace(flight, continues=before)


def fused(sims: list[SimulatedFlight]) -> list[Estimate]:
    passes = Passes()
    return [passes.estimate(continuing(sim.flight, str(k) if k else None)) for k, sim in enumerate(sims)]


def depth_sigma_m(estimate: Estimate, flight: FlightSightings) -> float:
    assert estimate.first is not None
    line = (estimate.first.position_enu_m - np.array(flight.sightings[0].position_enu_m))[:2]
    line /= np.linalg.norm(line)
    return float(np.sqrt(line @ estimate.first.covariance[:2, :2] @ line))


def root_mean_square(values: list[list[float]], axis: int) -> Vector:
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=axis)))


def test_the_first_pass_is_the_batch() -> None:
    (sim, *_) = procedure(1)
    estimate, batch = Passes().estimate(sim.flight), Batch().estimate(sim.flight)
    np.testing.assert_array_equal(estimate.position_enu_m, batch.position_enu_m)
    assert estimate.notes == batch.notes


def test_a_pass_with_what_was_carried_is_more_exact_than_alone_and_as_true() -> None:
    sigmas, errors, squared = [], [], []
    for seed in range(8):
        sims = procedure(seed)
        for sim, estimate in list(zip(sims, fused(sims), strict=True))[1:]:
            try:
                alone = Batch().estimate(sim.flight)
            except EstimateRefused:
                continue  # only together they say enough
            sigmas.append(depth_sigma_m(estimate, sim.flight) / depth_sigma_m(alone, sim.flight))
            errors.append([abs(found.depth_m / sim.depth_m - 1.0) for found in (estimate, alone)])
            reports = np.array(sim.flight.sightings[0].position_enu_m) - sim.camera_m[0]
            miss = (estimate.position_enu_m - reports - sim.target_m[-1])[:2]
            assert estimate.covariance is not None
            squared.append(float(miss @ np.linalg.solve(estimate.covariance[:2, :2], miss)))
    assert np.median(sigmas) < 0.75
    for typical, most in ((np.median, 0.95), (root_mean_square, 0.8)):
        with_it, alone_error = typical(errors, axis=0)
        assert with_it < most * alone_error
    assert 0.8 < np.mean(squared) < 3.0
    assert np.mean(np.array(squared) < 5.99) > 0.85


def test_a_bias_that_all_passes_share_is_not_averaged_out() -> None:
    """The heading's bias turns the whole; were it another one in each pass, three would leave 58 % of it."""
    left, errors = [], []
    for seed in range(8):
        walk, rng = Walk(9.0), np.random.default_rng(seed)
        sims = repeated_passes(out_and_back(), (3.0, 3.0), walk, rng, between_psd_m2_s3=0.0)
        last = fused(sims)[-1]
        assert last.covariance is not None
        line = (last.position_enu_m - np.array(sims[-1].flight.sightings[-1].position_enu_m))[:2]
        side = np.array((-line[1], line[0])) / np.linalg.norm(line)
        sigma = float(np.sqrt(side @ last.covariance[:2, :2] @ side))
        left.append(sigma / float(np.linalg.norm(line)) / sims[0].flight.noise.heading_bias_sigma_rad)
        errors.append(float(side @ (last.position_enu_m - sims[-1].target_m[-1])[:2]) / sigma)
    assert 0.7 < np.median(left) < 1.0
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.6


def test_a_replay_of_the_log_answers_bit_for_bit(tmp_path: Path) -> None:
    sims = procedure(4)
    for number, sim in enumerate(sims):
        flight = continuing(sim.flight, str(number) if number else None)
        write_flight(tmp_path / "log.jsonl", flight, append=number > 0)
    again = Passes()
    for read, wanted in zip(read_flights(tmp_path / "log.jsonl"), fused(sims), strict=True):
        assert not isinstance(read, FlightProblem)
        found = again.estimate(read)
        np.testing.assert_array_equal(found.position_enu_m, wanted.position_enu_m)
        assert found.covariance is not None
        assert wanted.covariance is not None
        np.testing.assert_array_equal(found.covariance, wanted.covariance)
        assert (found.chi2, found.notes) == (wanted.chi2, wanted.notes)


def test_another_target_stands_for_itself() -> None:
    (first, *_), (_, other, _) = procedure(5), procedure(6, depth_m=15.0)
    passes = Passes()
    passes.estimate(first.flight)
    estimate = passes.estimate(continuing(other.flight, "1"))
    assert "is another one" in estimate.notes[-1]
    np.testing.assert_array_equal(estimate.position_enu_m, Batch().estimate(other.flight).position_enu_m)


def test_targets_that_move_as_expected_are_hardly_ever_taken_for_another() -> None:
    values = []
    for seed in range(12):
        first, second, _ = procedure(seed + 40)
        values.append(surprise(Batch().estimate(first.flight), Batch().estimate(second.flight)))
    assert max(values) < SAME_TARGET_CHI2
    assert 0.1 < np.mean(values) < 3.0  # 2 degrees of freedom, less what both share


@pytest.mark.parametrize("continues", ["2", "nobody"])
def test_a_pass_whose_predecessor_is_missing_stands_for_itself(continues: str) -> None:
    first, second, _ = procedure(7)
    passes = Passes()
    passes.estimate(first.flight)
    estimate = passes.estimate(continuing(second.flight, continues))
    assert f"{continues} is not the pass before it" in estimate.notes[-1]
    np.testing.assert_array_equal(estimate.position_enu_m, Batch().estimate(second.flight).position_enu_m)


def test_a_pass_before_the_one_it_continues_stands_for_itself() -> None:
    first, second, _ = procedure(8)
    passes = Passes()
    passes.estimate(second.flight)
    assert "stands for itself" in passes.estimate(continuing(first.flight, "2")).notes[-1]


def test_a_pass_that_says_too_little_is_estimated_with_the_one_before() -> None:
    first, second, _ = procedure(9)
    passes = Passes()
    passes.estimate(first.flight)
    short = replace(second.flight, sightings=second.flight.sightings[:2], continues="1")
    with pytest.raises(EstimateRefused):
        Batch().estimate(short)
    assert np.isfinite(passes.estimate(short).position_enu_m).all()


def test_a_refused_pass_leaves_what_was_before() -> None:
    first, second, _ = procedure(9)
    passes = Passes()
    passes.estimate(first.flight)
    with pytest.raises(EstimateRefused):
        passes.estimate(replace(second.flight, sightings=(), continues="1"))
    after = passes.estimate(continuing(second.flight, "1"))
    assert not any("stands for itself" in note for note in after.notes)


def test_a_pass_without_parallax_lives_on_what_was_carried() -> None:
    first, second, _ = procedure(10)
    passes = Passes()
    passes.estimate(first.flight)
    place = second.flight.sightings[0].position_enu_m
    still = replace(
        second.flight, sightings=tuple(replace(s, position_enu_m=place) for s in second.flight.sightings[:9])
    )
    assert np.isfinite(passes.estimate(continuing(still, "1")).position_enu_m).all()
