"""The height of the ground and a known size as measurements: they sharpen the answer, truly, and only when given."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mission.estimate import ESTIMATORS
from mission.estimate.bound import bound
from mission.estimate.joint_model import JointModel, State
from mission.estimate.observations import observe
from mission.estimate.sightings_file import FlightProblem, flight_lines, read_flights, write_flight
from mission.records import Estimate, FlightSightings, NoiseModel, TargetPrior
from sitl.evaluation.accuracy.flights import PAPER_CAMERA, SimulatedFlight, Walk, out_and_back, paper_pattern, simulate

BATCH = ESTIMATORS["batch"]
GROUND_UP_M, HEIGHT_M = -4.0, 1.75
"""Of the simulated flights: the camera starts at 1.5 m up, 4.625 m above the target's centre."""
CENTRE_M = HEIGHT_M / 2.0
KNOWN_HEIGHT = TargetPrior(height_m=HEIGHT_M, height_sigma_m=0.03)
KNOWN_GROUND = TargetPrior(ground_up_m=GROUND_UP_M, ground_sigma_m=0.05, centre_above_ground_m=CENTRE_M)
KNOWN_BOTH = replace(KNOWN_GROUND, height_m=HEIGHT_M, height_sigma_m=0.03)
KNOWLEDGE = pytest.mark.parametrize("known", [KNOWN_HEIGHT, KNOWN_GROUND, KNOWN_BOTH], ids=["size", "ground", "both"])


def from_above(seed: int, *, one_way: bool = True, sized: bool = True) -> SimulatedFlight:
    """A person 9 m away, seen from above."""
    return simulate(
        paper_pattern() if one_way else out_and_back(),
        Walk(9.0, (0.5, 0.3, 0.0), above_camera_m=GROUND_UP_M + CENTRE_M - 1.5, height_m=HEIGHT_M),
        np.random.default_rng(seed),
        pitch_down_rad=0.45,
        sizes=lambda _: sized,
    )


def told(flight: FlightSightings, prior: TargetPrior) -> Estimate:
    return BATCH.estimate(replace(flight, prior=prior))


def depth_sigma_m(prior: TargetPrior) -> float:
    pattern = paper_pattern()
    target = np.array([0.0, 9.0, GROUND_UP_M + CENTRE_M])
    camera_m = pattern.left_ahead_up_m * (-1.0, 1.0, 1.0) + (0.0, 0.0, 1.5)
    velocity = np.array([0.5, 0.3, 0.0])
    return bound(pattern.t_s, camera_m, target, velocity, PAPER_CAMERA, NoiseModel(), prior).depth_sigma_m


@KNOWLEDGE
def test_they_tighten_the_bound(known: TargetPrior) -> None:
    assert depth_sigma_m(known) < 0.7 * depth_sigma_m(TargetPrior())


def test_the_better_they_are_known_the_more_they_tighten() -> None:
    for value, sigma in (("ground_up_m", "ground_sigma_m"), ("height_m", "height_sigma_m")):
        known = TargetPrior(**{value: getattr(KNOWN_BOTH, value)})
        sigmas = [depth_sigma_m(TargetPrior(**{value: getattr(known, value), sigma: s})) for s in (0.02, 0.1, 0.5)]
        assert sigmas == sorted(sigmas)
        assert sigmas[0] < sigmas[2]


