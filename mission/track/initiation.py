"""Who is meant by the box that a track begins with, head to foot."""

from __future__ import annotations

import numpy as np

from mission.errors import DetectionError
from mission.records import Box, Image
from mission.track.detections import BodyDetection, WindowDetectors

_BOX_SHARES = (1.0, 0.6)
"""How much of the body a detector's box may show."""
_AS_SURE = 0.8
"""Share of the surest body's score from which on another one may be preferred for being whole."""


def initial_detection(eyes: WindowDetectors, image: Image, box: Box, roll_rad: float) -> BodyDetection:
    """Who is in the box, head to foot: HOG's box may hold but the upper half of a body.

    Args:
        eyes: the detectors.
        image: the frame, BGR.
        box: of the person, from a detector or drawn by hand.
        roll_rad: of the camera.

    Raises:
        DetectionError: there is no person in the box.
    """
    found = [
        body
        for share in _BOX_SHARES
        for body in eyes.bodies(image, box.centre_px, box.height_px / share, roll_rad)[1]
        if _means(box, body)
    ]
    if not found:
        raise DetectionError("There is nobody to follow in the box", "Draw the box around one person, head to foot.")
    # Somebody near is cut off by the picture, and then a bush is the more complete body, but not as surely one.
    surest = max(body.score for body in found)
    found = [body for body in found if body.score > _AS_SURE * surest]
    return max(found, key=lambda body: (body.whole, body.score))


def _means(box: Box, body: BodyDetection) -> bool:
    """Whether the box means this body, of which it may hold but a half: a tree beside a near person is not in it."""
    aside, above = np.abs(np.subtract(body.centre, box.centre_px)).tolist()
    return bool(aside < 0.5 * box.width_px and above < 0.6 * box.height_px)
