"""What the target looks like: the colours of the upper and of the lower half of the body."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.detect.window import Window
from mission.records import Vector

_BINS = (6, 24, 24)
_RANGES = (0.0, 256.0, 80.0, 176.0, 80.0, 176.0)
"""Lightness is coarse (it changes with the sun and the exposure), the two colour axes of CIE L*a*b* are finer."""
_LEAST_SHOWN = 0.3
"""Share of a part that must be in the picture; what lies beyond has no colours."""
# Parts in body heights from the body's centre (left, right, top, bottom); narrow, so that they hold little background.
_PARTS = ((-0.08, 0.08, -0.30, -0.02), (-0.07, 0.07, 0.04, 0.26))

Histogram = NDArray[np.float32]


def colours(window: Window, centre: Vector, body_px: float) -> Histogram:
    """Normalised colour histograms of torso and legs, shape (2, bins); zeros for a part that is out of the picture.

    Args:
        window: around the person.
        centre: the body's centre, window pixels.
        body_px: the body's height in the window.
    """
    lab, shown = cv2.cvtColor(window.image, cv2.COLOR_BGR2LAB), window.shown()
    answer = []
    for left, right, top, bottom in _PARTS:
        c0, c1 = (int(np.clip(round(centre[0] + v * body_px), 0, lab.shape[1])) for v in (left, right))
        r0, r1 = (int(np.clip(round(centre[1] + v * body_px), 0, lab.shape[0])) for v in (top, bottom))
        part, mask = lab[r0:r1, c0:c1], shown[r0:r1, c0:c1]
        if np.count_nonzero(mask) <= _LEAST_SHOWN * (right - left) * (bottom - top) * body_px**2:
            answer.append(np.zeros(int(np.prod(_BINS)), np.float32))
            continue
        counts = cv2.calcHist([part], [0, 1, 2], mask, list(_BINS), list(_RANGES))
        # Soft bins: a colour at a bin's edge must not look like another one.
        counts = np.asarray(counts, np.float32)
        for axis in range(3):
            counts = 0.5 * counts + 0.25 * (np.roll(counts, 1, axis) + np.roll(counts, -1, axis))
        answer.append((counts / max(float(counts.sum()), 1e-6)).ravel().astype(np.float32))
    return np.stack(answer)


def adapted(known: Histogram, seen: Histogram, share: float) -> Histogram:
    """What is known of the looks, with a share of what is seen now, part by part where it is seen."""
    new = np.where(known.any(axis=1, keepdims=True), (1.0 - share) * known + share * seen, seen)
    return np.asarray(np.where(seen.any(axis=1, keepdims=True), new, known), np.float32)


def likeness(a: Histogram, b: Histogram) -> float:
    """Bhattacharyya coefficient of the part that agrees less: 1 for the same colours, 0 for none in common.

    Parts that either does not know do not count; 0 where they know none in common.

    In rendered flights the same person stays above 0.7 whatever the side they show, and 95 % of other people are below
    0.45 (`sitl.evaluation.tracking`'s flights).
    """
    both = a.any(axis=1) & b.any(axis=1)
    return float(np.sqrt(a[both] * b[both]).sum(axis=1).min()) if both.any() else 0.0