@KNOWLEDGE
def test_the_answer_is_nearer_to_the_truth_and_its_covariance_is_true(known: TargetPrior) -> None:
    plain, sharper, inside = [], [], 0
    for seed in range(25):
        rng, flown = np.random.default_rng(1000 + seed), from_above(seed)
        measured = known
        if known.ground_up_m is not None:
            measured = replace(measured, ground_up_m=known.ground_up_m + 0.05 * rng.standard_normal())
        if known.height_m is not None:
            measured = replace(measured, height_m=known.height_m + 0.03 * rng.standard_normal())
        plain.append(abs(BATCH.estimate(flown.flight).depth_m - flown.depth_m))
        answer = told(flown.flight, measured)
        sharper.append(abs(answer.depth_m - flown.depth_m))
        assert answer.first is not None
        off = (answer.first.position_enu_m - flown.target_m[0])[:2]
        inside += bool(off @ np.linalg.solve(answer.first.covariance[:2, :2], off) < 5.99)
    assert np.sqrt(np.mean(np.square(sharper))) < 0.9 * np.sqrt(np.mean(np.square(plain)))
    assert inside >= 20  # of 25; measured over many more: 85 to 92 %


@KNOWLEDGE
def test_the_gradient_with_them_is_that_of_the_cost(known: TargetPrior) -> None:
    flight = from_above(0).flight
    model = JointModel(observe(flight), flight.noise, known)
    state = model.start(np.array([1.0, 8.0, -4.0]), np.array([0.2, 0.1, 0.0]), 0.4)
    at = model.linearise(state)
    assert at is not None
    _, _, right = model.normal_equations(at)
    for place in (2, 6):
        step = np.zeros(9)
        step[place] = 1e-5
        ahead = model.linearise(State(state.chain, state.border + step))
        behind = model.linearise(State(state.chain, state.border - step))
        assert ahead is not None
        assert behind is not None
        assert right[place] == pytest.approx(-0.5 * (ahead.cost - behind.cost) / 2e-5, rel=1e-4)


@KNOWLEDGE
def test_known_without_any_precision_they_change_nothing(known: TargetPrior) -> None:
    flight = from_above(1, one_way=False).flight
    vague = replace(
        known,
        ground_sigma_m=None if known.ground_up_m is None else 1e6,
        height_sigma_m=None if known.height_m is None else 1e6,
    )
    np.testing.assert_allclose(
        told(flight, vague).position_enu_m, told(flight, TargetPrior()).position_enu_m, atol=0.02
    )


def test_each_counts_as_one_measurement() -> None:
    flight = from_above(2).flight
    dof = [told(flight, prior).dof for prior in (TargetPrior(), KNOWN_HEIGHT, KNOWN_GROUND, KNOWN_BOTH)]
    assert dof[0] is not None
    assert [None if d is None else d - dof[0] for d in dof] == [0, 1, 1, 2]


def test_a_known_size_says_nothing_where_no_height_was_seen() -> None:
    flight = from_above(3, one_way=False, sized=False).flight
    with_size, without = told(flight, KNOWN_HEIGHT), told(flight, TargetPrior())
    np.testing.assert_allclose(with_size.position_enu_m, without.position_enu_m, atol=1e-3)
    assert with_size.dof == without.dof


def test_the_ground_is_where_the_frame_says_it_is() -> None:
    flown = from_above(4)
    up = np.array([0.0, 0.0, 100.0])
    lifted = tuple(
        replace(s, position_enu_m=(s.position_enu_m[0], s.position_enu_m[1], s.position_enu_m[2] + 100.0))
        for s in flown.flight.sightings
    )
    low = told(flown.flight, KNOWN_GROUND)
    high = told(replace(flown.flight, sightings=lifted), replace(KNOWN_GROUND, ground_up_m=GROUND_UP_M + 100.0))
    np.testing.assert_allclose(high.position_enu_m, low.position_enu_m + up, atol=1e-6)


def test_the_file_carries_them(tmp_path: Path) -> None:
    flight = replace(from_above(5).flight, prior=KNOWN_BOTH)
    write_flight(tmp_path / "flight.jsonl", flight)
    assert list(read_flights(tmp_path / "flight.jsonl")) == [flight]


def test_a_file_without_them_is_as_it_always_was() -> None:
    header = json.loads(next(flight_lines(from_above(6).flight)))
    assert list(header["prior"]) == ["speed_sigma_m_s", "vertical_speed_sigma_m_s", "acceleration_psd_m2_s3"]


