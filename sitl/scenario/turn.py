"""A scenario turned about the vertical: for an aircraft that cannot be told which way to face at the start."""

from __future__ import annotations

from sitl.scenario.scene import Person
from sitl.scenario.schema import Scenario


def turned(scenario: Scenario, by_deg: float) -> Scenario:
    """The same scene with everything, sun, wind and aircraft included, at bearings larger by an angle."""

    def bearing(old_deg: float) -> float:
        return (old_deg + by_deg + 180.0) % 360.0 - 180.0

    def person(old: Person) -> Person:
        walk = None if old.walk_heading_deg is None else bearing(old.walk_heading_deg)
        return old.model_copy(update={"bearing_deg": bearing(old.bearing_deg), "walk_heading_deg": walk})

    light, wind, vehicle, wall = scenario.light, scenario.autopilot, scenario.vehicle, scenario.marker_wall
    return scenario.model_copy(
        update={
            "people": tuple(map(person, scenario.people)),
            "obstacles": tuple(
                old.model_copy(update={"bearing_deg": bearing(old.bearing_deg)}) for old in scenario.obstacles
            ),
            "marker_wall": wall and wall.model_copy(update={"bearing_deg": bearing(wall.bearing_deg)}),
            "light": light.model_copy(update={"sun_azimuth_deg": bearing(light.sun_azimuth_deg)}),
            "autopilot": wind.model_copy(update={"wind_from_deg": bearing(wind.wind_from_deg)}),
            "vehicle": vehicle.model_copy(update={"heading_deg": bearing(vehicle.heading_deg)}),
        }
    )
