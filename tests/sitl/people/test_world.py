"""Where people are: the walk of the scenario, the body on it, and the point that estimates are scored against."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mission.errors import SettingsError
from sitl.people.walk import START_S, Walk
from sitl.people.world import World
from sitl.scenario.schema import Scenario, parse_scenario


def one(extra: str, distance: float = 5.0, bearing: float = 30.0) -> Scenario:
    return parse_scenario(f'name = "a"\n[[people]]\ndistance_m = {distance}\nbearing_deg = {bearing}\n{extra}')


def test_the_centroid_starts_at_the_distance_and_bearing_of_the_scenario() -> None:
    world = World(one("speed_m_s = 0.6\nwalk_from_line_of_sight_deg = 70.0"))
    east, north, up = world.person_centroid(0, 0.0, None)
    assert math.hypot(east, north) == pytest.approx(5.0, abs=0.03)
    assert math.degrees(math.atan2(east, north)) == pytest.approx(30.0, abs=0.4)
    assert 0.8 < up < 0.95


def test_nobody_walks_before_the_start() -> None:
    world = World(one("speed_m_s = 0.6"))
    np.testing.assert_allclose(world.person_velocity(0, 9.0, None), 0.0)
    np.testing.assert_allclose(world.person_velocity(0, 9.0, 10.0), 0.0)
    assert world.person_velocity(0, 12.0, 10.0) @ world.person_velocity(0, 12.0, 10.0) == pytest.approx(0.36)


def test_the_centroid_moves_with_the_walk() -> None:
    """Over whole strides the body's small motions cancel."""
    world = World(one("speed_m_s = 0.6\nwalk_heading_deg = 90.0"))
    stride_s = 0.966954 / 0.6
    moved = world.person_centroid(0, 3.0 + 2.0 * stride_s, 0.0) - world.person_centroid(0, 3.0, 0.0)
    np.testing.assert_allclose(moved, [2.0 * 0.966954, 0.0, 0.0], atol=2e-3)


@pytest.mark.parametrize(
    ("direction", "radial", "right"), [(0.0, 1.0, 0.0), (180.0, -1.0, 0.0), (90.0, 0.0, 1.0), (-90.0, 0.0, -1.0)]
)
def test_directions_are_as_the_drone_sees_them(direction: float, radial: float, right: float) -> None:
    walk = Walk(one(f"speed_m_s = 1.0\nwalk_from_line_of_sight_deg = {direction}").people[0])
    east, north, _ = walk.at(5.0).velocity_enu_m_s
    s, c = math.sin(math.radians(30.0)), math.cos(math.radians(30.0))
    assert east * s + north * c == pytest.approx(radial, abs=1e-9)
    assert east * c - north * s == pytest.approx(right, abs=1e-9)


def test_a_walk_stops_and_turns_when_the_scenario_says() -> None:
    person = one(
        "speed_m_s = 1.0\nwalk_heading_deg = 0.0\nstop_after_s = 8.0\nturns = [{ after_s = 3.0, by_deg = 90.0 }]"
    ).people[0]
    walk = Walk(person)
    assert walk.at(2.0).velocity_enu_m_s == pytest.approx((0.0, 1.0, 0.0))
    assert walk.at(5.0).velocity_enu_m_s == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
    assert walk.at(9.0).speed_m_s == 0.0
    assert walk.at(60.0).east_m == pytest.approx(walk.at(9.0).east_m)


def test_a_walk_goes_on_beyond_its_last_event() -> None:
    walk = Walk(one("speed_m_s = 0.6\nwalk_heading_deg = 180.0").people[0])
    way = walk.at(100.0).north_m - walk.at(50.0).north_m
    assert way == pytest.approx(-30.0)
    assert walk.at(START_S).speed_m_s == pytest.approx(0.6, abs=0.01)


def test_people_who_wait_for_the_drone_and_people_who_do_not() -> None:
    text = 'name = "a"\n' + "".join(
        f"[[people]]\ndistance_m = 5.0\nbearing_deg = {b}\nspeed_m_s = 0.6\n{start}\n"
        for b, start in ((0.0, 'when = "drone-moves"'), (20.0, 'at = "start"'))
    )
    world = World(parse_scenario(text))
    assert world.waits_for_drone
    assert np.linalg.norm(world.person_velocity(0, 5.0, None, 0.0)) == 0.0
    assert np.linalg.norm(world.person_velocity(1, 5.0, None, 0.0)) == pytest.approx(0.6)


def test_people_are_as_tall_as_the_scenario_says() -> None:
    for height in (1.5, 1.95):
        surface = World(one(f"height_m = {height}")).person_surface(0, 0.0, None)
        assert np.ptp(surface[:, 2]) == pytest.approx(height, rel=0.012)
        assert abs(surface[:, 2].min()) < 0.006


def test_a_real_like_walk_is_neither_straight_nor_even_and_its_velocity_is_that_of_its_places() -> None:
    walk = Walk(one('walks = "wandering"\nwalk_seed = 5').people[0])
    t = np.arange(0.0, 12.0, 0.01)
    footings = [walk.at(float(at_s)) for at_s in t]
    places = np.array([[f.east_m, f.north_m] for f in footings])
    velocities = np.array([f.velocity_enu_m_s[:2] for f in footings])
    moved = np.cumsum(velocities, axis=0) * 0.01
    assert np.abs(moved - (places - places[0])).max() < 0.05
    assert np.ptp([f.speed_m_s for f in footings[100:]]) > 0.1
    assert np.ptp([f.heading_rad for f in footings[100:]]) > 0.05
    assert footings[0].speed_m_s == 0.0


def test_who_crouches_is_lower() -> None:
    world = World(one('walks = "crouching"\nwalk_seed = 2'))
    ups = [float(world.person_centroid(0, t, 0.0)[2]) for t in np.arange(0.0, 120.0, 1.0)]
    assert min(ups) < 0.8 * max(ups)


def test_a_drawn_walk_and_turns_of_the_scenario_exclude_each_other() -> None:
    with pytest.raises(SettingsError, match="walks draws speed"):
        one('walks = "real-like"\nspeed_m_s = 1.0')