def _with(**changes: object) -> Callable[[dict[str, object]], None]:
    return lambda prior: prior.update(changes)


def _without(name: str) -> Callable[[dict[str, object]], None]:
    return lambda prior: prior.__delitem__(name)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (_without("ground_sigma_m"), '"ground_sigma_m" go together'),
        (_without("ground_up_m"), '"ground_sigma_m" go together'),
        (_without("height_sigma_m"), '"height_sigma_m" go together'),
        (_with(ground_up_m=None), '"ground_up_m" is null'),
        (_with(ground_up_m="low"), '"ground_up_m" is not a number'),
        (_with(ground_up_m=True), '"ground_up_m" is not a number'),
        (_with(ground_up_m=float("inf")), '"ground_up_m" is not finite'),
        (_with(ground_sigma_m=-0.1), '"ground_sigma_m" is -0.1'),
        (_with(centre_above_ground_m=[1.0]), '"centre_above_ground_m" is not a number'),
        (_with(height_m=0.0), '"height_m" is 0'),
        (_with(height_sigma_m=-1.0), '"height_sigma_m" is -1'),
    ],
)
def test_wrong_ones_are_named(tmp_path: Path, change: Callable[[dict[str, object]], None], problem: str) -> None:
    lines = list(flight_lines(replace(from_above(7).flight, prior=KNOWN_BOTH)))
    header = json.loads(lines[0])
    change(header["prior"])
    path = tmp_path / "flight.jsonl"
    path.write_text("\n".join([json.dumps(header), *lines[1:]]), encoding="utf-8")
    (found,) = read_flights(path)
    assert isinstance(found, FlightProblem)
    assert problem in found.message


@pytest.mark.parametrize("sigma_m", [0.0, 1e300])
def test_a_sigma_of_nothing_or_of_everything_is_still_solved(sigma_m: float) -> None:
    flown = from_above(8, one_way=False)
    answer = told(flown.flight, replace(KNOWN_BOTH, ground_sigma_m=sigma_m, height_sigma_m=sigma_m))
    assert answer.depth_m == pytest.approx(flown.depth_m, rel=0.1)


@pytest.mark.parametrize("height_m", [1.7, 1.1])
def test_an_adult_s_height_sharpens_the_answer_and_a_child_stays_possible(height_m: float) -> None:
    inside, nearer = 0, []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        flown = simulate(out_and_back(length_m=0.8), Walk(9.0, (0.5, 0.3, 0.0), height_m=height_m), rng)
        with_class = told(flown.flight, TargetPrior(class_height="use"))
        without = told(flown.flight, TargetPrior(class_height="compare"))
        assert any("adult" in note for note in with_class.notes)
        assert any("adult" in note for note in without.notes)
        assert with_class.covariance is not None
        miss = (with_class.position_enu_m - flown.target_m[-1])[:2]
        inside += bool(miss @ np.linalg.solve(with_class.covariance[:2, :2], miss) < 5.99)
        nearer.append([abs(answer.depth_m - flown.depth_m) for answer in (with_class, without)])
    assert inside >= 12
    used, unused = np.median(nearer, axis=0)
    assert height_m != 1.7 or used < unused


def test_a_wrong_class_height_is_named(tmp_path: Path) -> None:
    lines = list(flight_lines(replace(from_above(7).flight, prior=TargetPrior(class_height="use"))))
    path = tmp_path / "flight.jsonl"
    path.write_text("\n".join(lines), encoding="utf-8")
    (read,) = read_flights(path)
    assert not isinstance(read, FlightProblem)
    assert read.prior.class_height == "use"
    path.write_text("\n".join(lines).replace('"use"', '"always"'), encoding="utf-8")
    (found,) = read_flights(path)
    assert isinstance(found, FlightProblem)
    assert '"class_height" is none of use, compare, never' in found.message
