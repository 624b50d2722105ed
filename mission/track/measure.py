"""What one frame says about the target: HOG and NanoDet in upright windows around where it is expected."""

from __future__ import annotations

from dataclasses import dataclass

from mission.detect.hog import BodyCentre, WindowedHog
from mission.detect.nanodet import NanoDet, WindowedNanoDet
from mission.detect.window import Window, cut_window
from mission.records import Box, Image

_EDGE = 0.06
"""A box that comes this close to the edge of the picture, in body heights, may be cut off by it."""


@dataclass(frozen=True, slots=True)
class Extent:
    """A body as NanoDet sees it."""

    centre: tuple[float, float]
    """Frame pixels."""
    top: tuple[float, float]
    """Middle of the upper side, frame pixels."""
    height_px: float
    score: float
    feet_visible: bool
    """The lower side is the body's and not the edge of the picture or of the window."""
    sides_visible: bool
    """The same for the left, right and upper sides."""
    box: Box
    """In window pixels."""


class Eyes:
    """The two detectors on the surroundings of one person."""

    def __init__(self, network: NanoDet) -> None:
        self._hog = WindowedHog()
        self._nanodet = WindowedNanoDet(network)

    def centre(self, window: Window, reach: float) -> BodyCentre | None:
        """HOG's centre in a window of `WindowedHog.SIZE` with the body `WindowedHog.BODY_PX` tall.

        Args:
            window: around the expected place.
            reach: how far from it, in body heights.
        """
        return self._hog.centre(window.image, reach * WindowedHog.BODY_PX)

    def bodies(
        self, image: Image, centre: tuple[float, float], height_px: float, roll_rad: float, wide: bool = False
    ) -> tuple[Window, list[Extent]]:
        """All people around a place, best score first.

        Args:
            image: the frame, BGR.
            centre: frame pixels.
            height_px: the height expected; half and double of it are still seen, but measured less well.
            roll_rad: of the camera.
            wide: look one body height to each side instead of two thirds.
        """
        size = (192, 192) if wide else WindowedNanoDet.SIZE
        window = cut_window(image, centre, height_px, WindowedNanoDet.BODY_PX, size, roll_rad)
        margin = _EDGE * WindowedNanoDet.BODY_PX
        answer = []
        for found in self._nanodet.bodies(window.image):
            box = found.box
            x, y = box.centre_px
            answer.append(
                Extent(
                    window.to_frame(x, y),
                    window.to_frame(x, box.top_px),
                    box.height_px / window.scale,
                    found.score,
                    _shows(window, x, box.bottom_px + margin),
                    _shows(window, box.left_px - margin, y)
                    and _shows(window, box.right_px + margin, y)
                    and _shows(window, x, box.top_px - margin),
                    box,
                )
            )
        return window, answer


def _shows(window: Window, x: float, y: float) -> bool:
    """Whether the point is in the window and in the picture."""
    height, width = window.image.shape[:2]
    return 0.0 <= x <= width and 0.0 <= y <= height and window.shows(x, y)
