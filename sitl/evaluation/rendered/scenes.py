"""The scenario of a case: where the person starts, who else is there, the light, and what surrounds them."""

from __future__ import annotations

import math

import numpy as np

from sitl.camera.mesh import Mesh, sun_direction
from sitl.camera.rasterizer import TriangleBatch
from sitl.evaluation.rendered.case import WALKED_S as WALKED_S
from sitl.evaluation.rendered.case import Case, drawn_person
from sitl.evaluation.rendered.crossing import crossing, walked
from sitl.people.walk import Walk
from sitl.scenario.scene import Light, Person
from sitl.scenario.schema import CameraSettings, Scenario, Vehicle, parse_scenario

TAKE_OFF_HEIGHT_M = 1.6
_LANES_M = (0.55, 1.1, 1.9)
"""How far behind the target's distance a crowd's lanes are."""
_LANE_M = 8.0
"""Length of a lane."""
_IN_LANE = 13
_PLAIN_RADIUS_M = 20.0
_PLAIN_HEIGHT_M = 40.0
_PLAIN_UP_M = 0.06
"""Over the lawn that it covers: like fresh snow, it also covers the soles."""


def scenario(case: Case) -> Scenario:
    """Everything that the renderer needs to know about a case.

    The person is at the case's distance, north of the drone turned by the seed's bearing, when the pattern begins.
    """
    rng = np.random.default_rng([case.seed, 3])
    bearing_deg = float(rng.uniform(-180.0, 180.0))
    table = f"""name = "rendered"
seed = {case.seed % 2**31}
scenery = {str(case.scene != "featureless").lower()}
"""
    base = parse_scenario(table)
    night = case.scene == "night"
    camera = CameraSettings.model_validate(
        {
            "width_px": case.size_px[0],
            "height_px": case.size_px[1],
            "horizontal_fov_deg": 63.56,
            "distortion": {"k1": -0.06, "k2": 0.012, "p1": 0.0004, "p2": -0.0003},
            "tilt_down_deg": float(rng.uniform(5.0, 12.0)),
            "position_body_m": (0.10, 0.0, 0.03),
            "exposure_ms": 25.0 if night else 8.0,
            "readout_ms": 16.0,
            "noise_grey": 9.0 if night else 2.5,
            "exposure_wander": 0.06,
            "renderings": case.renderings,
        }
    )
    light = Light(
        brightness=0.3 if night else float(rng.uniform(0.7, 1.2)), sun_azimuth_deg=float(rng.uniform(-180.0, 180.0))
    )
    facing_deg = float(rng.uniform(-180.0, 180.0))
    target = _target(case, bearing_deg, facing_deg)
    if case.scene == "crossing":
        target, passer = crossing(case, target, bearing_deg, rng)
        people: tuple[Person, ...] = (target, passer)
    else:
        people = (target, *_crowd(case, bearing_deg, rng))
    # A crowd has more people than a scenario's file may name, so the parts are put together here.
    return base.model_copy(
        update={
            "vehicle": Vehicle(heading_deg=0.0, take_off_height_m=TAKE_OFF_HEIGHT_M),
            "camera": camera,
            "light": light,
            "people": people,
        }
    )


def surroundings(case: Case, made: Scenario) -> list[TriangleBatch]:
    """What stands around beside the scenario's own scenery.

    Featureless: ground and sky of one grey each (snow under an overcast sky), with nothing but the horizon between.
    """
    if case.scene != "featureless":
        return []
    white = np.full((2, 2, 3), 255, np.uint8)
    mesh = Mesh(lambda: white, sun_direction(made.light))
    around = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = _PLAIN_RADIUS_M * np.stack([np.sin(around), np.cos(around)], 1)
    radii = np.array([0.0, 2.0, 4.0, 6.0, 8.0, 11.0, 15.0, 20.0]) / _PLAIN_RADIUS_M
    ground = np.concatenate([np.column_stack([r * ring, np.full(len(ring), _PLAIN_UP_M)]) for r in radii])
    ups = np.linspace(_PLAIN_UP_M, _PLAIN_HEIGHT_M, 9)
    wall = np.concatenate([np.column_stack([ring, np.full(len(ring), up)]) for up in ups])
    for vertices, rows, grey in ((ground, len(radii), 0.62), (wall, len(ups), 0.70)):
        mesh.add(vertices, _strips(rows, len(ring)), np.zeros((len(vertices), 2)), np.full((len(vertices), 3), grey))
    batch = mesh.batch()
    assert batch is not None
    return [batch]


def _strips(rows: int, columns: int) -> np.ndarray[tuple[int, int], np.dtype[np.int32]]:
    """(T, 3): triangles between rows of vertices."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    below = first + columns
    return np.concatenate([np.stack([first, first + 1, below + 1], 1), np.stack([first, below + 1, below], 1)]).astype(
        np.int32
    )


def _target(case: Case, bearing_deg: float, facing_deg: float) -> Person:
    """The person, begun so much earlier on their way."""
    bearing = math.radians(bearing_deg)
    place = case.distance_m * np.array([math.sin(bearing), math.cos(bearing)])
    heading_deg = facing_deg
    if case.walks is not None:
        heading_deg = (bearing_deg + (case.walk_deg or 0.0) + 180.0) % 360.0 - 180.0
        walk = Walk(drawn_person(case, heading_deg))
        begun, later = walk.at(0.0), walk.at(WALKED_S)
        place -= [later.east_m - begun.east_m, later.north_m - begun.north_m]
    elif case.walk_deg is not None:
        heading_deg = (bearing_deg + case.walk_deg + 180.0) % 360.0 - 180.0
        place -= walked(0.0, case.speed_m_s, math.radians(heading_deg))
    return Person(
        distance_m=float(np.hypot(*place)),
        bearing_deg=math.degrees(math.atan2(place[0], place[1])),
        speed_m_s=0.0 if case.walk_deg is None or case.walks is not None else case.speed_m_s,
        walks=case.walks,
        walk_seed=case.seed % 2**31,
        walk_heading_deg=heading_deg,
        height_m=case.height_m,
        build=case.build,
        stride=case.stride,
    )


def _crowd(case: Case, bearing_deg: float, rng: np.random.Generator) -> list[Person]:
    """People who cross behind the target, in lanes, to and fro."""
    if case.scene != "crowd":
        return []
    bearing = math.radians(bearing_deg)
    ahead = np.array([math.sin(bearing), math.cos(bearing)])
    right = np.array([math.cos(bearing), -math.sin(bearing)])
    crowd = []
    for lane in _LANES_M:
        way = 1.0 if rng.uniform() < 0.5 else -1.0
        speed_m_s = float(rng.uniform(0.4, 0.9))
        for k in range(_IN_LANE):
            across_m = _LANE_M * ((k + float(rng.uniform(0.2, 0.8))) / _IN_LANE - 0.5) - way * speed_m_s * WALKED_S
            place = (case.distance_m + lane + float(rng.uniform(-0.15, 0.15))) * ahead + across_m * right
            crowd.append(
                Person(
                    distance_m=float(np.hypot(*place)),
                    bearing_deg=math.degrees(math.atan2(place[0], place[1])),
                    speed_m_s=speed_m_s * float(rng.uniform(0.9, 1.1)),
                    walk_heading_deg=(bearing_deg + 90.0 * way + 180.0) % 360.0 - 180.0,
                    height_m=float(rng.uniform(1.55, 1.9)),
                )
            )
    return crowd
