"""The contact sheet: frames of the flight side by side, with the target's box, the time and the tracker's state.

Where the background was followed, its points trail behind: those that stand still, and those that move by themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol

import cv2
import numpy as np

from mission.bundle import PointTrails
from mission.records import Image
from mission.track import Track, TrackState

Colour = tuple[int, int, int]
"""Blue, green, red."""

TILE_WIDTH: Final = 400
CAPTION_HEIGHT: Final = 30
GAP: Final = 8
BACKGROUND: Final = (38, 32, 27)
INK: Final = (235, 235, 235)
STILL: Final = (235, 190, 60)
MOVING: Final = (200, 80, 230)
"""Colours of the background's points."""
TRAIL_S: Final = 0.8
NOW_S: Final = 0.21
"""A point's newest place is at most so much older or newer than the picture: not every frame's places are kept."""
STATE_COLOURS: Final[dict[TrackState, Colour]] = {
    "tracking": (80, 200, 80),
    "coasting": (40, 180, 250),
    "lost": (70, 70, 235),
}


class TrackedPicture(Protocol):
    """A frame with what the tracker made of it (`mission.procedure.flight_record.KeyFrame`)."""

    @property
    def image(self) -> Image:
        """The picture."""
        ...

    @property
    def t_s(self) -> float:
        """Program time."""
        ...

    @property
    def track(self) -> Track:
        """Where the target is in it."""
        ...


def contact_sheet(
    frames: Sequence[TrackedPicture],
    *,
    started_s: float,
    count: int = 12,
    columns: int = 4,
    trails: PointTrails | None = None,
) -> bytes:
    """Draw a contact sheet.

    Args:
        frames: in time order, all of one size.
        started_s: program time from which the captions count.
        count: pictures at most, taken evenly, first and last among them.
        columns: pictures in a row.
        trails: of the background's points, in the frames' own times.

    Returns:
        A JPEG.

    Raises:
        ValueError: there is no frame, or no room for one.
    """
    if not frames or count < 1 or columns < 1:
        raise ValueError("a contact sheet needs at least one frame, row and column")
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(count, len(frames))).round().astype(int))
    tiles = [_tile(frames[i], started_s, trails) for i in chosen]
    columns = min(columns, len(tiles))
    rows = -(-len(tiles) // columns)
    height, width = tiles[0].shape[:2]
    sheet = np.empty((rows * (height + GAP) + GAP, columns * (width + GAP) + GAP, 3), dtype=np.uint8)
    sheet[:] = BACKGROUND
    for i, tile in enumerate(tiles):
        top, left = GAP + (i // columns) * (height + GAP), GAP + (i % columns) * (width + GAP)
        sheet[top : top + height, left : left + width] = tile
    encoded: bytes = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes()
    return encoded


def _tile(frame: TrackedPicture, started_s: float, trails: PointTrails | None) -> Image:
    """A frame, scaled, with the background's points, the box and a caption below."""
    rows, columns = frame.image.shape[:2]
    scale = TILE_WIDTH / columns
    height = round(rows * scale)
    tile = np.empty((height + CAPTION_HEIGHT, TILE_WIDTH, 3), dtype=np.uint8)
    tile[:] = BACKGROUND
    shrinking = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    # Drawn on before it is put into the tile: a box that reaches beyond the picture must not cross the caption.
    picture: Image = np.asarray(cv2.resize(frame.image, (TILE_WIDTH, height), interpolation=shrinking), dtype=np.uint8)
    if trails is not None:
        _draw_trails(picture, trails, frame.t_s, scale)
    track = frame.track
    colour = STATE_COLOURS[track.state]
    _rectangle(picture, track.box.left_px, track.box.top_px, track.box.right_px, track.box.bottom_px, scale, colour)
    if track.state != "lost":
        centre = (round(track.pixel[0] * scale - 0.5), round(track.pixel[1] * scale - 0.5))
        cv2.drawMarker(picture, centre, colour, cv2.MARKER_CROSS, 10, 1, cv2.LINE_AA)
    tile[:height] = picture
    base = height + CAPTION_HEIGHT - 10
    cv2.putText(tile, f"{frame.t_s - started_s:+.2f} s", (6, base), cv2.FONT_HERSHEY_DUPLEX, 0.5, INK, 1, cv2.LINE_AA)
    cv2.circle(tile, (112, base - 5), 5, colour, -1, cv2.LINE_AA)
    cv2.putText(tile, track.state, (124, base), cv2.FONT_HERSHEY_DUPLEX, 0.5, INK, 1, cv2.LINE_AA)
    size = "" if track.height_px is None else f"{track.height_px:.0f} px tall"
    (text_width, _), _ = cv2.getTextSize(size, cv2.FONT_HERSHEY_DUPLEX, 0.5, 1)
    place = (TILE_WIDTH - 6 - text_width, base)
    cv2.putText(tile, size, place, cv2.FONT_HERSHEY_DUPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return tile


def _draw_trails(picture: Image, trails: PointTrails, t_s: float, scale: float) -> None:
    """Where each point that is seen about now came from."""
    recent = np.flatnonzero((trails.t_s > t_s - TRAIL_S) & (trails.t_s <= t_s + NOW_S))
    order = recent[np.lexsort((trails.t_s[recent], trails.track[recent]))]
    corners = np.rint(16.0 * (trails.pixel[order] * scale - 0.5)).astype(np.int32)
    for part in np.split(np.arange(len(order)), np.flatnonzero(np.diff(trails.track[order])) + 1):
        if len(part) == 0 or trails.t_s[order[part[-1]]] < t_s - NOW_S:
            continue
        colour = STILL if trails.still[order[part[-1]]] else MOVING
        cv2.polylines(picture, [corners[part]], False, colour, 1, cv2.LINE_AA, 4)
        cv2.circle(picture, (int(corners[part[-1], 0]), int(corners[part[-1], 1])), 24, colour, -1, cv2.LINE_AA, 4)


def _rectangle(
    picture: Image, left: float, top: float, right: float, bottom: float, scale: float, colour: Colour
) -> None:
    """A box given in the frame's pixels, (0, 0) at the outer corner, where OpenCV has the pixel's centre."""
    corners = [(round(x * scale - 0.5), round(y * scale - 0.5)) for x, y in ((left, top), (right, bottom))]
    cv2.rectangle(picture, corners[0], corners[1], (0, 0, 0), 4, cv2.LINE_AA)
    cv2.rectangle(picture, corners[0], corners[1], colour, 2, cv2.LINE_AA)
