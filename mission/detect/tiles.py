"""Small people in a large picture: NanoDet on overlapping tiles, each enlarged, beside one look at the whole picture.

Seen from a drone 10 to 60 m up somebody is 12 to 60 px tall. Shrunk to the network's input they vanish; in a tile that
is enlarged they are as tall as what the network was trained with. Each tile costs as much as a whole picture.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from mission.detect.detector import suppress
from mission.detect.nanodet import INPUT_PX, NanoDet, NanoDetDetector
from mission.records import Box, Detection, Image

_ENLARGED: Final = 2.0
"""Tiles are shown to the network at this scale: a body of 15 px is 30 px tall there."""
_OVERLAP: Final = 0.35
"""Of neighbouring tiles: nobody of less than 70 px is cut by all that show them."""
_EDGE_PX: Final = 3.0
"""A box that ends so near to an inner edge of its tile is a part of somebody, who is whole in the next."""
_SAME: Final = 0.4


class TiledDetector:
    """People of all sizes, the small ones in tiles.

    Args:
        threshold: smallest class score that counts; higher than for whole pictures, as so many tiles are looked at.
        network: to share one that is already loaded.
    """

    def __init__(self, threshold: float = 0.45, network: NanoDet | None = None) -> None:
        shared = network or NanoDet()
        self._whole = NanoDetDetector(network=shared)
        self._part = NanoDetDetector(threshold, shared)

    @property
    def name(self) -> str:
        """``tiles``."""
        return "tiles"

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        """See `mission.detect.detector.Detector.detect`."""
        height, width = image.shape[:2]
        frame = Box(0.0, 0.0, float(width), float(height))
        wanted = frame if region is None else region
        found = self._whole.detect(image, region)
        for tile in tiles(wanted, frame):
            found += [one for one in self._part.detect(image, tile) if _whole(one.box, tile, frame)]
        return suppress(found, 0.0, _SAME)


def tiles(wanted: Box, frame: Box) -> Iterator[Box]:
    """Overlapping squares that cover a part of a frame.

    Args:
        wanted: what is to be covered, pixels.
        frame: the whole picture.
    """
    side = INPUT_PX / _ENLARGED
    for top in _starts(max(wanted.top_px, 0.0), min(wanted.bottom_px, frame.height_px), side):
        for left in _starts(max(wanted.left_px, 0.0), min(wanted.right_px, frame.width_px), side):
            yield Box(left, top, min(side, frame.width_px - left), min(side, frame.height_px - top))


def _starts(first: float, last: float, side: float) -> list[float]:
    room = last - first - side
    if room <= 0.0:
        return [first]
    steps = int(-(-room // ((1.0 - _OVERLAP) * side)))
    return [round(first + room * k / steps) for k in range(steps + 1)]


def _whole(box: Box, tile: Box, frame: Box) -> bool:
    """Whether a box does not end at an edge of its tile that is not the picture's."""
    return not (
        (box.left_px - tile.left_px < _EDGE_PX < tile.left_px)
        or (box.top_px - tile.top_px < _EDGE_PX < tile.top_px)
        or (tile.right_px - box.right_px < _EDGE_PX and tile.right_px < frame.right_px - _EDGE_PX)
        or (tile.bottom_px - box.bottom_px < _EDGE_PX and tile.bottom_px < frame.bottom_px - _EDGE_PX)
    )
