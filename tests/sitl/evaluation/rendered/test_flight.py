"""A rendered flight: flown as the mission flies, reported as the autopilot reports, seen as the camera sees."""

from __future__ import annotations

import itertools
import math

import cv2
import numpy as np
import pytest

from mission.pose.buffer import heading
from mission.records import Image, Vector
from sitl.camera.renderer import CameraPose, Renderer
from sitl.evaluation.rendered import Case, RenderedFlight, SceneName, drawn_cases
from sitl.evaluation.rendered.aircraft import TURN_S
from sitl.evaluation.rendered.codec import H264
from sitl.evaluation.rendered.scenes import scenario, surroundings
from sitl.scenario.schema import CameraSettings


@pytest.fixture(scope="module")
def exact() -> RenderedFlight:
    """An autopilot that knows its pose."""
    return RenderedFlight(Case(seed=4, noise="none", walk_deg=90.0, offset_s=0.12))


@pytest.fixture(scope="module")
def rough() -> RenderedFlight:
    return RenderedFlight(Case(seed=4, noise="rough", walk_deg=90.0))


def _heading_errors(flight: RenderedFlight) -> Vector:
    errors = []
    for t_s in np.arange(0.0, flight.duration_s, 0.1):
        pose = flight.pose_at(float(t_s))
        assert pose is not None
        off = heading(pose.world_from_body_wxyz) - heading(flight.true_pose(float(t_s)).world_from_body_wxyz)
        errors.append(math.remainder(off, math.tau))
    return np.array(errors)


def test_the_drawn_cases_do_not_depend_on_how_many_are_drawn() -> None:
    many = list(drawn_cases(6, seed=3, noise="rough"))
    assert list(drawn_cases(2, seed=3, noise="rough", first=4)) == many[4:]
    assert len({case.seed for case in many}) == 6
    assert {case.noise for case in many} == {"rough"}


def test_the_person_is_at_the_distance_asked_for_when_the_pattern_begins(exact: RenderedFlight) -> None:
    assert math.hypot(*exact.target(0.0)[:2]) == pytest.approx(5.5, abs=0.08)
    assert np.linalg.norm(exact.target_velocity(0.0)) == pytest.approx(0.6)


def test_the_aircraft_flies_out_and_back_with_its_nose_on_the_person(exact: RenderedFlight) -> None:
    times = np.arange(0.0, exact.duration_s, 0.1)
    away = [math.hypot(*exact.true_pose(float(t)).position_enu_m[:2]) for t in times]
    assert max(away) == pytest.approx(3.0, abs=0.4)
    assert away[-1] < 0.6
    for t in times:
        camera = exact.true_camera(float(t))
        seen = camera.world_from_camera.T @ (exact.target(float(t)) - camera.position_enu_m)
        assert abs(math.atan2(seen[0], seen[2])) < math.radians(12.0)


def test_an_exact_autopilot_reports_the_truth_to_the_units_of_its_messages(exact: RenderedFlight) -> None:
    assert np.abs(_heading_errors(exact)).max() < math.radians(0.2)
    for t in np.arange(0.0, exact.duration_s, 0.1):
        told = exact.pose_at(float(t))
        assert told is not None
        assert np.abs(told.position_enu_m - exact.true_pose(float(t)).position_enu_m).max() < 0.02


def test_a_rough_autopilot_s_heading_wanders_by_degrees(rough: RenderedFlight) -> None:
    assert np.degrees(_heading_errors(rough).std()) > 0.5
    assert rough.noise.heading_sigma_rad == pytest.approx(math.radians(2.0))


def test_nothing_is_reported_before_the_flight_or_after_it(exact: RenderedFlight) -> None:
    assert exact.pose_at(-60.0) is None
    assert exact.pose_at(exact.duration_s + 0.5) is not None
    with pytest.raises(ValueError, match="no time"):
        exact.true_pose(60.0)


