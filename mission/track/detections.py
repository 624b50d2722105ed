"""What one frame says about the target: HOG and NanoDet in upright windows around where it is expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.detect.hog import BodyCentre, WindowedHog
from mission.detect.nanodet import NanoDet, WindowedNanoDet
from mission.detect.window import Window, cut_window
from mission.records import Box, Image, Vector

_EDGE = 0.06
"""A box that comes this close to the edge of the picture, in body heights, may be cut off by it."""
_SECOND_BOX = 0.15
"""Two boxes nearer to each other than this, in body heights and in the logarithm of the height, are on one body."""
_CROWD_BODY_PX = 80.0
_CROWD_SIZE = (352, 192)
"""The window in which everybody around the target is looked for, pixels: about three of those of one person."""


@dataclass(frozen=True, slots=True)
class BodyDetection:
    """A body as NanoDet sees it."""

    centre: tuple[float, float]
    """Frame pixels."""
    top: tuple[float, float]
    """Middle of the upper side, frame pixels."""
    bottom: tuple[float, float]
    """Middle of the lower side."""
    height_px: float
    score: float
    head_visible: bool
    """The upper side is the body's and not the edge of the picture or of the window."""
    feet_visible: bool
    """The same for the lower side."""
    sides_visible: bool
    """The same for the left and right sides."""
    box: Box
    """In window pixels."""
    window_cuts: bool = False
    """A side that is not the body's is the window's edge, beyond which the picture goes on."""

    @property
    def whole(self) -> bool:
        """Nothing of the body is out of the picture, so that its height and its middle are what they seem."""
        return self.head_visible and self.feet_visible and self.sides_visible

    def tall(self, guess_px: float) -> float:
        """How tall the body is, pixels; of who is cut off a guess, and at least what is seen.

        Args:
            guess_px: for who is cut off.
        """
        return self.height_px if self.whole else max(self.height_px, guess_px)

    def middle(self, height_px: float, roll_rad: float) -> tuple[float, float] | None:
        """The body's middle by the end of the body that is in the picture; None where neither is.

        Args:
            height_px: of the whole body; counts where only one end is seen.
            roll_rad: of the camera.
        """
        half = 0.5 * height_px
        along = half * np.sin(roll_rad), half * np.cos(roll_rad)
        if self.head_visible:
            seen = self.feet_visible
            return self.centre if seen else (float(self.top[0] + along[0]), float(self.top[1] + along[1]))
        if self.feet_visible:
            return float(self.bottom[0] - along[0]), float(self.bottom[1] - along[1])
        return None


def innovation(body: BodyDetection, expected: Vector, height_px: float, roll_rad: float) -> Vector:
    """(2,) pixels from where a body's middle is expected to where it is; sideways only where its ends are not seen."""
    middle = body.middle(height_px, roll_rad)
    if middle is None:
        return np.array([body.centre[0] - float(expected[0]), 0.0])
    return np.subtract(middle, expected)


def innovation_length(body: BodyDetection, expected: Vector, height_px: float, roll_rad: float) -> float:
    """How far that is (`innovation`)."""
    return float(np.hypot(*innovation(body, expected, height_px, roll_rad)))


class WindowDetectors:
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
    ) -> tuple[Window, list[BodyDetection]]:
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
        return window, self._in(window)

    def _in(self, window: Window) -> list[BodyDetection]:
        margin = _EDGE * WindowedNanoDet.BODY_PX
        answer = []
        for found in self._nanodet.bodies(window.image):
            box = found.box
            x, y = box.centre_px
            above, below = (x, box.top_px - margin), (x, box.bottom_px + margin)
            beside = (box.left_px - margin, y), (box.right_px + margin, y)
            answer.append(
                BodyDetection(
                    window.to_frame(x, y),
                    window.to_frame(x, box.top_px),
                    window.to_frame(x, box.bottom_px),
                    box.height_px / window.scale,
                    found.score,
                    _shows(window, *above),
                    _shows(window, *below),
                    all(_shows(window, *side) for side in beside),
                    box,
                    any(not _holds(window, *side) and window.shows(*side) for side in (above, below, *beside)),
                )
            )
        return answer

    def everybody(
        self, image: Image, centre: tuple[float, float], height_px: float, roll_rad: float
    ) -> tuple[Window, list[BodyDetection]]:
        """All people two body heights to each side of a place, best score first.

        Args:
            image: the frame, BGR.
            centre: frame pixels.
            height_px: the height expected.
            roll_rad: of the camera.
        """
        window = cut_window(image, centre, height_px, _CROWD_BODY_PX, _CROWD_SIZE, roll_rad)
        return window, _distinct(self._in(window))

    def entire(self, image: Image, body: BodyDetection, roll_rad: float) -> BodyDetection:
        """A body again, in a window around what is seen of it; where it is not found there, as it was.

        Args:
            image: the frame, BGR.
            body: seen in a window that was meant for another height or place.
            roll_rad: of the camera.
        """
        _, bodies = self.bodies(image, body.centre, body.height_px, roll_rad)
        same = [b for b in bodies if float(np.hypot(*np.subtract(b.centre, body.centre))) < 0.25 * body.height_px]
        return max(same, key=lambda b: b.score, default=body)


def _distinct(bodies: list[BodyDetection]) -> list[BodyDetection]:
    """Without second boxes on the same body: next to a surer one and of its height."""
    kept: list[BodyDetection] = []
    for body in bodies:
        room = _SECOND_BOX * body.height_px
        if not any(
            float(np.abs(np.subtract(body.centre, other.centre)).max()) < room
            and abs(np.log(body.height_px / other.height_px)) < _SECOND_BOX
            for other in kept
        ):
            kept.append(body)
    return kept


def _holds(window: Window, x: float, y: float) -> bool:
    height, width = window.image.shape[:2]
    return bool(0.0 <= x <= width and 0.0 <= y <= height)


def _shows(window: Window, x: float, y: float) -> bool:
    """Whether the point is in the window and in the picture."""
    return _holds(window, x, y) and window.shows(x, y)
