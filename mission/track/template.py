"""Head and shoulders, followed from frame to frame by normalised cross-correlation with sub-pixel peak."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from mission.records import Image, Vector

# The part of the body that is followed, in body heights from the body's centre: from just above the head to below the
# shoulders, narrow enough to hold little background; it swings least in a gait.
_LEFT, _RIGHT, _TOP, _BOTTOM = -0.11, 0.11, -0.53, -0.17
_REACH = 0.12
"""How far it may be from where it is expected, in body heights."""


@dataclass(frozen=True, slots=True)
class Match:
    """Where the template was found."""

    x_px: float
    y_px: float
    """The body's centre in the window."""
    score: float
    """Normalised correlation coefficient, -1 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """A cut-out of head and shoulders from an upright window with a given body height."""

    patch: Image
    corner_px: tuple[float, float]
    """Top left corner of the patch relative to the body's centre, window pixels."""
    t_s: float

    @classmethod
    def cut(cls, window: Image, centre: Vector, body_px: float, t_s: float) -> Template | None:
        """Cut it out; None where it would reach out of the window.

        Args:
            window: upright window, BGR.
            centre: the body's centre in the window, pixels.
            body_px: the body's height in the window.
            t_s: the frame's time.
        """
        left, right = (round(centre[0] + v * body_px) for v in (_LEFT, _RIGHT))
        top, bottom = (round(centre[1] + v * body_px) for v in (_TOP, _BOTTOM))
        if left < 0 or top < 0 or right > window.shape[1] or bottom > window.shape[0]:
            return None
        return cls(window[top:bottom, left:right].copy(), (left - centre[0], top - centre[1]), t_s)

    def find(self, window: Image, expected: Vector, body_px: float) -> Match | None:
        """Find the body's centre near where it is expected; None at the edge of the search or of the window.

        Args:
            window: upright window with the same body height as the one the template was cut from.
            expected: the body's centre, window pixels.
            body_px: the body's height in the window.
        """
        reach = int(np.ceil(_REACH * body_px))
        height, width = self.patch.shape[:2]
        left = round(expected[0] + self.corner_px[0]) - reach
        top = round(expected[1] + self.corner_px[1]) - reach
        left, top = max(left, 0), max(top, 0)
        search = window[top : top + height + 2 * reach, left : left + width + 2 * reach]
        if search.shape[0] < height + 2 or search.shape[1] < width + 2:
            return None
        response = cv2.matchTemplate(search, self.patch, cv2.TM_CCOEFF_NORMED)
        _, score, _, (x, y) = cv2.minMaxLoc(response)
        if not (0 < x < response.shape[1] - 1 and 0 < y < response.shape[0] - 1):
            return None
        return Match(
            left + x + _peak(*response[y, x - 1 : x + 2]) - self.corner_px[0],
            top + y + _peak(*response[y - 1 : y + 2, x]) - self.corner_px[1],
            float(score),
        )


def _peak(before: float, at: float, after: float) -> float:
    """Where the parabola through three neighbours has its maximum, relative to the middle one."""
    curvature = float(before) - 2.0 * float(at) + float(after)
    return 0.0 if curvature >= 0.0 else 0.5 * (float(before) - float(after)) / curvature
