"""The default estimator: accuracy, honest covariance, wrong sightings, motion models, refusals, odd input."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from mission.errors import EstimateRefused
from mission.estimate import Batch
from mission.estimate.bound import bound
from mission.records import FlightSightings, NoiseModel, Sighting, TargetPrior, Vector
from sitl.evaluation.accuracy.flights import (
    PAPER_CAMERA,
    Pattern,
    SimulatedFlight,
    Walk,
    out_and_back,
    paper_pattern,
    s_pattern,
    simulate,
)
from sitl.evaluation.people.flights import PeopleSetting, people_flight

WALKS = [(0.0, 0.0), (0.6, 0.0), (-0.6, 0.0), (0.0, 0.6), (0.0, -0.3), (0.42, 0.42), (-0.42, 0.42)]
DEPTHS = [4.0, 7.25, 9.0, 15.0, 25.0]


def flights(count: int, seed: int, *, wrong_share: float = 0.0, psd: float = 0.0) -> Iterator[SimulatedFlight]:
    """Out-and-back and S patterns over seven walks and five depths, headings at random."""
    rng = np.random.default_rng(seed)
    patterns = [out_and_back(), s_pattern(rate_hz=7.4)]
    for i in range(count):
        east, north = WALKS[i % 7]
        yield simulate(
            patterns[i % 2],
            Walk(DEPTHS[i % 5], (east, north, 0.0)),
            rng,
            wrong_share=wrong_share,
            prior=TargetPrior(acceleration_psd_m2_s3=psd),
        )


def errors(simulated: Iterator[SimulatedFlight]) -> tuple[Vector, Vector]:
    """Relative depth errors, and normalised squared errors of the final horizontal position."""
    depth, squared = [], []
    for sim in simulated:
        estimate = Batch().estimate(sim.flight)
        assert estimate.covariance is not None
        depth.append(estimate.depth_m / sim.depth_m - 1.0)
        miss = (estimate.position_enu_m - sim.target_m[-1])[:2]
        squared.append(miss @ np.linalg.solve(estimate.covariance[:2, :2], miss))
    return np.array(depth), np.array(squared)


def changed(flight: FlightSightings, **fields: object) -> FlightSightings:
    return replace(flight, sightings=tuple(replace(s, **fields) for s in flight.sightings))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def sim() -> SimulatedFlight:
    return simulate(out_and_back(), Walk(9.0, (0.4, 0.2, 0.0)), np.random.default_rng(0))


def test_depth_and_covariance_are_right_over_many_flights() -> None:
    depth, squared = errors(flights(70, seed=11))
    assert np.median(np.abs(depth)) < 0.025
    assert np.percentile(np.abs(depth), 95) < 0.1
    # Steady walks, told true noise: wider than it need be for people who wander, never narrower.
    assert 0.9 < squared.mean() < 2.5
    assert np.mean(squared < 5.99) > 0.9


def test_depth_errors_are_at_the_cramer_rao_bound() -> None:
    ratios = []
    for sim in flights(70, seed=12):
        flight = sim.flight
        best = bound(
            np.array([s.t_s for s in flight.sightings]),
            sim.camera_m,
            sim.target_m[0],
            sim.velocity_m_s[0],
            flight.camera,
            flight.noise,
            flight.prior,
        )
        ratios.append((Batch().estimate(flight).depth_m - sim.depth_m) / best.depth_sigma_m)
    assert np.sqrt(np.mean(np.square(ratios))) < 1.25  # a steady walk is not taken for granted
    assert abs(np.mean(ratios)) < 0.7


def test_a_tenth_of_wrong_sightings_is_found_and_hardly_hurts() -> None:
    depth, squared = errors(flights(42, seed=13, wrong_share=0.1))
    assert np.median(np.abs(depth)) < 0.026
    assert np.percentile(np.abs(depth), 95) < 0.085
    assert np.mean(squared < 5.99) > 0.88


def test_wrong_sightings_are_counted_as_rejected() -> None:
    for sim in flights(21, seed=14, wrong_share=0.1):
        rejected = Batch().estimate(sim.flight).rejected
        assert abs(rejected - int(sim.wrong.sum())) <= 1


def test_a_wrong_person_in_a_row_of_frames_is_found(sim: SimulatedFlight) -> None:
    off = [
        replace(s, pixel=(s.pixel[0] + 90.0, s.pixel[1])) if 20 <= i < 26 else s
        for i, s in enumerate(sim.flight.sightings)
    ]
    estimate = Batch().estimate(replace(sim.flight, sightings=tuple(off)))
    assert estimate.rejected == 6
    assert estimate.depth_m == pytest.approx(Batch().estimate(sim.flight).depth_m, rel=0.02)


@pytest.mark.parametrize("factor", [0.01, 0.5, 2.0, 100.0])
def test_a_wrong_height_costs_no_more_than_itself(sim: SimulatedFlight, factor: float) -> None:
    heights = [
        replace(s, height_px=factor * (s.height_px or 1.0)) if i == 20 else s
        for i, s in enumerate(sim.flight.sightings)
    ]
    estimate = Batch().estimate(replace(sim.flight, sightings=tuple(heights)))
    assert estimate.depth_m == pytest.approx(Batch().estimate(sim.flight).depth_m, rel=0.01)


def test_a_target_that_wanders_is_located_when_the_prior_says_so() -> None:
    depth, squared = errors(flights(42, seed=15, psd=0.005))
    assert np.median(np.abs(depth)) < 0.052
    assert np.mean(squared < 5.99) > 0.88
    assert Batch().estimate(next(flights(1, 0, psd=0.005)).flight).model == "wandering"


def test_the_one_way_pattern_is_answered_and_called_poor() -> None:
    rng = np.random.default_rng(4)
    estimates = [
        Batch().estimate(simulate(paper_pattern(), Walk(12.0, (0.3, 0.3, 0.0)), rng, sizes=lambda _: False).flight)
        for _ in range(5)
    ]
    assert all(any("poor" in note for note in estimate.notes) for estimate in estimates)


@pytest.mark.parametrize("pitch_deg", [0.0, 30.0])
def test_heights_may_be_missing_for_some_or_for_all(pitch_deg: float) -> None:
    for sizes in (lambda _: False, lambda i: i % 4 == 0, lambda i: i < 10):
        sim = simulate(
            out_and_back(),
            Walk(9.0, (0.3, -0.3, 0.0), above_camera_m=-9.0 * np.tan(np.radians(pitch_deg))),
            np.random.default_rng(2),
            pitch_down_rad=np.radians(pitch_deg),
            start_enu_m=(0.0, 0.0, 8.0),
            sizes=sizes,
        )
        estimate = Batch().estimate(sim.flight)
        assert estimate.depth_m == pytest.approx(9.0, rel=0.15)


def test_the_estimate_says_what_it_holds_for(sim: SimulatedFlight) -> None:
    estimate = Batch().estimate(sim.flight)
    assert (estimate.id, estimate.method) == ("simulated", "batch")
    assert estimate.model in ("steady", "wandering")
    assert estimate.t_s == pytest.approx(6.0)
    assert estimate.first is not None
    assert estimate.first.t_s == 0.0
    assert estimate.velocity_enu_m_s is not None
    steady = estimate.first.position_enu_m + 6.0 * estimate.velocity_enu_m_s
    np.testing.assert_allclose(steady, estimate.position_enu_m, atol=0.3)
    assert estimate.covariance is not None
    assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0
    assert estimate.chi2 is not None
    assert estimate.dof == 3 * 61 - 4
    assert 0.2 < estimate.chi2 / estimate.dof < 1.5


def test_the_same_flight_gives_the_same_answer_bit_for_bit(sim: SimulatedFlight) -> None:
    one, two = Batch().estimate(sim.flight), Batch().estimate(sim.flight)
    assert one.position_enu_m.tobytes() == two.position_enu_m.tobytes()
    assert one.covariance is not None
    assert two.covariance is not None
    assert one.covariance.tobytes() == two.covariance.tobytes()


@pytest.mark.parametrize("count", [3, 4, 5, 11, 600])
def test_few_and_many_sightings(count: int) -> None:
    sim = simulate(out_and_back(rate_hz=(count - 1) / 6.0), Walk(7.0), np.random.default_rng(count))
    estimate = Batch().estimate(sim.flight)
    assert estimate.sightings == count
    assert estimate.depth_m == pytest.approx(7.0, rel=0.15)


def test_a_distorting_lens_is_accounted_for() -> None:
    camera = replace(PAPER_CAMERA, distortion=(-0.3, 0.1, 0.001, -0.001, 0.0))
    sim = simulate(paper_pattern(), Walk(14.0), np.random.default_rng(6), camera=camera)
    assert Batch().estimate(sim.flight).depth_m == pytest.approx(14.0, rel=0.15)


def test_noise_terms_of_zero_are_taken_at_their_word() -> None:
    silent = NoiseModel(*(0.0,) * 12)
    sim = simulate(out_and_back(), Walk(9.0, (0.4, 0.2, 0.0)), np.random.default_rng(0), noise=silent)
    estimate = Batch().estimate(sim.flight)
    np.testing.assert_allclose(estimate.position_enu_m, sim.target_m[-1], atol=0.05)


def refused(flight: FlightSightings) -> str:
    with pytest.raises(EstimateRefused) as caught:
        Batch().estimate(flight)
    assert caught.value.remedy
    return caught.value.cause


def test_fewer_than_three_sightings_are_refused(sim: SimulatedFlight) -> None:
    for count in range(3):
        assert "too few" in refused(replace(sim.flight, sightings=sim.flight.sightings[:count]))


def test_a_camera_that_stays_where_it_is_is_refused(sim: SimulatedFlight) -> None:
    assert "parallax" in refused(changed(sim.flight, position_enu_m=(0.0, 0.0, 1.5)))


def test_a_pattern_that_is_too_short_for_the_distance_is_refused() -> None:
    rng = np.random.default_rng(1)
    assert "not determined" in refused(simulate(out_and_back(length_m=0.05), Walk(9.0), rng).flight)
    assert "not determined" in refused(simulate(out_and_back(), Walk(2000.0), rng).flight)


def test_a_distance_that_rests_on_the_prior_alone_is_refused() -> None:
    # One way at constant speed, without sizes: the target's own motion cannot be told from parallax.
    t = np.arange(0.0, 6.0, 0.1)
    pattern = Pattern("one way", t, np.column_stack((0.4 * t, 0.0 * t, 0.0 * t)))
    refused(simulate(pattern, Walk(9.0), np.random.default_rng(1), sizes=lambda _: False).flight)


def test_a_target_behind_the_camera_is_refused(sim: SimulatedFlight) -> None:
    def turned(s: Sighting) -> Sighting:
        w, x, y, z = s.world_from_camera_wxyz
        return replace(s, world_from_camera_wxyz=(-y, -z, w, x))  # by half a turn about the camera's y axis

    assert "behind" in refused(replace(sim.flight, sightings=tuple(turned(s) for s in sim.flight.sightings)))


@pytest.mark.parametrize(
    "fields",
    [
        {"pixel": (1e300, -1e300)},
        {"height_px": 1e-300},
        {"position_enu_m": (1e300, 0.0, 0.0)},
        {"pixel_sigma_px": 1e300},
        {"t_s": 0.0},
    ],
    ids=lambda fields: next(iter(fields)),
)
def test_absurd_numbers_end_in_an_answer_or_a_refusal(sim: SimulatedFlight, fields: dict[str, object]) -> None:
    try:
        estimate = Batch().estimate(changed(sim.flight, **fields))
    except EstimateRefused:
        return
    assert np.isfinite(estimate.position_enu_m).all()


@pytest.mark.parametrize("gap_s", [10.0, 60.0])
def test_a_long_gap_in_time_is_no_problem(gap_s: float) -> None:
    pattern = out_and_back()
    late = replace(pattern, t_s=np.where(pattern.t_s > 3.05, pattern.t_s + gap_s, pattern.t_s))
    sim = simulate(late, Walk(9.0), np.random.default_rng(3))
    assert Batch().estimate(sim.flight).depth_m == pytest.approx(9.0, rel=0.2)


@pytest.mark.parametrize("walks", ["starts", "turns", "crouching"])
def test_a_covariance_is_one_however_people_move(walks: str) -> None:
    for number in (*range(6), 34):  # 34: someone who starts, whose end lies in what few modes leave out
        sim = people_flight(PeopleSetting(walks=walks), 7707, number)
        try:
            estimate = Batch().estimate(sim.flight)
        except EstimateRefused:
            continue
        assert estimate.covariance is not None
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0


def test_someone_who_crouches_is_not_taken_for_someone_who_leaves() -> None:
    depth = []
    for number in range(10):
        sim = people_flight(PeopleSetting(walks="crouching"), 41, number)
        try:
            estimate = Batch().estimate(sim.flight)
        except EstimateRefused:
            continue
        away = np.linalg.norm((estimate.position_enu_m - sim.camera_m[-1])[:2])
        depth.append(away / np.linalg.norm((sim.target_m[-1] - sim.camera_m[-1])[:2]) - 1.0)
    assert np.median(np.abs(depth)) < 0.3
