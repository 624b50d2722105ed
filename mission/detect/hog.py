"""People by histograms of oriented gradients: OpenCV's default people detector (Dalal & Triggs 2005).

It is trained on windows of 64 x 128 px in which a body stands about 96 px tall with a margin all around, so it needs a
body of about 90 px in the picture, and the box that it answers is a third larger than the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.detect.detector import crop, suppress
from mission.records import Box, Detection, Image

BODY_FRACTION = 0.75
"""Height of the body relative to the height of HOG's window."""


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
        return _bodies(np.asarray(boxes, np.float64).reshape(-1, 4), np.ravel(scores), left, top)


@dataclass(frozen=True, slots=True)
class BodyCentre:
    """Where HOG sees the middle of the body."""

    x_px: float
    y_px: float
    score: float


class WindowedHog:
    """HOG on an upright window (`mission.detect.window`) with the body about 120 px tall: the body's centre, finely.

    The positions of all windows that answer are averaged by score, without grouping, on a grid twice as fine as usual.
    What HOG learnt are head, shoulders and torso, so its centre hardly follows the swing of arms and legs.
    """

    BODY_PX = 120.0
    SIZE = (128, 224)

    def __init__(self, threshold: float = 0.0) -> None:
        self._threshold = threshold
        self._hog = _descriptor()

    def centre(self, image: Image, reach_px: float) -> BodyCentre | None:
        """The body's centre in window pixels, or None where there is nobody.

        Args:
            image: the window, BGR.
            reach_px: how far from the middle of the window the body may be.
        """
        boxes, scores = self._hog.detectMultiScale(
            image, hitThreshold=self._threshold, winStride=(4, 4), padding=(0, 0), scale=1.05, groupThreshold=0
        )
        if len(boxes) == 0:
            return None
        corners = np.asarray(boxes, np.float64)
        centres = corners[:, :2] + corners[:, 2:] / 2.0
        weights = np.ravel(scores).astype(np.float64)
        middle = np.array([image.shape[1], image.shape[0]]) / 2.0
        near = np.hypot(*(centres - middle).T) < reach_px
        if not near.any() or weights[near].sum() <= 0.0:
            return None
        x, y = np.average(centres[near], axis=0, weights=weights[near])
        return BodyCentre(float(x), float(y), float(weights[near].max()))


def _bodies(windows: NDArray[np.float64], scores: NDArray[np.float64], left: int, top: int) -> list[Detection]:
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
    hog.setSVMDetector(np.asarray(cv2.HOGDescriptor.getDefaultPeopleDetector(), np.float32))
    return hog
