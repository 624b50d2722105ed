"""The contact sheet shows evenly chosen frames with the box on the target, in the colour of the tracker's state."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from gcs_plugin.flight_report.contact_sheet import (
    BACKGROUND,
    CAPTION_HEIGHT,
    GAP,
    STATE_COLOURS,
    TILE_WIDTH,
    contact_sheet,
)
from mission.records import Box, Image
from mission.track import Track, TrackState

GREY = 128


@dataclass(frozen=True)
class Shown:
    image: Image
    t_s: float
    track: Track


def frame(i: int, state: TrackState = "tracking", box: Box | None = None, grey: int = GREY) -> Shown:
    image = np.full((480, 640, 3), grey, dtype=np.uint8)
    where = box or Box(160.0, 120.0, 80.0, 240.0)
    track = Track(i, 100.0 + i, state, where, where.centre_px, 1.0, 240.0 if state == "tracking" else None, 0.02, 0.9)
    return Shown(image, 100.0 + i, track)


def picture(jpeg: bytes) -> Image:
    decoded = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return np.asarray(decoded, dtype=np.uint8)


def near(pixel: Image, colour: tuple[int, int, int], tolerance: float = 45.0) -> bool:
    return float(np.abs(pixel.astype(float) - colour).max()) < tolerance


def test_frames_are_taken_evenly_with_the_first_and_the_last_among_them() -> None:
    frames = [frame(i, grey=10 * i + 20) for i in range(20)]
    sheet = picture(contact_sheet(frames, started_s=100.0, count=4, columns=2))
    height = 300 + CAPTION_HEIGHT
    assert sheet.shape[:2] == (2 * (height + GAP) + GAP, 2 * (TILE_WIDTH + GAP) + GAP)
    corners = [
        int(sheet[GAP + row * (height + GAP) + 8, GAP + column * (TILE_WIDTH + GAP) + 8, 0])
        for row in range(2)
        for column in range(2)
    ]
    assert corners == pytest.approx([20, 80, 150, 210], abs=4)  # frames 0, 6, 13 and 19


@pytest.mark.parametrize("state", ["tracking", "coasting", "lost"])
def test_the_box_is_drawn_where_the_target_is_in_the_colour_of_the_state(state: TrackState) -> None:
    sheet = picture(contact_sheet([frame(0, state)], started_s=100.0))
    scale = TILE_WIDTH / 640.0
    left, middle = round(160.0 * scale), round(240.0 * scale)
    side = sheet[GAP + middle, GAP + left - 4 : GAP + left + 5]
    # JPEG halves the resolution of colour: look for the most alike.
    distance = np.abs(side.astype(float) - STATE_COLOURS[state]).max(axis=1)
    assert distance.min() < 60.0
    assert near(sheet[GAP + 20, GAP + 20], (GREY, GREY, GREY), 6.0)


def test_a_box_beyond_the_picture_does_not_cross_the_caption() -> None:
    inside = picture(contact_sheet([frame(0)], started_s=100.0))
    beyond = picture(contact_sheet([frame(0, box=Box(300.0, 400.0, 100.0, 500.0))], started_s=100.0))
    caption = slice(GAP + 300 + 8, GAP + 300 + CAPTION_HEIGHT)
    assert np.abs(inside[caption].astype(int) - beyond[caption].astype(int)).max() < 40


def test_a_few_frames_make_a_small_sheet_with_empty_places() -> None:
    sheet = picture(contact_sheet([frame(i) for i in range(3)], started_s=100.0, columns=2))
    assert sheet.shape[0] > sheet.shape[1] * 0.7
    assert near(sheet[-60, -200], BACKGROUND, 8.0)


def test_nothing_to_show_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        contact_sheet([], started_s=0.0)
