"""The upright window: one person's surroundings, turned upright and scaled so that the body is always equally tall.

What is measured in it has the same bias at every distance and every roll of the camera, and a constant bias of the size
cancels in the ratio of sizes.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from mission.records import Image, Matrix, Vector

_BEYOND = (114, 114, 114)
"""What is shown beyond the edge of the frame: grey, as detectors are trained with; smeared edges look like legs."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A picture cut out of a frame by a similarity transform.

    Coordinates in the window and in the frame are pixels with (0, 0) = outer corner of the top left pixel.
    """

    image: Image
    window_from_frame: Matrix
    """(2, 2), scale times rotation."""
    offset_px: Vector
    """(2,), window = window_from_frame @ frame + offset."""
    frame_size: tuple[int, int]
    """Width and height of the frame."""

    @property
    def scale(self) -> float:
        """Window pixels per frame pixel."""
        return float(np.hypot(self.window_from_frame[0, 0], self.window_from_frame[1, 0]))

    def to_frame(self, x_px: float, y_px: float) -> tuple[float, float]:
        """From a point of the window to the point of the frame."""
        x, y = np.linalg.solve(self.window_from_frame, np.array([x_px, y_px]) - self.offset_px)
        return float(x), float(y)

    def to_window(self, x_px: float, y_px: float) -> tuple[float, float]:
        """From a point of the frame to the point of the window."""
        x, y = self.window_from_frame @ np.array([x_px, y_px]) + self.offset_px
        return float(x), float(y)

    def shows(self, x_px: float, y_px: float) -> bool:
        """Whether a point of the window lies in the frame (what lies beyond is made up)."""
        x, y = self.to_frame(x_px, y_px)
        return 0.0 <= x <= self.frame_size[0] and 0.0 <= y <= self.frame_size[1]

    def shown(self) -> Image:
        """(height, width): 255 where the window's pixel lies in the frame, 0 where it is made up."""
        height, width = self.image.shape[:2]
        if all(self.shows(x, y) for x in (0.0, width) for y in (0.0, height)):
            return np.full((height, width), 255, np.uint8)
        frame = np.array([[0, 0], [self.frame_size[0], 0], [*self.frame_size], [0, self.frame_size[1]]], np.float64)
        corners = frame @ self.window_from_frame.T + self.offset_px
        mask = np.zeros((height, width), np.uint8)
        cv2.fillConvexPoly(mask, np.round(16.0 * (corners - 0.5)).astype(np.int32), 255, shift=4)
        return mask


def cut_window(
    image: Image,
    centre: tuple[float, float],
    body_px: float,
    window_body_px: float,
    size: tuple[int, int],
    roll_rad: float = 0.0,
) -> Window:
    """Cut out the window around a person.

    Args:
        image: the frame, BGR.
        centre: of the body in the frame, pixels; becomes the middle of the window.
        body_px: the body's height in the frame.
        window_body_px: the height that it gets in the window.
        size: width and height of the window, pixels.
        roll_rad: of the camera about its optical axis, positive with the right side down; taken out.
    """
    scale = window_body_px / body_px
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    turn = scale * np.array([[c, -s], [s, c]])
    offset = np.array(size) / 2.0 - turn @ np.array(centre)
    # The region of the frame that the window shows; cutting it first keeps smoothing and warping cheap.
    corners = np.array([[0.0, 0.0], [size[0], 0.0], [0.0, size[1]], [size[0], size[1]]])
    seen = np.linalg.solve(turn, (corners - offset).T).T
    margin = 3.0 + 2.0 / scale
    height, width = image.shape[:2]
    left, top = (
        int(np.clip(np.floor(v - margin), 0, n - 2)) for v, n in zip(seen.min(0), (width, height), strict=True)
    )
    right, bottom = (
        int(np.clip(np.ceil(v + margin), a + 2, n))
        for v, a, n in zip(seen.max(0), (left, top), (width, height), strict=True)
    )
    part = image[top:bottom, left:right]
    if scale < 0.6:  # warpAffine does not smooth, and fine patterns would alias into shapes that are not there
        part = np.asarray(cv2.GaussianBlur(part, (0, 0), 0.4 / scale), np.uint8)
    # OpenCV puts (0, 0) at the centre of the top left pixel.
    shift = offset + turn @ np.array([left + 0.5, top + 0.5]) - 0.5
    warped = cv2.warpAffine(
        part, np.c_[turn, shift], size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=_BEYOND
    )
    return Window(np.asarray(warped, np.uint8), turn, offset, (width, height))
