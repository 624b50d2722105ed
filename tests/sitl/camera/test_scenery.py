"""The scenery keeps out of the way, and is the same for the same seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import sitl
from sitl.camera.scenery import scenery
from sitl.people.world import World
from sitl.scenario.schema import Scenario, read_scenario

SCENARIOS = Path(sitl.__file__).parent / "scenarios"


def heights_above_ground(scenario: Scenario, low: float) -> np.ndarray:
    vertices = np.concatenate([batch.vertices for batch in scenery(scenario) if not batch.sky])
    return np.asarray(vertices[vertices[:, 2] > low])


def test_nothing_stands_between_the_drone_and_a_person() -> None:
    scenario = read_scenario(SCENARIOS / "demo.toml")
    world = World(scenario)
    solid = heights_above_ground(scenario, 0.05)
    for t_s in np.arange(0.0, 12.0, 1.0):
        person = world.person_centroid(0, t_s, 0.0)[:2]
        for drone in (np.zeros(2), np.array([-3.0, 1.0]), np.array([3.0, -1.0])):
            along = np.linspace(0.0, 1.0, 40)[:, None] * (person - drone) + drone
            gaps = np.linalg.norm(solid[:, None, :2] - along[None], axis=2)
            assert gaps.min() > 1.0


def test_an_obstacle_stands_where_the_scenario_says() -> None:
    scenario = read_scenario(SCENARIOS / "occlusion.toml").model_copy(update={"scenery": False})
    wall = heights_above_ground(scenario, 0.05)
    middle = 0.5 * (wall.min(axis=0) + wall.max(axis=0))
    assert abs(np.hypot(middle[0], middle[1]) - 6.1) < 0.05
    assert abs(np.degrees(np.arctan2(middle[0], middle[1])) - 38.0) < 0.5
    assert abs(wall[:, 2].max() - 2.3) < 1e-9


def test_the_seed_decides() -> None:
    scenario = read_scenario(SCENARIOS / "demo.toml")
    one, again = scenery(scenario), scenery(scenario)
    other = scenery(scenario.model_copy(update={"seed": 8}))
    for a, b in zip(one, again, strict=True):
        np.testing.assert_array_equal(a.vertices, b.vertices)
        np.testing.assert_array_equal(a.texture, b.texture)
    assert len(other) != len(one) or any(len(a.vertices) != len(b.vertices) for a, b in zip(one, other, strict=True))
