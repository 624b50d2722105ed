"""Pictures: things appear where the projection says, whatever the lens, the tilt, the shutter and the motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mission.records import Image, Vector
from sitl.camera.airframe import body_from_camera, level_world_from_body_wxyz
from sitl.camera.lens import project, undistort
from sitl.camera.rasterizer import TriangleBatch
from sitl.camera.renderer import CameraPose, Renderer, matrix_from_wxyz
from sitl.camera.view import view_person
from sitl.scenario.schema import Scenario, parse_scenario

LENS = (
    "distortion = { k1 = -0.12, k2 = 0.03, p1 = 0.001, p2 = -0.0008 }\nfx = 500.0\nfy = 505.0\ncx = 326.0\ncy = 235.0\n"
)
QUIET = "noise_grey = 0.0\nexposure_wander = 0.0\n"
PIXELS = np.array([[x, y] for x in (60.0, 200.3, 320.0, 470.7, 585.0) for y in (50.0, 180.4, 300.0, 430.0)])
DEPTH_M = 6.0


def scenario(camera: str, people: str = "") -> Scenario:
    return parse_scenario(f'name = "a"\nscenery = false\n[camera]\n{QUIET}{camera}\n{people}')


def pose(heading: float = 0.0, tilt: float = 0.0, height_m: float = 8.0) -> CameraPose:
    rotation = matrix_from_wxyz(level_world_from_body_wxyz(heading)) @ body_from_camera(tilt)
    return CameraPose(np.array([0.5, -0.3, height_m]), rotation)


def marker(place: Vector, view: CameraPose) -> TriangleBatch:
    """A white square of about 12 px that faces the camera."""
    right, down = 0.07 * view.world_from_camera[:, 0], 0.07 * view.world_from_camera[:, 1]
    corners = np.array([place - right - down, place + right - down, place + right + down, place - right + down])
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    white = np.full((8, 8, 3), 255, np.uint8)
    return TriangleBatch(corners, triangles, np.zeros((4, 2)), np.full((4, 4), 255, np.uint8), white)


def places(view: CameraPose, settings: Scenario) -> Vector:
    ideal = undistort(PIXELS, settings.camera.intrinsics)
    return view.position_enu_m + DEPTH_M * np.column_stack([ideal, np.ones(len(ideal))]) @ view.world_from_camera.T


def found(picture: Image, background: Image, near: Vector) -> Vector:
    """Centre of what is white in `picture` and not in `background`, within 18 px of a place."""
    low = np.maximum(0, np.round(near).astype(int) - 18)
    window = np.s_[low[1] : low[1] + 37, low[0] : low[0] + 37]
    before, after = background[window][:, :, 1].astype(float), picture[window][:, :, 1].astype(float)
    cover = np.clip((after - before) / np.maximum(20.0, 255.0 - before), 0.0, 1.0)
    cover[cover < 0.1] = 0.0
    rows, columns = np.mgrid[0 : cover.shape[0], 0 : cover.shape[1]] + 0.5
    assert cover.sum() > 50.0
    return np.asarray(np.array([(cover * columns).sum(), (cover * rows).sum()]) / cover.sum() + low)


def pictures(settings: Scenario, view: CameraPose, motion: Callable[[float], CameraPose]) -> tuple[Image, Image]:
    """With and without markers, taken during a motion."""
    both = []
    for extra in ([marker(place, view) for place in places(view, settings)], []):
        renderer = Renderer(settings, extra=extra)
        both.append(renderer.expose(motion, 0.0, None))
        renderer.close()
    return both[0], both[1]


@pytest.mark.parametrize("camera", ["", LENS], ids=["pinhole", "distorted"])
@pytest.mark.parametrize("tilt_deg", [0.0, 12.0])
def test_markers_appear_where_the_projection_says(camera: str, tilt_deg: float) -> None:
    settings, view = scenario(camera + "exposure_ms = 0.0\n"), pose(heading=0.7, tilt=np.radians(tilt_deg))
    picture, background = pictures(settings, view, lambda _: view)
    errors = np.array([found(picture, background, pixel) - pixel for pixel in PIXELS])
    assert np.abs(errors).max() < 0.5
    assert np.abs(errors.mean(axis=0)).max() < 0.12


def test_projection_and_its_inverse_agree() -> None:
    camera = scenario(LENS).camera.intrinsics
    ideal = undistort(PIXELS, camera)
    np.testing.assert_allclose(project(np.column_stack([ideal, np.ones(len(ideal))]), camera), PIXELS, atol=1e-6)


def moving(view: CameraPose, velocity: Vector, yaw_rate: float) -> Callable[[float], CameraPose]:
    def at(t_s: float) -> CameraPose:
        c, s = np.cos(yaw_rate * t_s), np.sin(yaw_rate * t_s)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return CameraPose(view.position_enu_m + velocity * t_s, turn @ view.world_from_camera)

    return at


@pytest.mark.parametrize(("velocity", "yaw_rate"), [((2.0, 0.0, 0.0), 0.0), ((0.0, 0.0, 0.0), 0.8)])
def test_each_row_is_seen_at_its_own_time(velocity: tuple[float, float, float], yaw_rate: float) -> None:
    readout_s = 0.030
    settings, view = scenario("exposure_ms = 0.0\nreadout_ms = 30.0\n"), pose(tilt=np.radians(8.0))
    motion = moving(view, np.array(velocity), yaw_rate)
    picture, background = pictures(settings, view, motion)
    shifts = []
    for pixel, place in zip(PIXELS, places(view, settings), strict=True):
        then = motion((pixel[1] / 480.0 - 0.5) * readout_s)
        seen = ((place - then.position_enu_m) @ then.world_from_camera)[None, :]
        expected = project(seen, settings.camera.intrinsics)[0]
        shifts.append(expected[0] - pixel[0])
        assert np.abs(found(picture, background, expected) - expected).max() < 0.6
    assert np.ptp(shifts) > 3.0


def test_motion_blurs_along_the_motion_and_leaves_the_middle() -> None:
    settings, view = scenario("exposure_ms = 20.0\n"), pose()
    picture, background = pictures(settings, view, moving(view, np.array([8.0, 0.0, 0.0]), 0.0))
    still, plain = pictures(settings, view, lambda _: view)
    pixel = PIXELS[11]  # white on dark grass
    assert np.abs(found(picture, background, pixel) - pixel).max() < 0.5
    row = int(pixel[1])
    columns = np.s_[int(pixel[0]) - 18 : int(pixel[0]) + 19]

    def width(image: Image, empty: Image) -> int:
        return int((np.abs(image[row, columns, 1].astype(int) - empty[row, columns, 1]) > 20).sum())

    assert width(picture, background) >= width(still, plain) + 4


PERSON = """
[[people]]
distance_m = 5.0
bearing_deg = 4.0
speed_m_s = 0.6
walk_from_line_of_sight_deg = 90.0
clothes = { shirt = "#ff00ff", trousers = "#ff00ff", hair = "#ff00ff", skin = "#ff00ff" }
"""


@pytest.fixture(scope="module")
def stage() -> Renderer:
    return Renderer(scenario(LENS + "exposure_ms = 0.0\n", PERSON))


@pytest.mark.parametrize("t_s", [0.5, 2.0, 3.3])
def test_a_person_fills_the_box_that_the_truth_says(stage: Renderer, t_s: float) -> None:
    view = pose(tilt=np.radians(8.0), height_m=1.6)
    picture = stage.expose(lambda _: view, t_s, 0.0).astype(int)
    truth = view_person(stage.world, 0, view, stage.camera, t_s, 0.0)
    assert truth is not None
    assert truth.in_picture
    magenta = np.minimum(picture[:, :, 0], picture[:, :, 2]) - picture[:, :, 1] > 60
    rows, columns = np.flatnonzero(magenta.any(axis=1)), np.flatnonzero(magenta.any(axis=0))
    assert rows[0] == pytest.approx(truth.box.top_px, abs=1.5)
    assert rows[0] < truth.pixel[1] < rows[-1]
    assert columns[0] < truth.pixel[0] < columns[-1] + 1
    # The silhouette's middle and the surface's centroid differ by the body's own shape only.
    _, x = np.nonzero(magenta)
    assert x.mean() + 0.5 == pytest.approx(truth.pixel[0], abs=0.03 * truth.height_px)


def test_the_same_moment_gives_the_same_picture(stage: Renderer) -> None:
    view = pose(height_m=1.6)
    np.testing.assert_array_equal(stage.expose(lambda _: view, 1.0, 0.0), stage.expose(lambda _: view, 1.0, 0.0))


def test_who_is_behind_the_camera_has_no_view(stage: Renderer) -> None:
    assert view_person(stage.world, 0, pose(heading=np.pi), stage.camera, 0.0, 0.0) is None
