"""How good a track is: the standard deviations of the single measurements, and those reported with the track."""

from __future__ import annotations

import numpy as np

SIDEWAYS_SIGMA = 0.008
"""Of one HOG centre sideways, body heights."""
UPRIGHT_SIGMA = 0.008
"""Of the middle of one NanoDet box, upright, body heights."""
BOX_SIDEWAYS_SIGMA = 0.04
"""Of the middle of one NanoDet box, sideways, body heights."""
MATCH_SIGMA = 0.03
"""Of one correlation, body heights."""
HEIGHT_SIGMA = 0.03
"""Of the log of the height of one NanoDet box."""
CUT_OFF_SIGMA = 0.04
"""Of the body's middle, upright, body heights, where only the head tells it."""


def pixel_sigma_px(height_px: float, filter_sigma_px: float) -> float:
    """Of the body's centre, per axis.

    Args:
        height_px: of the body.
        filter_sigma_px: what the filter knows; it takes the errors of the detectors for white, which they are not.
    """
    return float(np.hypot(np.hypot(0.5, 0.008 * height_px), filter_sigma_px))


def size_sigma(height_px: float, age_s: float) -> float:
    """Of the log of the height.

    Args:
        height_px: of the body.
        age_s: since the height was last measured.
    """
    return float(np.hypot(0.02, 0.6 / height_px) + 0.1 * max(age_s - 0.1, 0.0))
