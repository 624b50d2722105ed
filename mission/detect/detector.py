"""What every detector of people has in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np

from mission.records import Box, Detection, Image


class Detector(Protocol):
    """Finds people in a picture."""

    @property
    def name(self) -> str:
        """What the operator calls it: auto, hog, nanodet or tiles."""
        ...

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        """People in the picture, best score first; none is an empty list.

        Args:
            image: BGR, shape (height, width, 3).
            region: look only here; the boxes are still in pixels of the whole picture.

        Returns:
            Boxes around whole bodies, head to foot, pixels, (0, 0) = outer corner of the top left pixel. Scores of
            different detectors are not comparable.
        """
        ...


def crop(image: Image, region: Box | None) -> tuple[Image, int, int]:
    """The part of the picture inside the region (whole pixels), and the column and row where it starts."""
    height, width = image.shape[:2]
    if region is None:
        return image, 0, 0
    left = int(np.clip(np.floor(region.left_px), 0, width))
    top = int(np.clip(np.floor(region.top_px), 0, height))
    right = int(np.clip(np.ceil(region.right_px), left, width))
    bottom = int(np.clip(np.ceil(region.bottom_px), top, height))
    return image[top:bottom, left:right], left, top


SAME_BODY = 0.7
"""Share of a box inside a better one from which on both are the same body: half a body scores, too."""


def suppress(found: Sequence[Detection], score_threshold: float, overlap: float) -> list[Detection]:
    """Non-maximum suppression (greedy, by intersection over union, then by inclusion), best score first."""
    if not found:
        return []
    boxes = [(d.box.left_px, d.box.top_px, d.box.width_px, d.box.height_px) for d in found]
    chosen = cv2.dnn.NMSBoxes(boxes, [d.score for d in found], score_threshold, overlap)
    kept: list[Detection] = []
    for detection in sorted((found[int(i)] for i in np.ravel(chosen)), key=lambda d: -d.score):
        if all(_inside(detection.box, better.box) < SAME_BODY for better in kept):
            kept.append(detection)
    return kept


def _inside(box: Box, other: Box) -> float:
    """Share of the smaller box that lies in the other one."""
    w = min(box.right_px, other.right_px) - max(box.left_px, other.left_px)
    h = min(box.bottom_px, other.bottom_px) - max(box.top_px, other.top_px)
    smaller = min(box.width_px * box.height_px, other.width_px * other.height_px)
    return max(w, 0.0) * max(h, 0.0) / max(smaller, 1e-9)
