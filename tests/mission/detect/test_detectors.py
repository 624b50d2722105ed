"""HOG and NanoDet on rendered people."""

from __future__ import annotations

import hashlib
from importlib import resources

import numpy as np
import pytest

from mission.detect import Detector, HogDetector, NanoDetDetector, make_detector
from mission.detect.detector import crop, suppress
from mission.records import Box, Detection
from tests.support.people import Shot, film, person


@pytest.fixture(scope="module")
def nanodet() -> NanoDetDetector:
    return NanoDetDetector()


def found(detector: Detector, shot: Shot, region: Box | None = None) -> list[Detection]:
    """Detections whose middle is on the body."""
    return [d for d in detector.detect(shot.frame.image, region) if shot.box.contains(*d.box.centre_px)]


@pytest.mark.parametrize("distance_m", [4.0, 6.0, 8.0])
def test_hog_finds_a_person_within_its_reach_at_about_the_right_place_and_size(distance_m: float) -> None:
    shot = film(person(distance_m))[0]
    best = found(HogDetector(), shot)[0]
    tall = shot.truth.height_px
    assert abs(best.box.centre_px[0] - shot.truth.pixel[0]) < 0.08 * tall
    assert 0.75 < best.box.height_px / tall < 1.35


@pytest.mark.parametrize("distance_m", [6.0, 9.0, 12.0, 15.0])
def test_nanodet_measures_the_height_near_and_far(distance_m: float, nanodet: NanoDetDetector) -> None:
    shot = film(person(distance_m, walk_deg=180.0))[0]
    best = found(nanodet, shot)[0]
    assert best.box.height_px == pytest.approx(shot.truth.height_px, rel=0.13)
    assert best.box.centre_px[0] == pytest.approx(shot.truth.pixel[0], abs=0.08 * shot.truth.height_px)


def test_auto_finds_the_person_that_hog_is_too_far_from() -> None:
    shot = film(person(14.0))[0]
    assert not found(HogDetector(), shot)
    assert found(make_detector("auto"), shot)


def test_an_empty_place_has_nobody(nanodet: NanoDetDetector) -> None:
    shot = film(person(6.0, bearing_deg=0.0) + "[[people]]\ndistance_m = 8.0\nbearing_deg = 20.0\n")[0]
    image = shot.frame.image.copy()
    assert len(nanodet.detect(image)) == 2
    assert nanodet.detect(np.full_like(image, 128)) == []


def test_a_region_restricts_the_search_and_the_boxes_are_those_of_the_whole_picture(nanodet: NanoDetDetector) -> None:
    shot = film(person(6.0, bearing_deg=10.0))[0]
    x = shot.truth.pixel[0]
    (inside,) = nanodet.detect(shot.frame.image, Box(x - 120, 100, 240, 300))
    assert inside.box.centre_px[0] == pytest.approx(x, abs=8.0)
    assert nanodet.detect(shot.frame.image, Box(0, 100, x - 120, 300)) == []


@pytest.mark.parametrize("name", ["auto", "hog", "nanodet"])
def test_detectors_tell_their_names(name: str) -> None:
    assert make_detector(name).name == name  # type: ignore[arg-type]


def test_a_region_outside_of_the_picture_finds_nobody(nanodet: NanoDetDetector) -> None:
    shot = film(person(6.0))[0]
    outside = Box(700.0, 0.0, 50.0, 50.0)
    assert crop(shot.frame.image, outside)[0].size == 0
    assert HogDetector().detect(shot.frame.image, outside) == []
    assert nanodet.detect(shot.frame.image, outside) == []


def test_suppression_keeps_the_best_of_overlapping_boxes() -> None:
    good, worse, apart = (
        Detection(Box(0, 0, 50, 100), 0.9),
        Detection(Box(4, 2, 50, 100), 0.8),
        Detection(Box(200, 0, 50, 100), 0.7),
    )
    assert suppress([worse, apart, good], 0.1, 0.5) == [good, apart]


def test_the_network_comes_with_its_licence_note_and_is_the_file_that_the_note_names() -> None:
    folder = resources.files("mission.detect")
    digest = hashlib.sha256(folder.joinpath("nanodet.onnx").read_bytes()).hexdigest()
    note = folder.joinpath("nanodet.LICENSE.md").read_text(encoding="utf-8")
    assert digest in note
    assert "Apache" in note
    assert "MIT License" in note
