"""Shadows: where the sun does not reach, all equally dark, and the same from picture to picture."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from mission.records import Vector
from sitl.camera.airframe import body_from_camera, level_world_from_body_wxyz
from sitl.camera.lens import project
from sitl.camera.mesh import sun_direction
from sitl.camera.renderer import CameraPose, Renderer, matrix_from_wxyz
from sitl.camera.shadows import Cast, Shadows
from sitl.people.body import Body
from sitl.people.world import World
from sitl.scenario.scene import Light
from sitl.scenario.schema import parse_scenario

PERSON = "[[people]]\ndistance_m = 6.0\nbearing_deg = 0.0\n"
SUNNY = """name = "a"
scenery = false
[camera]
noise_grey = 0.0
exposure_wander = 0.0
[light]
sun_azimuth_deg = 90.0
sun_elevation_deg = 40.0
"""
DARK = 110


@pytest.fixture(scope="module")
def world() -> World:
    return World(parse_scenario(f'name = "a"\n{PERSON}'))


@pytest.fixture(scope="module")
def body(world: World) -> Body:
    return world.body


@pytest.fixture(scope="module")
def surface(world: World) -> Vector:
    return world.person_surface(0, 0.0, 0.0)


def sun_at(elevation_deg: float) -> Vector:
    return sun_direction(Light(sun_elevation_deg=elevation_deg))


def thrown(surface: Vector, sun: Vector) -> Vector:
    """(V, 2): where the rays through a surface's vertices meet the ground."""
    return np.asarray((surface - surface[:, 2:] / sun[2] * sun)[:, :2])


def darkness(cast: Cast, places: Vector) -> Vector:
    """Of the texels at some places (n, 2), east and north."""
    corner, span = cast.sheet[:, :2].min(axis=0), np.ptp(cast.sheet[:, 0])
    texel = np.floor((places - corner) / span * len(cast.picture)).astype(int)
    return np.asarray(cast.picture[texel[:, 1], texel[:, 0]])


@pytest.mark.parametrize("elevation_deg", [15.0, 40.0, 75.0])
def test_it_is_dark_where_the_sun_does_not_reach_and_only_there(
    body: Body, surface: Vector, elevation_deg: float
) -> None:
    sun = sun_at(elevation_deg)
    cast = Shadows(body, 1, sun).cast([surface])
    places = thrown(surface, sun)
    assert np.mean(darkness(cast, places) >= 0.5 * DARK) > 0.97
    corner, span = cast.sheet[:, :2].min(axis=0), np.ptp(cast.sheet[:, 0])
    hull = cv2.convexHull(((places - corner) / span * len(cast.picture)).astype(np.float32))
    outside = np.full(cast.picture.shape, 255, np.uint8)
    cv2.fillConvexPoly(outside, np.rint(hull).astype(np.int32), 0)
    assert cast.picture[cv2.erode(outside, np.ones((9, 9))) > 0].max() == 0


def test_inside_it_is_of_one_darkness(body: Body, surface: Vector) -> None:
    picture = Shadows(body, 1, sun_at(40.0)).cast([surface]).picture
    inside = cv2.erode((picture > 0).astype(np.uint8), np.ones((7, 7))) > 0
    assert inside.sum() > 300
    assert np.mean(picture[inside] == DARK) > 0.98


def test_shadows_that_meet_do_not_add_up(body: Body, surface: Vector) -> None:
    shadows = Shadows(body, 2, sun_at(40.0))
    assert np.array_equal(shadows.cast([surface, surface]).picture, shadows.cast([surface]).picture)


def test_a_shadow_that_moves_by_whole_texels_keeps_its_shape(body: Body, surface: Vector) -> None:
    shadows = Shadows(body, 1, sun_at(40.0))
    one, other = shadows.cast([surface]), shadows.cast([np.add(surface, [0.4, -0.2, 0.0])])
    assert np.mean(one.picture != other.picture) < 0.002  # what lay on the edge of a texel
    assert np.allclose(other.sheet - one.sheet, [0.4, -0.2, 0.0], atol=0.021)


def test_people_far_apart_have_room_in_it(body: Body, surface: Vector) -> None:
    sun = sun_at(40.0)
    far = np.add(surface, [18.0, -9.0, 0.0])
    cast = Shadows(body, 2, sun).cast([surface, far])
    for one in (surface, far):
        assert np.mean(darkness(cast, thrown(one, sun)) >= 0.5 * DARK) > 0.95


def test_in_the_picture_it_is_where_the_projection_says() -> None:
    bare, made = (parse_scenario(SUNNY + people) for people in ("", PERSON))
    rotation = matrix_from_wxyz(level_world_from_body_wxyz(0.0)) @ body_from_camera(math.radians(15.0))
    pose = CameraPose(np.array([0.0, 0.0, 3.0]), rotation)
    pictures = []
    for scene in (made, bare):
        renderer = Renderer(scene)
        pictures.append(renderer.expose(lambda _: pose, 0.0, None).astype(float).sum(axis=2))
        renderer.close()
    ratio = pictures[0] / pictures[1]
    trunk = World(made).person_surface(0, 0.0, None)
    trunk = trunk[(trunk[:, 2] > 0.55 * trunk[:, 2].max()) & (trunk[:, 2] < 0.75 * trunk[:, 2].max())]
    places = thrown(trunk, sun_direction(made.light)).mean(axis=0)
    column, row = project(
        ((np.append(places, 0.0) - pose.position_enu_m) @ pose.world_from_camera)[None], made.camera.intrinsics
    )[0].astype(int)
    assert ratio[row, column] == pytest.approx(1.0 - DARK / 255.0, abs=0.03)
    for beside in ((row, column - 80), (row - 15, column), (row + 15, column)):
        assert ratio[beside] == pytest.approx(1.0, abs=0.03)
