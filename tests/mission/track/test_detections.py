"""A body that the window cuts is looked at again in a window of its own."""

from __future__ import annotations

import pytest

from mission.detect.nanodet import NanoDet
from mission.track.detections import WindowDetectors
from tests.support.people import film, person


@pytest.fixture(scope="module")
def eyes() -> WindowDetectors:
    return WindowDetectors(NanoDet())


def test_a_body_that_is_taller_than_was_expected_is_seen_entirely(eyes: WindowDetectors) -> None:
    (shot,) = film(person(4.0))
    x, y = shot.truth.pixel
    _, bodies = eyes.bodies(shot.frame.image, (x, y + 0.1 * shot.truth.height_px), 0.55 * shot.truth.height_px, 0.0)
    seen = bodies[0]
    assert seen.window_cuts
    assert not seen.whole
    entire = eyes.entire(shot.frame.image, seen, 0.0)
    assert entire.whole
    assert not entire.window_cuts
    assert entire.height_px == pytest.approx(shot.truth.height_px, rel=0.08)


def test_what_is_not_found_again_stays_as_it_was(eyes: WindowDetectors) -> None:
    (shot,) = film(person(4.0))
    _, bodies = eyes.bodies(shot.frame.image, shot.truth.pixel, 0.55 * shot.truth.height_px, 0.0)
    blank = shot.frame.image.copy()
    blank[:] = 114
    assert eyes.entire(blank, bodies[0], 0.0) is bodies[0]


def test_who_is_cut_off_by_the_picture_is_not_cut_by_the_window(eyes: WindowDetectors) -> None:
    (shot,) = film(person(4.0))
    x, y = shot.truth.pixel
    image = shot.frame.image[: int(y + 0.2 * shot.truth.height_px)]
    _, bodies = eyes.bodies(image, (x, y), shot.truth.height_px, 0.0)
    assert not bodies[0].feet_visible
    assert not bodies[0].window_cuts
