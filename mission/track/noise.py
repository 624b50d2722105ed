"""How good a track is: the standard deviations of the single measurements, and those reported with the track."""

from __future__ import annotations

import numpy as np

SIDEWAYS_SIGMA = 0.008
"""Of one HOG centre sideways, body heights."""
UPRIGHT_SIGMA = 0.008
"""Of the middle of one NanoDet box, upright, body heights."""
USUAL_SIGMA = 0.009
"""What `mission.track.motion.Motion.noise` is before anything is learnt: of rendered people, body heights."""
BOX_SIDEWAYS_SIGMA = 0.04
"""Of the middle of one NanoDet box, sideways, body heights."""
MATCH_SIGMA = 0.03
"""Of one correlation, body heights."""
HEIGHT_SIGMA = 0.03
"""Of the log of the height of one NanoDet box."""
CUT_OFF_SIZE_SIGMA = 0.3
"""Of the log of the height of who is cut off by the picture when first seen: much of it is a guess."""
PIXEL_CORRELATION_S = 0.2
SIZE_CORRELATION_S = 0.35
"""How long the reported errors last (autocorrelation down to 1/e): they come from the gait and from the view. On 62
rendered flights 0.15 s sideways, 0.3 s upright, 0.33 s of the log height."""
CUT_OFF_SIGMA = 0.06
"""Of the centre while feet or head are out of the picture, body heights: where the middle is must then be guessed, and
the guess (3 % of the height wrong) stays wrong for as long as it lasts, many times the correlation time."""
_FILTER_SIGMA = 0.02
"""What the filter says of a place that is measured all the time, body heights."""

# Measured on about 100 rendered flights (`python -m sitl.evaluation.tracking`): people of 1.6 to 1.9 m, any clothes,
# light, 2.75 to 15 m away, standing or walking 8 ways. What counts is the error left when the flight's mean is taken
# away: the same point of the body, wherever it is, in all frames. Sideways it is 0.7 times what is reported, upright
# 1.2 times (1.3 to 1.5 on flights with fresh seeds).


def pixel_sigma_px(height_px: float, filter_sigma_px: float, cut_off: bool, learnt: float = USUAL_SIGMA) -> float:
    """Of the body's centre, per axis.

    Args:
        height_px: of the body.
        filter_sigma_px: what the filter knows; it counts where it is more than usual.
        cut_off: part of the body is out of the picture.
        learnt: noise by this body's own innovations, body heights.
    """
    usual = np.hypot(0.5, learnt * height_px) + (CUT_OFF_SIGMA * height_px if cut_off else 0.0)
    return float(np.hypot(usual, max(0.0, filter_sigma_px - _FILTER_SIGMA * height_px)))


def size_sigma(height_px: float, age_s: float) -> float:
    """Of the log of the height.

    Args:
        height_px: of the body.
        age_s: since the height was last measured.
    """
    return float(np.hypot(0.025, 0.6 / height_px) + 0.1 * max(age_s - 0.1, 0.0))
