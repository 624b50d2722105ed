"""People by histograms of oriented gradients: OpenCV's default people detector (Dalal & Triggs 2005).

It is trained on windows of 64 x 128 px in which a body stands about 96 px tall with a margin all around, so it needs a
body of about 90 px in the picture, and the box that it answers is a third larger than the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from mission.detect.detector import crop, suppress
from mission.records import Box, Detection, Image

BODY_FRACTION = 0.75
"""Height of the body relative to the height of HOG's window."""
SMALLEST_BODY_PX = 90.0
"""Bodies smaller than this are beyond HOG's reach (the issue of simulation: nothing found at 12 m, f = 457 px)."""


@dataclass(frozen=True, slots=True)
class HogDetector:
    """The default detector.

    Args:
        scale: ratio of one size searched to the next.
        threshold: smallest distance from the classifier's hyperplane that counts.
        stride_px: step of the window, at the size searched.
    """

    scale: float = 1.05
    threshold: float = 0.5
    stride_px: int = 8

    @property
    def name(self) -> str:
        """``hog``."""
        return "hog"

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        """See `mission.detect.detector.Detector.detect`; finds bodies of about 90 px and taller."""
        part, left, top = crop(image, region)
        # The window reaches beyond the body, so a picture that is smaller than it can hold nobody.
        if part.shape[0] < 64 or part.shape[1] < 32:
            return []
        boxes, scores = _descriptor().detectMultiScale(
            np.ascontiguousarray(part),
            hitThreshold=self.threshold,
            winStride=(self.stride_px, self.stride_px),
            padding=(16, 16),
            scale=self.scale,
            groupThreshold=0,
        )
        return _bodies(boxes, np.ravel(scores), left, top)


def _bodies(windows: Sequence[Sequence[int]], scores: Sequence[float], left: int, top: int) -> list[Detection]:
    """Windows that mean the same person, merged into the body's box (score-weighted mean), best first."""
    found = [
        Detection(Box(float(x + left), float(y + top), float(w), float(h)), float(s))
        for (x, y, w, h), s in zip(windows, scores, strict=True)
    ]
    merged = []
    for best in suppress(found, 0.0, 0.4):
        group = [d for d in found if d.box.overlap(best.box) > 0.5]
        weights = np.array([d.score for d in group])
        centre_x, centre_y = np.average([d.box.centre_px for d in group], axis=0, weights=weights)
        height = float(np.average([d.box.height_px for d in group], weights=weights)) * BODY_FRACTION
        width = height / 2.5
        merged.append(
            Detection(Box(float(centre_x) - width / 2, float(centre_y) - height / 2, width, height), best.score)
        )
    return merged


def _descriptor() -> cv2.HOGDescriptor:
    # It keeps scratch space of its own, so two threads must not share one; building it costs 0.1 ms.
    hog = cv2.HOGDescriptor()
    hog.setSVMDetector(cv2.HOGDescriptor.getDefaultPeopleDetector())
    return hog
