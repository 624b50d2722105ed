"""Fly a drone past a target and estimate where the target is.

The public way in; each name is imported when it is first used. SI units, radians; positions are metres east, north, up.

>>> from mission import ESTIMATORS, FlightSightings, read_sightings
>>> for flight in read_sightings(Path("flight.jsonl")):
...     assert isinstance(flight, FlightSightings)
...     estimate = ESTIMATORS["batch"].estimate(flight)
...     print(f"{estimate.depth_m:.0f} m")
9 m
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mission.camera.camera import Camera
    from mission.camera.file import read_camera
    from mission.errors import SidestepError
    from mission.estimate import ESTIMATORS
    from mission.estimate.sightings_file import read_flights as read_sightings
    from mission.estimate.sightings_file import write_flight as write_sightings
    from mission.geodesy import ce90_m, enu_to_geodetic, geodetic_to_enu, le90_m
    from mission.planning.bound import Outlook
    from mission.planning.planner import SideRoom
    from mission.planning.planner import plan as plan_pattern
    from mission.procedure.locate import Locate
    from mission.records import (
        CameraIntrinsics,
        Estimate,
        FlightSightings,
        GeodeticOrigin,
        NoiseModel,
        Sighting,
        TargetPrior,
    )
    from mission.settings import read_settings
    from mission.vehicle.drone import Drone
    from mission.vehicle.make import make_drone

_HOMES = {
    "ESTIMATORS": "mission.estimate",
    "Camera": "mission.camera.camera",
    "CameraIntrinsics": "mission.records",
    "Drone": "mission.vehicle.drone",
    "Estimate": "mission.records",
    "FlightSightings": "mission.records",
    "GeodeticOrigin": "mission.records",
    "Locate": "mission.procedure.locate",
    "NoiseModel": "mission.records",
    "Outlook": "mission.planning.bound",
    "SideRoom": "mission.planning.planner",
    "SidestepError": "mission.errors",
    "Sighting": "mission.records",
    "TargetPrior": "mission.records",
    "ce90_m": "mission.geodesy",
    "enu_to_geodetic": "mission.geodesy",
    "geodetic_to_enu": "mission.geodesy",
    "le90_m": "mission.geodesy",
    "make_drone": "mission.vehicle.make",
    "plan_pattern": "mission.planning.planner:plan",
    "read_camera": "mission.camera.file",
    "read_settings": "mission.settings",
    "read_sightings": "mission.estimate.sightings_file:read_flights",
    "write_sightings": "mission.estimate.sightings_file:write_flight",
}

__all__ = [
    "ESTIMATORS",
    "Camera",
    "CameraIntrinsics",
    "Drone",
    "Estimate",
    "FlightSightings",
    "GeodeticOrigin",
    "Locate",
    "NoiseModel",
    "Outlook",
    "SideRoom",
    "SidestepError",
    "Sighting",
    "TargetPrior",
    "ce90_m",
    "enu_to_geodetic",
    "geodetic_to_enu",
    "le90_m",
    "make_drone",
    "plan_pattern",
    "read_camera",
    "read_settings",
    "read_sightings",
    "write_sightings",
]


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for: `sidestep --help` needs none of them."""
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, called = home.partition(":")
    value: object = getattr(importlib.import_module(module), called or name)
    globals()[name] = value
    return value
