"""Who is where in a real video: boxes of people, made once with a detector at higher resolution and looked at by eye.

``vtest-people.json`` is for vtest.avi, which Debian's package opencv-doc carries (PETS 2009, S2.L1, view 1; recorded at
7 frames a second, whatever the file says). NanoDet on the picture enlarged 1.5 times gave the boxes, overlap linked
them where nothing else was near, and the pieces were put together into people on contact sheets. Pieces that could not
be told are under ``unnamed``: somebody, but nobody knows who.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from mission.records import Box

Half = Literal["development", "held-out"]
MOST_MISSING = 10
"""Frames over which a person's place is interpolated between two pieces; over more it is not known."""
_THINNED = 6
"""Every third box is kept, so within a piece neighbours are at most this far apart."""


@dataclass(frozen=True, slots=True)
class Walker:
    """Somebody who is known from beginning to end."""

    name: str
    half: Half
    boxes: dict[int, Box]
    """By frame; frames in which nobody can say where they are (behind a sign, mostly) are missing."""


@dataclass(frozen=True, slots=True)
class Annotations:
    """All that is known of a video."""

    rate_hz: float
    walkers: tuple[Walker, ...]
    unnamed: tuple[dict[int, Box], ...]

    def others(self, walker: Walker, frame: int) -> list[Box]:
        """Everybody else in a frame; second boxes on the same body are left out."""
        boxes = [w.boxes[frame] for w in self.walkers if w is not walker and frame in w.boxes]
        boxes += [piece[frame] for piece in self.unnamed if frame in piece]
        own = walker.boxes.get(frame)
        return boxes if own is None else [b for b in boxes if apart(b, own) > 0.12]


def apart(one: Box, other: Box) -> float:
    """Distance of two boxes' middles, in heights of the second."""
    (x, y), (u, v) = one.centre_px, other.centre_px
    return float(((x - u) ** 2 + (y - v) ** 2) ** 0.5) / other.height_px


def read(path: Path | None = None) -> Annotations:
    """Read annotations.

    Args:
        path: of a JSON file as described above; the one of vtest.avi where it is None.
    """
    text = (
        resources.files("sitl.real_video").joinpath("vtest-people.json").read_text(encoding="utf-8")
        if path is None
        else path.read_text(encoding="utf-8")
    )
    kept: dict[str, Any] = json.loads(text)
    walkers = tuple(
        Walker(one["name"], one["half"], _joined([_piece(rows) for rows in one["boxes"]])) for one in kept["people"]
    )
    return Annotations(float(kept["rate_hz"]), walkers, tuple(_piece(rows) for rows in kept["unnamed"]))


def _piece(rows: Sequence[Sequence[float]]) -> dict[int, Box]:
    """Frame, left, top, width, height; frames between are interpolated."""
    return _joined([{int(frame): Box(float(x), float(y), float(w), float(h))} for frame, x, y, w, h in rows], _THINNED)


def _joined(pieces: Sequence[dict[int, Box]], most: int = MOST_MISSING) -> dict[int, Box]:
    answer: dict[int, Box] = {}
    last: int | None = None
    for piece in pieces:
        first = min(piece)
        if last is not None and 1 < first - last <= most:
            for frame in range(last + 1, first):
                answer[frame] = _between(answer[last], piece[first], (frame - last) / (first - last))
        answer |= piece
        last = max(piece)
    return answer


def _between(one: Box, other: Box, share: float) -> Box:
    pairs = (
        (one.left_px, other.left_px),
        (one.top_px, other.top_px),
        (one.width_px, other.width_px),
        (one.height_px, other.height_px),
    )
    return Box(*(a + share * (b - a) for a, b in pairs))