def test_frames_come_on_the_video_s_clock_and_show_the_person_where_they_are(exact: RenderedFlight) -> None:
    moments = list(itertools.islice(exact.moments(turn=False), 3))
    assert [m.capture_s for m in moments] == pytest.approx([0.0, 0.05, 0.1])
    assert [m.frame.t_s for m in moments] == pytest.approx([0.12, 0.17, 0.22])
    assert {m.stage for m in moments} == {"pattern"}
    target = moments[0].target
    assert target is not None
    assert target.in_picture
    box = target.box
    body = moments[0].frame.image[int(box.top_px) : int(box.bottom_px), int(box.left_px) : int(box.right_px)]
    beside = moments[0].frame.image[int(box.top_px) : int(box.bottom_px), :60]
    assert abs(float(body.mean()) - float(beside.mean())) > 10.0


def test_the_flight_begins_with_a_turn_to_the_person(exact: RenderedFlight) -> None:
    nose = [heading(exact.true_pose(t).world_from_body_wxyz) for t in (-TURN_S, 0.0)]
    assert abs(math.remainder(nose[1] - nose[0], math.tau)) > math.radians(10.0)


def test_the_same_case_gives_the_same_flight(rough: RenderedFlight) -> None:
    again = RenderedFlight(rough.case)
    assert again.scenario == rough.scenario
    for t in (-1.0, 0.5, 4.0):
        one, other = again.pose_at(t), rough.pose_at(t)
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.position_enu_m, other.position_enu_m)
        np.testing.assert_array_equal(one.world_from_body_wxyz, other.world_from_body_wxyz)


def _picture(scene: SceneName) -> Image:
    """A small picture of a scene, from where the drone hovers."""
    made = Case(seed=7, scene=scene, noise="none", size_px=(320, 240))
    shown = scenario(made)
    renderer = Renderer(shown, extra=surroundings(made, shown))
    azimuth = math.radians(shown.people[0].bearing_deg)
    east, north = math.sin(azimuth), math.cos(azimuth)
    looking = np.stack([np.array([north, -east, 0.0]), np.array([0.0, 0.0, -1.0]), np.array([east, north, 0.0])], 1)
    try:
        return renderer.expose(lambda _: CameraPose(np.array([0.0, 0.0, 1.6]), looking), 0.0, None)
    finally:
        renderer.close()


def _corners(image: Image) -> int:
    strength = cv2.cornerMinEigenVal(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), 5)
    return int(np.count_nonzero(strength[:, :110] > 1e-3))


def test_a_featureless_scene_has_hardly_a_corner_beside_the_person() -> None:
    street = _corners(_picture("street"))
    assert street > 50
    assert _corners(_picture("featureless")) < 0.05 * street


def test_at_night_the_picture_is_dark() -> None:
    assert _picture("night").mean() < 0.6 * _picture("street").mean()


def test_a_crowd_has_people_all_around_the_target_who_cross() -> None:
    case = next(iter(drawn_cases(1, seed=2, scene="crowd")))
    people = scenario(case).people
    assert len(people) > 30
    target, others = people[0], people[1:]
    assert min(person.distance_m for person in others) > target.distance_m
    assert len({round(person.heading_rad, 3) for person in others}) <= 2


def test_each_picture_comes_back_from_the_codec_at_once_and_a_little_changed() -> None:
    codec = H264(CameraSettings(width_px=160, height_px=120))
    rng = np.random.default_rng(0)
    smooth = np.asarray(cv2.GaussianBlur(rng.uniform(0.0, 255.0, (120, 160, 3)), (0, 0), 4.0))
    picture = (30.0 + 190.0 * (smooth - smooth.min()) / np.ptp(smooth)).astype(np.uint8)
    for shift in range(5):
        sent = np.roll(picture, 3 * shift, axis=1)
        got = codec.through(sent)
        error = np.abs(got.astype(float) - sent)
        assert 0.0 < error.mean() < 4.0
