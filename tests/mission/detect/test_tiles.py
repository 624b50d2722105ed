"""Tiles cover the whole picture, overlap, and do not make two people of one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.detect.tiles import _whole, tiles
from mission.records import Box


@given(st.integers(160, 1920), st.integers(120, 1080))
def test_every_small_body_is_whole_in_some_tile(width: int, height: int) -> None:
    frame = Box(0.0, 0.0, float(width), float(height))
    cover = list(tiles(frame, frame))
    rng = np.random.default_rng(width * height)
    for _ in range(20):
        w, h = rng.uniform(5.0, 25.0), rng.uniform(12.0, 60.0)
        body = Box(float(rng.uniform(0.0, width - w)), float(rng.uniform(0.0, height - h)), w, h)
        assert any(
            tile.left_px <= body.left_px
            and tile.top_px <= body.top_px
            and body.right_px <= tile.right_px
            and body.bottom_px <= tile.bottom_px
            and _whole(body, tile, frame)
            for tile in cover
        )


def test_tiles_stay_inside_the_picture_and_the_region() -> None:
    frame, region = Box(0.0, 0.0, 960.0, 540.0), Box(300.0, 100.0, 320.0, 240.0)
    for tile in tiles(region, frame):
        assert tile.right_px <= frame.right_px
        assert tile.bottom_px <= frame.bottom_px
        assert tile.left_px >= 300.0
        assert tile.top_px >= 100.0


@pytest.mark.parametrize(("left", "whole"), [(201.0, False), (230.0, True)])
def test_what_an_inner_edge_cuts_is_left_to_the_next_tile(left: float, whole: bool) -> None:
    frame, tile = Box(0.0, 0.0, 960.0, 540.0), Box(200.0, 100.0, 208.0, 208.0)
    assert _whole(Box(left, 150.0, 12.0, 30.0), tile, frame) is whole
