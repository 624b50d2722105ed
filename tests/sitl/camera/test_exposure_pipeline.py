"""Pictures are developed and sent in order, beside the rendering."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from mission.records import Image
from sitl.camera.exposure_pipeline import ExposurePipeline
from sitl.camera.renderer import Renderer


class Negative:
    """Stands for the renderer: develops light to its double."""

    def develop(self, light: Image, t_s: float) -> Image:
        del t_s
        return np.asarray(2 * light, np.uint8)


class Album:
    """A sender that keeps what it is given, and fails at a full page."""

    def __init__(self, pages: int = 100) -> None:
        self.muted = self.closed = False
        self.kept: list[tuple[int, float]] = []
        self._pages = pages

    def send(self, picture: Image, capture_s: float) -> None:
        if len(self.kept) == self._pages:
            raise OSError("no page left")
        self.kept.append((int(picture[0, 0]), round(capture_s, 3)))

    def close(self) -> None:
        self.closed = True


def light(grey: int) -> Image:
    return np.full((2, 2), grey, np.uint8)


def darkroom(album: Album) -> ExposurePipeline:
    return ExposurePipeline(cast(Renderer, Negative()), album)


def test_pictures_leave_in_the_order_in_which_they_were_handed_in_and_none_is_left_behind() -> None:
    album = Album()
    room = darkroom(album)
    for k in range(8):
        room.hand(light(k), 5.0 + 0.1 * k, 5.0)
    room.close()
    assert album.kept == [(2 * k, round(0.1 * k, 3)) for k in range(8)]
    assert album.closed


def test_the_last_picture_can_be_sent_again() -> None:
    album = Album()
    room = darkroom(album)
    room.hand(light(7), 0.0, 0.0)
    room.hand(None, 0.05, 0.0)
    room.close()
    assert album.kept == [(14, 0.0), (14, 0.05)]


def test_what_goes_wrong_with_a_picture_is_told_with_the_next() -> None:
    album = Album(pages=0)
    room = darkroom(album)
    room.hand(light(1), 0.0, 0.0)
    with pytest.raises(OSError, match="no page left"):
        room.hand(light(2), 0.05, 0.0)
    room.close()


def test_a_cut_link_is_the_sender_s_to_keep() -> None:
    album = Album()
    room = darkroom(album)
    room.mute(True)
    assert album.muted
    room.close()
