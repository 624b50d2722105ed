"""Somebody so near that the picture cuts them off, in the AR.Drone's flat picture: the track begins on all of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

import sitl
from mission.detect import NanoDetDetector
from mission.detect.nanodet import NanoDet
from mission.pose.buffer import world_from_body
from mission.records import Frame, Image
from mission.track import Tracker
from mission.video.square import square_camera
from sitl.camera.airframe import body_from_camera
from sitl.camera.renderer import CameraPose, Renderer, matrix_from_wxyz
from sitl.camera.view import PersonView, view_person
from sitl.scenario.schema import read_scenario
from sitl.simulation.processes import camera_of

NEAR = Path(sitl.__file__).parent / "scenarios" / "ardrone" / "stationary-2-75.toml"


@cache
def picture(
    seed: int, tilt_rad: tuple[float, float], aside_rad: float, height_m: float, back_m: float = 0.0
) -> tuple[Image, PersonView]:
    scenario = read_scenario(NEAR).model_copy(update={"seed": seed})
    camera = square_camera(camera_of(scenario))
    heading = np.radians(scenario.vehicle.heading_deg) + aside_rad
    body = matrix_from_wxyz(world_from_body(*tilt_rad, float(heading)))
    backwards = -back_m * np.array([np.sin(heading), np.cos(heading), 0.0])
    place = np.array([0.0, 0.0, height_m]) + backwards + body @ np.array(scenario.camera.position_body_m)
    pose = CameraPose(place, body @ body_from_camera(0.0))
    renderer = Renderer(scenario)
    try:
        taken = renderer.expose(lambda _: pose, 1.0, 0.0)
        truth = view_person(renderer.world, 0, pose, camera.intrinsics, 1.0, 0.0)
    finally:
        renderer.close()
    assert truth is not None
    squeezed = cv2.resize(taken, (640, 480), interpolation=cv2.INTER_AREA)
    size = camera.intrinsics.width_px, camera.intrinsics.height_px
    return np.asarray(cv2.resize(squeezed, size), np.uint8), truth


@pytest.mark.parametrize(
    ("seed", "tilt_rad", "aside_rad", "height_m"),
    [(1, (0.0069, 0.0164), 0.0165, 0.9348), (5, (-0.016, -0.0265), -0.0124, 1.0288)],
)
def test_a_bush_beside_a_near_person_is_not_taken_for_them(
    seed: int, tilt_rad: tuple[float, float], aside_rad: float, height_m: float
) -> None:
    image, truth = picture(seed, tilt_rad, aside_rad, height_m)
    network = NanoDet()
    (body,) = NanoDetDetector(network=network).detect(image)
    tracker = Tracker(network)
    tracker.start(Frame(image, 1.0, 0), body.box)
    track = tracker.update(Frame(image, 1.07, 1))
    assert track.state == "tracking"
    assert track.pixel[0] == pytest.approx(truth.pixel[0], abs=0.03 * truth.height_px)
    assert track.box.height_px == pytest.approx(truth.height_px, rel=0.12)


@pytest.mark.parametrize("guessed", [1.0, 1.3])
def test_a_height_guessed_of_who_is_cut_off_is_measured_once_all_of_them_is_seen(guessed: float) -> None:
    moments = [(0.2 * i, *picture(5, (0.0, 0.0), 0.0, 0.95, back_m=0.12 * i - 0.4)) for i in range(16)]
    _, image, truth = moments[0]
    assert truth.height_px > image.shape[0]
    network = NanoDet()
    (body,) = NanoDetDetector(network=network).detect(image)
    tracker = Tracker(network)
    tracker.start(Frame(image, 0.0, 0), replace(body.box, height_px=guessed * body.box.height_px))
    for i, (t_s, image, _) in enumerate(moments[1:], 1):
        track = tracker.update(Frame(image, t_s, i))
        assert track.state == "tracking"
    _, image, truth = moments[-1]
    assert truth.height_px < 0.7 * image.shape[0]
    assert track.height_px == pytest.approx(truth.height_px, rel=0.05)
    assert track.pixel == pytest.approx(truth.pixel, abs=0.03 * truth.height_px)


def test_who_fills_the_picture_from_top_to_bottom_is_found_again() -> None:
    here, elsewhere = (picture(5, (0.0, 0.0), aside, 0.95, back_m=-0.4) for aside in (0.0, 1.0))
    image, truth = here
    network = NanoDet()
    (body,) = NanoDetDetector(network=network).detect(image)
    tracker = Tracker(network)
    tracker.start(Frame(image, 0.0, 0), body.box)
    images = [image] * 2 + [elsewhere[0]] * 4 + [image] * 4
    tracks = [tracker.update(Frame(image, 0.07 * i, i)) for i, image in enumerate(images, 1)]
    assert {track.state for track in tracks[2:6]} == {"coasting"}
    assert tracks[-1].state == "tracking"
    assert tracks[-1].pixel[0] == pytest.approx(truth.pixel[0], abs=0.03 * truth.height_px)
