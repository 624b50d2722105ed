"""Points that move by themselves, told from the background by epipolar geometry before anything else is known.

Two pictures of a world that stands still have one essential matrix, whatever the attitude's errors; a person who walks
does not keep to it, unless along the camera's own way. It is found between key frames that lie the better part of a
second apart by a robust estimator (USAC with MAGSAC++; Barath, Noskova, Ivashechkin & Matas 2020), and points vote: who
is an outlier of most pairs is left out. Where the camera hardly moved between two pictures, only what does not even fit
a rotation is an outlier.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.bundle.projection import Rows
from mission.records import Vector

_APART_S = 0.75
"""Between the pictures of a pair: people move by a head's breadth, and most points are still followed."""
_STRIDE = 2
"""Every second frame begins a pair: half the time of all, and the same verdicts but for a few."""
_LEAST_COMMON = 15
"""Points of a pair that its geometry is found from."""
_CONFIDENCE = 0.999


def keeps_to_epipolar_lines(rows: Rows, t_s: Vector, limit: float) -> NDArray[np.bool_]:
    """(m,) by point: False where it leaves the epipolar lines of most pairs of frames that show it.

    Args:
        rows: n of them; a point is seen once in a frame at most.
        t_s: (k,) the frames' times, ascending.
        limit: distance from the epipolar line that ordinary points keep, tangents.
    """
    points = int(rows.point.max(initial=-1)) + 1
    off, pairs = np.zeros(points), np.zeros(points)
    seen = [np.flatnonzero(rows.frame == number) for number in range(len(t_s))]
    later = np.searchsorted(t_s, t_s + _APART_S).tolist()
    for first in range(0, len(t_s), _STRIDE):
        second = later[first]
        if second >= len(t_s):
            break
        a, b = seen[first], seen[second]
        common, in_a, in_b = np.intersect1d(rows.point[a], rows.point[b], assume_unique=True, return_indices=True)
        if len(common) < _LEAST_COMMON:
            continue
        _, inlier = cv2.findEssentialMat(
            rows.measured[a[in_a]], rows.measured[b[in_b]], np.eye(3),
            method=cv2.USAC_MAGSAC, prob=_CONFIDENCE, threshold=limit,
        )  # fmt: skip
        verdict = np.asarray(inlier).ravel()
        if len(verdict) != len(common):
            continue  # none was found
        pairs[common] += 1.0
        off[common] += verdict == 0
    return np.asarray(off <= 0.5 * pairs)
