"""The tracker on real people, where Debian's opencv-doc is there (CI installs it)."""

from __future__ import annotations

from pathlib import Path

import pytest

from mission.detect.nanodet import NanoDet
from mission.track import Tracker
from sitl.real_video.__main__ import begin, follow, frames
from sitl.real_video.annotations import read
from sitl.real_video.score import followed, steadiness

VTEST = Path("/usr/share/doc/opencv-doc/examples/data/vtest.avi")
WIDTH_PX = 768
SHOWN = 90
"""Frames of each walk: a test, not the evaluation."""


@pytest.mark.skipif(not VTEST.exists(), reason="Debian's package opencv-doc is not installed")
@pytest.mark.parametrize("name", ["I", "D1", "J"])
def test_real_people_are_kept_and_nobody_else_is_taken_for_them(name: str) -> None:
    known = read()
    walker = next(w for w in known.walkers if w.name == name)
    first = begin(walker, known, WIDTH_PX)
    video = frames(VTEST, known.rate_hz, first, min(first + SHOWN, max(walker.boxes)))
    tracks = follow(video, walker.boxes[first], Tracker(NanoDet()))
    told = followed(walker, tracks, known)
    assert told.right > 0.8 * told.known
    assert told.wrong == 0
    assert steadiness(tracks).jumps <= 1
