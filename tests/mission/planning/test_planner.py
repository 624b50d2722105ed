"""The planner: what it answers can be flown within the room, is as exact as said, and is no longer than it must be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.errors import EstimateRefused, FlightRefused, SettingsError
from mission.estimate import ESTIMATORS
from mission.estimate.bound import bound
from mission.planning.bound import Judge, Outlook, Plan, duration_s, peak_speed_m_s, sampled
from mission.planning.pattern import LARGEST_SHARE, fitted, lateral_path
from mission.planning.planner import LARGEST_ACCELERATION_M_S2, Shortfall, SideRoom, plan
from mission.records import CameraIntrinsics, NoiseModel, TargetPrior
from mission.settings import PatternSettings
from mission.vehicle.drone import Bounds
from mission.vehicle.path_follower import check_path
from sitl.evaluation.accuracy.flights import Pattern, Walk, simulate

CAMERA = CameraIntrinsics(640, 480, 516.5, 516.5, 320.0, 240.0)
ROOM = SideRoom(6.0, 6.0, 3.0, 3.0, 40.0)
STEADY = TargetPrior(acceleration_psd_m2_s3=1e-9)
"""People who walk in straight lines, so that only the geometry decides."""


def outlook(distance_m: float = 9.0) -> Outlook:
    return Outlook(distance_m, CAMERA, prior=STEADY, rate_hz=10.0)


def planned(sigma_m: float, room: SideRoom = ROOM, distance_m: float = 9.0) -> Plan:
    answer = plan(sigma_m, outlook(distance_m), room)
    assert isinstance(answer, Plan)
    return answer


@settings(max_examples=15, deadline=None)
@given(
    distance=st.floats(2.0, 30.0),
    share=st.floats(0.02, 0.08),
    left=st.floats(0.0, 12.0),
    right=st.floats(1.0, 12.0),
    speed=st.floats(0.8, 5.0),
    time=st.floats(8.0, 30.0),
)
def test_every_bound_is_honoured(
    distance: float, share: float, left: float, right: float, speed: float, time: float
) -> None:
    room = SideRoom(left, right, 3.0, speed, time)
    answer = plan(share * distance, replace(outlook(distance), walk_m_s=0.0), room)
    found = answer.best if isinstance(answer, Shortfall) else answer
    path = lateral_path(found.pattern, 0.0)
    roomy = Bounds(50.0, 1.0, 30.0, speed, time + 1e-6)
    start = np.array([0.0, 0.0, -3.0])
    assert check_path(path, roomy, start, start, 0.0, time + 1e-6) is None
    east = np.array([knot.offset_enu_m[0] for knot in path.knots])
    assert east.min() >= -left - 1e-9
    assert east.max() <= right + 1e-9
    assert np.ptp(east) > 0.9
    assert np.abs(east).max() <= LARGEST_SHARE * distance + 1e-9
    fine_s, places = sampled(found.pattern, 50.0)
    acceleration = np.gradient(np.gradient(places[:, 0], fine_s), fine_s)
    assert np.abs(acceleration).max() <= 1.05 * LARGEST_ACCELERATION_M_S2
    assert fitted(found.pattern, distance) == found.pattern


@pytest.mark.parametrize("sigma_m", [0.5, 0.25])
def test_the_expected_sigma_is_the_bound_of_the_path_as_it_is_flown(sigma_m: float) -> None:
    found = planned(sigma_m)
    t_s, camera_m = sampled(found.pattern, 10.0)
    sigmas = {}
    for walk in [(0.0, 0.0), *((math.sin(a), math.cos(a)) for a in np.arange(8) * math.pi / 4.0)]:
        velocity = np.array([*walk, 0.0])
        target = np.array([0.0, 9.0, 0.85 - 3.0])
        sigmas[walk] = bound(t_s, camera_m, target, velocity, CAMERA, NoiseModel(), STEADY).depth_sigma_m
    assert found.standing_sigma_m == pytest.approx(sigmas[0.0, 0.0], rel=1e-9)
    assert found.worst_sigma_m == pytest.approx(max(sigmas.values()), rel=1e-9)
    assert found.worst_sigma_m <= sigma_m
    assert sigmas[max(sigmas, key=lambda walk: sigmas[walk])] == pytest.approx(found.worst_sigma_m)


def test_flown_in_simulation_it_is_about_as_exact_as_planned() -> None:
    found = planned(0.3)
    t_s, camera_m = sampled(found.pattern, 10.0)
    pattern = Pattern("planned", t_s, camera_m * (-1.0, 1.0, 1.0))
    walk = Walk(9.0, (*found.worst_walk_m_s, 0.0), above_camera_m=0.85 - 3.0)
    flights = [simulate(pattern, walk, np.random.default_rng(seed)) for seed in range(40)]
    errors = [ESTIMATORS["batch"].estimate(flown.flight).depth_m - flown.depth_m for flown in flights]
    assert 0.6 * found.worst_sigma_m < np.sqrt(np.mean(np.square(errors))) < 1.3 * found.worst_sigma_m


def test_sampled_positions_are_those_of_the_path() -> None:
    pattern = PatternSettings(kind="s", length_m=2.0)
    t_s, camera_m = sampled(pattern, 10.0)
    assert t_s[-1] <= duration_s(pattern) < t_s[-1] + 0.1
    assert duration_s(pattern) == pytest.approx(lateral_path(pattern, 0.0).duration_s)
    assert np.abs(np.gradient(camera_m[:, 0], t_s)).max() == pytest.approx(peak_speed_m_s(pattern), rel=0.02)


@settings(max_examples=8, deadline=None)
@given(st.floats(4.0, 20.0), st.floats(0.025, 0.06), st.floats(1.0, 4.0), st.floats(1.0, 3.0))
def test_more_room_or_time_never_makes_the_answer_worse(
    distance: float, share: float, room_m: float, more: float
) -> None:
    small = SideRoom(room_m, room_m, 3.0, 3.0, 12.0)
    seen = outlook(distance)
    for large in (replace(small, left_m=more * room_m, right_m=more * room_m), replace(small, max_time_s=12.0 * more)):
        before, after = plan(share * distance, seen, small), plan(share * distance, seen, large)
        if isinstance(before, Plan):
            assert isinstance(after, Plan)
            assert after.time_s <= before.time_s + 1e-9
        elif isinstance(after, Shortfall):
            assert after.best.worst_sigma_m <= before.best.worst_sigma_m * 1.01


def test_a_higher_accuracy_takes_longer() -> None:
    times = [planned(sigma_m).time_s for sigma_m in (0.6, 0.3, 0.2)]
    assert times == sorted(times)
    assert times[0] < times[-1]


def test_no_shorter_pattern_of_the_same_kind_would_do() -> None:
    found = planned(0.3)
    shorter = found.pattern.model_copy(update={"length_m": round(found.pattern.length_m - 0.2, 1)})
    less = Judge(outlook(), ROOM.height_m).expected(shorter)
    assert less is not None
    assert less.worst_sigma_m > 0.3


def test_the_side_with_room_is_flown_to() -> None:
    assert planned(0.5, replace(ROOM, left_m=0.5)).pattern.side == "right"
    assert planned(0.5, replace(ROOM, right_m=0.5)).pattern.side == "left"


def test_with_room_on_one_side_only_it_flies_out_and_back() -> None:
    assert planned(0.25, replace(ROOM, left_m=0.0)).pattern.kind == "out-and-back"


def test_where_one_pass_is_not_enough_it_flies_several() -> None:
    assert planned(0.28, replace(ROOM, left_m=2.0, right_m=0.0)).pattern.passes > 1


def test_a_standing_target_needs_less_than_one_that_may_walk() -> None:
    standing = plan(0.3, replace(outlook(), walk_m_s=0.0), ROOM)
    assert isinstance(standing, Plan)
    assert standing.time_s < planned(0.3).time_s
    assert standing.worst_sigma_m == standing.standing_sigma_m


def test_what_cannot_be_had_comes_with_the_best_that_can_and_what_would_help() -> None:
    answer = plan(0.15, outlook(), replace(ROOM, max_time_s=12.0))
    assert isinstance(answer, Shortfall)
    assert answer.best.worst_sigma_m > 0.15
    assert answer.best.time_s <= 12.0
    assert any("distance of 4.5 m" in text for text in answer.helps)
    assert "cannot be had; the best is" in str(answer.refusal())
    nearer = plan(0.15, outlook(4.5), replace(ROOM, max_time_s=12.0))
    assert isinstance(nearer, Plan)


def test_what_nothing_helps_says_so() -> None:
    answer = plan(1e-4, outlook(), replace(ROOM, max_time_s=8.0))
    assert isinstance(answer, Shortfall)
    assert answer.helps == ()
    assert "Ask for less" in answer.refusal().remedy


@pytest.mark.parametrize(
    ("room", "distance_m", "reason"),
    [
        (replace(ROOM, left_m=0.4, right_m=0.6), 9.0, "0.6 m of room"),
        (ROOM, 1.0, "too near"),
        (replace(ROOM, max_time_s=2.0), 9.0, "fits into 2.0 s"),
        (replace(ROOM, max_speed_m_s=0.01), 9.0, "0.0 m/s"),
    ],
)
def test_no_room_is_refused_with_the_reason(room: SideRoom, distance_m: float, reason: str) -> None:
    with pytest.raises(FlightRefused, match=reason):
        plan(0.3, outlook(distance_m), room)


def test_one_picture_determines_nothing() -> None:
    with pytest.raises(EstimateRefused, match="determines"):
        plan(0.3, replace(outlook(), rate_hz=0.01), ROOM)


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf])
def test_senseless_figures_are_refused(wrong: float) -> None:
    with pytest.raises(SettingsError, match="wanted sigma"):
        plan(wrong, outlook(), ROOM)
    with pytest.raises(SettingsError, match="distance"):
        plan(0.3, outlook(wrong), ROOM)
    with pytest.raises(SettingsError, match="frame rate"):
        plan(0.3, replace(outlook(), rate_hz=wrong), ROOM)
    if wrong != 0.0:
        for room in (replace(ROOM, left_m=wrong), replace(ROOM, right_m=wrong)):
            with pytest.raises(SettingsError, match="room on the"):
                plan(0.3, outlook(), room)
        with pytest.raises(SettingsError, match="walking speed"):
            plan(0.3, replace(outlook(), walk_m_s=wrong), ROOM)
    with pytest.raises(SettingsError, match="time"):
        SideRoom.within(Bounds(), 3.0, max_time_s=wrong)


def test_the_bounds_of_a_flight_leave_time_for_what_comes_before_the_pattern() -> None:
    room = SideRoom.within(Bounds(radius_m=7.0, max_duration_s=60.0), 3.0, right_m=2.0)
    assert room == SideRoom(7.0, 2.0, 3.0, 3.0, 40.0)


def test_a_height_outside_the_bounds_is_refused() -> None:
    with pytest.raises(FlightRefused, match="outside the heights allowed"):
        SideRoom.within(Bounds(), 0.5)
    with pytest.raises(FlightRefused, match="outside the heights allowed"):
        SideRoom.within(Bounds(), 31.0)


def test_people_who_wander_need_more_baseline() -> None:
    steady = plan(0.5, outlook(), ROOM)
    wandering = plan(0.5, replace(outlook(), prior=TargetPrior()), ROOM)
    assert isinstance(steady, Plan)
    assert isinstance(wandering, Plan)
    assert wandering.pattern.length_m / wandering.time_s > steady.pattern.length_m / steady.time_s
    still_steady = Judge(replace(outlook(), prior=TargetPrior()), 3.0).expected(steady.pattern)
    assert still_steady is not None
    assert still_steady.worst_sigma_m > 1.1 * steady.worst_sigma_m
