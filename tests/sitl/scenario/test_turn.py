"""A turned scenario looks the same from the aircraft."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sitl.people.world import World
from sitl.scenario.schema import parse_scenario
from sitl.scenario.turn import turned

SCENE = """
name = "a"
[vehicle]
heading_deg = 130.0
[[people]]
distance_m = 5.0
bearing_deg = 150.0
speed_m_s = 1.0
walk_from_line_of_sight_deg = 60.0
[[people]]
distance_m = 7.0
bearing_deg = 120.0
speed_m_s = 0.8
walk_heading_deg = -170.0
[[obstacles]]
kind = "wall"
distance_m = 4.0
bearing_deg = 170.0
"""


def test_everybody_is_where_they_were_as_the_aircraft_sees_it() -> None:
    before = parse_scenario(SCENE)
    after = turned(before, -before.vehicle.heading_deg)
    assert after.vehicle.heading_deg == 0.0
    assert after.obstacles[0].bearing_deg == pytest.approx(40.0)
    angle = math.radians(130.0)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    old, new = World(before), World(after)
    for i in (0, 1):
        for t_s in (0.0, 4.0):
            place = turn @ old.person_centroid(i, t_s, 0.0)[:2]
            np.testing.assert_allclose(new.person_centroid(i, t_s, 0.0)[:2], place, atol=1e-9)
